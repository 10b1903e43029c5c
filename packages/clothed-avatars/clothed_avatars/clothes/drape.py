"""Cloth brought to rest on the posed body, and the numbers that say whether it did.

The body moves from its unposed state, around which clothes are cut, into the pose; then it waits
until the cloth rests.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from clothed_avatars.clothes.drape_job import ClothFabric, DrapeJob, GarmentJob
from clothed_avatars.clothes.patterns import Piece
from clothed_avatars.mesh.nearness import Nearness, keep_off, pushed_off
from clothed_avatars.mesh.quads import Floats, triangles
from clothed_avatars.people.body import SKIN_VERTICES, AvatarBody, PosedAvatar, carry
from clothed_avatars.people.poses import Pose, joint_rotations
from harness.core.errors import MethodError
from harness.core.process.blender import find_blender
from harness.core.process.threads import StepReport
from harness.core.process.workers import run_worker

_WORKER = "clothed_avatars.clothes.drape_worker"
_CLEAR_M = 0.004
_FREE_M = 0.45
"""How far cloth may end from where the body would have carried it, as a share of its length."""


@dataclass(frozen=True)
class _Motion:
    """Frames of moving and of waiting, and the solver's substeps per frame."""

    moving: int
    waiting: int
    quality: int


_ATTEMPTS = (_Motion(30, 18, 5), _Motion(40, 24, 9), _Motion(60, 30, 14))


@dataclass(frozen=True)
class Draping:
    """How cloth is brought to rest.

    evened: whether the finished drape is smoothed where it is moved off the body, which takes folds
    with it. attempts: how often it is tried, each time more slowly.
    """

    evened: bool = True
    attempts: int = len(_ATTEMPTS)


_USUAL = Draping()


@dataclass(frozen=True)
class DrapeCheck:
    """What a drape is judged by.

    sunk: share of vertices more than 10 mm inside the body. stretch: 99th percentile of edge
    lengths over those of the cut cloth. strayed_m: 99th percentile of the distance from where the
    body would have carried the cloth. restless_mm: 95th percentile of the last frame's movement.
    """

    sunk: float
    stretch: float
    strayed_m: float
    restless_mm: float

    def complaints(self, limit_strayed_m: float) -> list[str]:
        """What is not as it should be, in words; empty when the drape is good."""
        found = []
        if self.sunk > 0.02:
            found.append(f"{self.sunk:.1%} of it is inside the body")
        if self.stretch > 1.6:
            found.append(f"it is stretched {self.stretch:.2f} times")
        if self.strayed_m > limit_strayed_m:
            found.append(f"it strayed {self.strayed_m:.2f} m")
        if self.restless_mm > 12.0:
            found.append(f"it still moves {self.restless_mm:.1f} mm a frame")
        return found


@dataclass(frozen=True)
class Draped:
    """A piece at rest: vertices (V,3) on the posed body, the check, the attempt that made it."""

    piece: Piece
    vertices: Floats
    check: DrapeCheck
    attempt: int

    def as_dict(self) -> dict[str, object]:
        """Plain values for JSON."""
        numbers = {key: round(value, 4) for key, value in asdict(self.check).items()}
        return {"garment": self.piece.name, "attempt": self.attempt, **numbers}


def _ease_in_out(share: float) -> float:
    share = min(max(share, 0.0), 1.0)
    return share * share * (3 - 2 * share)


def _path(body: AvatarBody, pose: Pose, motion: _Motion) -> list[PosedAvatar]:
    """The body in each frame: shoulders and hips first, elbows a little later."""
    frames = []
    for k in range(motion.moving + motion.waiting):
        share = k / motion.moving
        rotations = joint_rotations(
            body, pose, _ease_in_out(share / 0.8), _ease_in_out((share - 0.2) / 0.8)
        )
        frames.append(body.posed(rotations))
    return frames


def _judge(
    piece: Piece, last: Floats, before: Floats, carried: Floats, skin: Nearness
) -> DrapeCheck:
    edges = np.concatenate([piece.quads[:, [0, 1]], piece.quads[:, [1, 2]]])
    cut = np.linalg.norm(np.diff(piece.vertices[edges], axis=1)[:, 0], axis=1)
    now = np.linalg.norm(np.diff(last[edges], axis=1)[:, 0], axis=1)
    height, _ = skin.height(last)
    moved = np.linalg.norm(last - before, axis=1) * 1000
    return DrapeCheck(
        sunk=float((height < -0.010).mean()),
        stretch=float(np.percentile(now / np.maximum(cut, 1e-3), 99)),
        strayed_m=float(np.percentile(np.linalg.norm(last - carried, axis=1), 99)),
        restless_mm=float(np.percentile(moved, 95)),
    )


def _solve(
    body: AvatarBody,
    path: list[PosedAvatar],
    pieces: Sequence[Piece],
    quality: int,
    progress: StepReport | None,
) -> list[Floats]:
    """The last two frames (2,V,3) of each piece."""
    with tempfile.TemporaryDirectory(prefix="harness-drape-") as name:
        folder = Path(name)
        frames = np.stack([posed.vertices[:SKIN_VERTICES] for posed in path])
        np.savez(
            folder / "body.npz",
            frames=frames.astype(np.float32),
            faces=triangles(body.quads("skin")),
        )
        garments: list[GarmentJob] = []
        for piece in pieces:
            motion = np.stack([carry(piece.vertices, piece.weights, p.transforms) for p in path])
            file, out = folder / f"{piece.name}.npz", folder / f"{piece.name}.npy"
            np.savez(file, frames=motion.astype(np.float32), faces=piece.quads, pin=piece.pin)
            fabric = ClothFabric(piece.fabric.stiffness, piece.fabric.surplus, quality)
            garments.append(GarmentJob(file, out, fabric))
        job = DrapeJob(folder, folder / "body.npz", tuple(garments))
        run_worker(find_blender().worker(_WORKER), job, progress=progress)
        return [np.load(garment.out).astype(float) for garment in garments]


def drape(
    body: AvatarBody,
    pose: Pose,
    pieces: Sequence[Piece],
    progress: StepReport | None = None,
    how: Draping = _USUAL,
) -> list[Draped]:
    """The pieces at rest on the posed body, draped one after the other in their order.

    Raises:
        MethodError: no attempt gave cloth that rests on the body, or Blender failed.
    """
    complaints: list[str] = []
    for attempt, motion in enumerate(_ATTEMPTS[: how.attempts], start=1):
        path = _path(body, pose, motion)
        skin = Nearness(path[-1].vertices, body.quads("skin"))
        out: list[Draped] = []
        complaints = []
        for piece, frames in zip(
            pieces, _solve(body, path, pieces, motion.quality, progress), strict=True
        ):
            carried = carry(piece.vertices, piece.weights, path[-1].transforms)
            check = _judge(piece, frames[-1], frames[0], carried, skin)
            free = _FREE_M * float(np.ptp(piece.vertices[:, 1]))
            complaints += [f"{piece.name}: {text}" for text in check.complaints(free)]
            if how.evened:
                clear = keep_off(frames[-1], piece.quads, skin, _CLEAR_M, rounds=6)
            else:
                clear = pushed_off(frames[-1], skin, _CLEAR_M)
            out.append(Draped(piece, clear, check, attempt))
        if not complaints:
            return out
    raise MethodError(
        f"clothes did not come to rest in {how.attempts} attempts: {'; '.join(complaints)}",
        hint="Give the recipe another pose or a wider cut",
    )

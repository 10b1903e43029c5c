"""What a method was asked and what came out, as people and programs read it."""

import contextlib
import itertools
import tempfile
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
import psutil

from harness.core.arrays import Floats
from harness.core.artifacts import Capture
from harness.core.errors import HarnessError
from harness.core.files.atomic import write_json
from harness.core.mesh import Mesh
from harness.core.process.threads import StepReport
from harness.core.process.workers import worker_main
from harness.core.protocols import Context
from harness.core.records import Environment
from harness.core.typed_json import to_json
from harness.files.mesh_files import save_mesh
from harness.geometry.coinciding import merged_positions, open_edges
from harness.run.cell import lent_to
from harness.run.cost import StageMeter
from harness.run.method_choice import MethodRef
from harness.run.sources import Source
from harness.run.view_choice import views_for
from methods.points.surfacing import reconstructed

_SCHEMA = 1

Answer = Literal["yes", "no", "not asked"]

#: What is asked, in order.
CHECKS: Mapping[str, str] = {
    "environment": "Its environment runs, and it describes itself",
    "runs": "It makes a mesh of one subject, or what becomes one",
    "metres": "The mesh is in metres",
    "place": "The mesh stands where the subject stands",
    "up": "+Y is up",
    "facing": "The subject faces +Z",
    "handedness": "Left is not right",
    "winding": "Faces are wound outward",
    "watertight": "The surface is closed",
    "repeats": "The same seed gives the same mesh",
    "deterministic": "Another seed changes nothing, as it says",
    "declared_views": "Photos that it does not declare change nothing",
    "renamed": "Other names and another folder change nothing",
    "leaves_nothing": "No process of it stays, even when it is killed",
    "cost": "It stays within the time and the memory that were allowed",
}

#: What cannot be asked of a result in a frame of its own.
OF_THE_FRAME = ("metres", "place", "up", "facing", "handedness")


@dataclass(frozen=True, slots=True)
class Check:
    """One question.

    Attributes:
        id: A key of ``CHECKS``.
        answer: ``not asked`` where it makes no sense, or an earlier answer left nothing to ask.
        text: What was found, in a few words.
    """

    id: str
    answer: Answer
    text: str

    @property
    def line(self) -> str:
        """One line for people."""
        mark = {"yes": "ok", "no": "FAILED", "not asked": "-"}[self.answer]
        return f"{mark:7} {CHECKS[self.id]}: {self.text}"


@dataclass(frozen=True, slots=True)
class Certificate:
    """What ``harness conform`` found.

    Attributes:
        method: Its name.
        title: Its title.
        checks: All questions, in the order of ``CHECKS``.
        identity: ``MethodInfo.identity()``; empty where it could not say.
        environment_sha256: Content id of its code, files, packages and interpreter; likewise.
        dataset, subject, recipe, photos: What it was tried on; the last is the capture's key.
        seed: The seed of the trials.
        harness: Where and with what it was tried.
        created_utc: When, ISO 8601.
    """

    method: str
    title: str
    checks: tuple[Check, ...]
    identity: Mapping[str, object] = field(default_factory=dict[str, object])
    environment_sha256: str = ""
    dataset: str = ""
    subject: str = ""
    recipe: str = ""
    photos: str = ""
    seed: int = 0
    harness: Environment | None = None
    created_utc: str = ""

    @property
    def conforms(self) -> bool:
        """Whether no answer is no."""
        return not self.failed

    @property
    def failed(self) -> tuple[str, ...]:
        """The ids of questions whose answer is no."""
        return tuple(check.id for check in self.checks if check.answer == "no")

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values, with the verdict first."""
        return {"schema": _SCHEMA, "conforms": self.conforms, **to_json(self)}

    def save(self, path: Path) -> None:
        """Write it atomically."""
        write_json(path, self.to_dict())


@dataclass(frozen=True, slots=True)
class Trial:
    """What one trial is.

    Attributes:
        source: The dataset, with the subject alone.
        method: The method with its settings.
        capture: Folder of the photos that it is given.
        seed: What it is given as a seed.
        folder: Receives the mesh.
    """

    source: Source
    method: MethodRef
    capture: Path
    seed: int
    folder: Path


@dataclass(frozen=True, slots=True)
class TrialResult:
    """How a trial ended that was not killed.

    Attributes:
        reason: Why there is no mesh; empty where there is one.
        mesh: Its file; empty where there is none.
        before_s: From the worker's start until the method was called, seconds.
        wall_s: How long the method took, seconds.
        peak_rss_mib: The most memory that it used, with its children, MiB.
    """

    reason: str = ""
    mesh: str = ""
    before_s: float = 0.0
    wall_s: float = 0.0
    peak_rss_mib: float = 0.0


def handle(trial: Trial, report: StepReport) -> TrialResult:  # noqa: ARG001
    """Reconstruct; a ``TrialResult`` with the method's own failures in it.

    Raises:
        HarnessError: photos or scan cannot be read, or the mesh cannot be written.
    """
    chosen = trial.method.found(trial.source.workspace)
    info = chosen.info
    capture = views_for(info, Capture.load(trial.capture)).capture
    _, truth = trial.source.load(trial.source.subjects[0])
    lent = lent_to(info, capture, truth)
    meter = StageMeter()
    before_s = time.time() - psutil.Process().create_time()
    start = time.perf_counter()
    try:
        with tempfile.TemporaryDirectory(prefix="harness-work-") as workdir:
            context = Context(trial.seed, Path(workdir), lambda _: contextlib.nullcontext(), lent)
            with meter.stage("whole"):
                mesh = reconstructed(chosen.method, capture, context).mesh
    except HarnessError as error:
        return TrialResult(str(error), before_s=before_s)
    wall_s = time.perf_counter() - start
    path = trial.folder / "mesh.ply"
    save_mesh(path, mesh.geometry())
    peak = max(stage.peak_rss_mib for stage in meter.stages)
    return TrialResult("", str(path), before_s, wall_s, peak)


if __name__ == "__main__":
    worker_main(handle)


_POINTS = 1500
#: A reconstruction is somewhat larger or smaller than the subject, and not by a unit.
_SIZES = (0.7, 1.4)
_UNITS = {"millimetres": 1000.0, "centimetres": 100.0, "inches": 39.37, "kilometres": 0.001}
_FAR_M = 0.25
#: How much nearer another frame has to be before it is taken for the method's.
_NEARER = 1.2
_NEARER_M = 0.002
#: Vertices are in one place if these digits of metres are the same.
_DIGITS = 7


@dataclass(frozen=True, slots=True, eq=False)
class _Frame:
    """A way from a method's axes to the world's.

    Attributes:
        up: The axis of the mesh that is the subject's up.
        yaw_deg: How far it is turned about that.
        mirrored: Whether left and right are exchanged.
        matrix: (3, 3) to the world.
    """

    up: str
    yaw_deg: int
    mirrored: bool
    matrix: Floats

    @property
    def is_ours(self) -> bool:
        return self.up == "+y" and not self.yaw_deg and not self.mirrored


#: (3, 3) turns that make each axis the vertical one; +z as Blender and nerfstudio have it.
_UPS = {
    "+y": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "-y": [[-1, 0, 0], [0, -1, 0], [0, 0, 1]],
    "+z": [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
    "-z": [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
    "+x": [[0, -1, 0], [1, 0, 0], [0, 0, 1]],
    "-x": [[0, 1, 0], [-1, 0, 0], [0, 0, 1]],
}


def _frames() -> Iterator[_Frame]:
    for (up, turn), yaw, mirrored in itertools.product(
        _UPS.items(), (0, 90, 180, 270), (False, True)
    ):
        cosine, sine = round(np.cos(np.radians(yaw))), round(np.sin(np.radians(yaw)))
        about = np.array([[cosine, 0, sine], [0, 1, 0], [-sine, 0, cosine]])
        mirror = np.diag([-1.0 if mirrored else 1.0, 1.0, 1.0])
        matrix = np.asarray(mirror @ about @ np.array(turn), dtype=np.float64)
        yield _Frame(up, yaw, mirrored, matrix)


def frame_checks(mesh: Mesh, truth: Mesh, *, is_scan: bool) -> list[Check]:
    """The questions about the mesh alone.

    Args:
        mesh: What the method made.
        truth: The subject's scan, world metres.
        is_scan: Whether the method hands the scan out, whose holes are not its own.
    """
    ratio = _diagonal(mesh) / _diagonal(truth)
    in_metres = _SIZES[0] <= ratio <= _SIZES[1]
    # Other points on each: two copies of one surface must not be nearer than two of its sides.
    ours, true = _sampled(mesh, 0), _sampled(truth, 1)
    middle = _middle(mesh)
    away_m = float(np.linalg.norm(middle - _middle(truth)))
    scaled = (ours - middle) / (1.0 if in_metres else ratio)
    found, nearest_mm, own_mm = _nearest(scaled, true - _middle(truth))
    near = f"{own_mm:.1f} mm from the scan as it is"
    best = near if found.is_ours else f"{near}, {nearest_mm:.1f} mm when that is changed"
    holes = _holes(mesh)
    volume = mesh.signed_volume
    return [
        Check("metres", _answer(in_metres), _size_text(ratio, in_metres)),
        _place(away_m, in_metres),
        Check("up", _answer(found.up == "+y"), f"{found.up} is; {best}"),
        Check("facing", _answer(not found.yaw_deg), f"turned by {found.yaw_deg} degrees; {best}"),
        Check("handedness", _answer(not found.mirrored),
              f"{'mirrored' if found.mirrored else 'not mirrored'}; {best}"),
        Check("winding", _answer(volume > 0), f"a volume of {volume:.4f} cubic units"),
        Check("watertight", "not asked", f"the scan's own surface, {holes} open edges")
        if is_scan
        else Check("watertight", _answer(not holes), f"{holes} open edges"),
    ]  # fmt: skip


def _answer(holds: bool) -> Answer:
    return "yes" if holds else "no"


def _place(away_m: float, in_metres: bool) -> Check:
    if not in_metres:
        return Check("place", "not asked", "not in metres")
    return Check("place", _answer(away_m <= _FAR_M), f"{away_m:.3f} m from the scan's middle")


def _size_text(ratio: float, in_metres: bool) -> str:
    text = f"{ratio:.3g} times the size of the scan"
    unit = min(_UNITS, key=lambda name: abs(np.log(ratio / _UNITS[name])))
    if in_metres or not _SIZES[0] <= ratio / _UNITS[unit] <= _SIZES[1]:
        return text
    return f"{text}, as if in {unit}"


def _nearest(ours: Floats, truth: Floats) -> tuple[_Frame, float, float]:
    """The frame in which the points are nearest, its distance and that of the world's, mm."""
    from scipy.spatial import KDTree

    tree = KDTree(truth)
    found: list[tuple[float, _Frame]] = []
    for frame in _frames():
        turned = ours @ frame.matrix.T
        there = tree.query(turned)[0].mean()
        back = KDTree(turned).query(truth)[0].mean()
        found.append((float(there + back) / 2, frame))
    nearest_m, nearest = min(found, key=lambda each: each[0])
    own_m, own = next(each for each in found if each[1].is_ours)
    is_own = own_m <= _NEARER * nearest_m + _NEARER_M
    return (own if is_own else nearest), 1000 * nearest_m, 1000 * own_m


def _sampled(mesh: Mesh, seed: int) -> Floats:
    """(P, 3) points on the surface, evenly by area, always the same ones."""
    corners = mesh.vertices[mesh.faces]
    area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    dice = np.random.default_rng(seed)
    chosen = dice.choice(len(area), size=_POINTS, p=area / area.sum())
    u, v = np.sqrt(dice.random(_POINTS)), dice.random(_POINTS)
    weights = np.stack([1 - u, u * (1 - v), u * v], axis=1)
    return np.einsum("pc,pcx->px", weights, corners[chosen])


def _middle(mesh: Mesh) -> Floats:
    return mesh.bounds.mean(axis=0)


def _diagonal(mesh: Mesh) -> float:
    return float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))


def _holes(mesh: Mesh) -> int:
    """Edges that do not join two faces, where vertices in one place count as one."""
    merged = merged_positions(np.round(mesh.vertices, _DIGITS))
    _, first = np.unique(merged, return_index=True)
    a, b, c = corners = merged[mesh.faces].T
    faces = corners.T[(a != b) & (b != c) & (c != a)]
    return open_edges(Mesh(mesh.vertices[first], faces))

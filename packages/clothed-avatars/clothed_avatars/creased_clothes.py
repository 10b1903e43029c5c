"""Clothes that crease: a softer drape, then wrinkles, garment after garment from the inside out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from clothed_avatars.clothes.drape import Draped, Draping, drape
from clothed_avatars.clothes.patterns import Piece
from clothed_avatars.clothes.weaves import WEAVES, Worn
from clothed_avatars.mesh.nearness import Nearness
from clothed_avatars.mesh.noise import smooth_noise
from clothed_avatars.mesh.quads import vertex_normals
from clothed_avatars.people.body import AvatarBody, PosedAvatar, carry
from clothed_avatars.recipe import AvatarRecipe
from clothed_avatars.wrinkles.construction import draw_construction
from clothed_avatars.wrinkles.garment import Wrinkled, wrinkled
from clothed_avatars.wrinkles.surplus import Tailoring
from harness.core.errors import MethodError
from harness.core.files.hashing import derive_seed
from harness.core.process.threads import StepReport

MOST_CROSSING = 0.02
"""A subject is refused if more of a garment's edges pass through it: its drape has collapsed."""

_DRAPING = Draping(evened=False, attempts=1)
"""One attempt: a training subject whose clothes do not come to rest is skipped quickly."""
_UNEVEN_M = ((0.006, 0.16), (0.004, 0.05))
"""Height and size of bumps in the cut: without them both sides of a person fold alike."""


@dataclass(frozen=True)
class Creased:
    """A garment's drape and the same garment with its wrinkles."""

    draped: Draped
    wrinkled: Wrinkled

    def as_dict(self) -> dict[str, object]:
        """Plain values for JSON."""
        return self.draped.as_dict() | {"crossing": round(self.wrinkled.crossing, 5)}


def _uneven(piece: Piece, seed: int) -> Piece:
    """The piece with smooth random bumps, outward only, and none where the body holds it."""
    rise = np.zeros(len(piece.vertices))
    for number, (height_m, size_m) in enumerate(_UNEVEN_M):
        noise = smooth_noise(piece.vertices / size_m, derive_seed(seed, str(number)) % 2**31)
        rise += height_m * np.clip(0.5 + 0.7 * noise, 0, 1)
    rise *= 1 - np.clip(piece.pin, 0, 1)
    out = rise[:, None] * vertex_normals(piece.vertices, piece.quads)
    return replace(piece, vertices=piece.vertices + out)


def _tailoring(recipe: AvatarRecipe, worn: Worn, body: AvatarBody, piece: Piece) -> Tailoring:
    kind, weave = recipe.top.kind, worn.top
    if piece.name == "bottom" and recipe.bottom is not None and worn.bottom is not None:
        kind, weave = recipe.bottom.kind, worn.bottom
    seed = derive_seed(recipe.seed, f"wrinkles-{piece.name}") % 2**31
    sewing = draw_construction(kind, derive_seed(recipe.seed, f"sewing-{piece.name}") % 2**31)
    return Tailoring(body, piece, WEAVES[weave], worn.strength, seed, sewing)


def creased(
    recipe: AvatarRecipe,
    body: AvatarBody,
    posed: PosedAvatar,
    pieces: Sequence[Piece],
    progress: StepReport | None = None,
) -> list[Creased]:
    """The cut pieces (inner first) draped and creased on the posed body; [] if none creases.

    Raises:
        MethodError: the clothes could not be draped, or one has collapsed into itself.
    """
    worn = recipe.worn
    if worn is None:
        return []
    cut = [
        _uneven(piece, derive_seed(recipe.seed, f"uneven-{piece.name}") % 2**31) for piece in pieces
    ]
    below = [Nearness(posed.vertices, body.quads("skin"))]
    out: list[Creased] = []
    for item in drape(body, recipe.posture, cut, progress, _DRAPING):
        carried = carry(item.piece.vertices, item.piece.weights, posed.transforms)
        tailoring = _tailoring(recipe, worn, body, item.piece)
        found = wrinkled(tailoring, item.vertices, carried, below)
        if found.crossing > MOST_CROSSING:
            raise MethodError(
                f"the {item.piece.name} of {recipe.id} passes through itself",
                expected=f"at most {MOST_CROSSING:.1%} of its edges",
                got=f"{found.crossing:.1%}",
                hint="Leave this subject out, or give its recipe another pose",
            )
        below.append(Nearness(found.vertices, found.quads))
        out.append(Creased(item, found))
    return out

"""Drapes that were solved before, shipped with the package: the same cloth on every machine.

A stored drape is used only while the recipe, and all that decides how cloth falls, is what it was
when it was solved; its key says so. Anything else is draped anew.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from pathlib import Path

import numpy as np

from clothed_avatars.clothes.drape import DrapeCheck, Draped
from clothed_avatars.clothes.patterns import Piece
from clothed_avatars.clothes.wardrobe import Bottom, Top
from clothed_avatars.recipe import AvatarRecipe
from harness.core.files.hashing import content_hash
from harness.core.files.npz import read_required_arrays, write_npz

DRAPE_VERSION = 1
"""Changes whenever cutting or draping gives another shape for the same recipe."""

_FOLDER = Path(__file__).parent / "drapes"
_CHECKS = tuple(field.name for field in fields(DrapeCheck))


def _cut(garment: Top | Bottom | None) -> Mapping[str, object] | None:
    """A garment without its looks."""
    if garment is None:
        return None
    cut = {
        k: v for k, v in asdict(garment).items() if k not in ("fabric", "inner", "kind", "collar")
    }
    return cut | {"stiffness": garment.fabric.stiffness, "surplus": garment.fabric.surplus}


def drape_key(recipe: AvatarRecipe) -> str:
    """What decides how a recipe's cloth falls, as a hash: body, pose and cuts, not colours."""
    key: dict[str, object] = {
        "version": DRAPE_VERSION,
        "phenotype": dict(recipe.phenotype),
        "pose": asdict(recipe.posture),
        "top": _cut(recipe.top),
        "bottom": _cut(recipe.bottom),
    }
    if recipe.shape is not None:
        key["shape"] = asdict(recipe.shape)
    return content_hash(key)


def load_drape(
    recipe: AvatarRecipe, pieces: Sequence[Piece], folder: Path = _FOLDER
) -> list[Draped] | None:
    """The stored drape of a recipe's cut pieces, or None if there is none that fits it."""
    path = folder / f"{recipe.id}.npz"
    if not path.is_file():
        return None
    if str(_arrays(path, ["key"])["key"]) != drape_key(recipe):
        return None
    names = [f"{piece.name}{end}" for piece in pieces for end in ("", "_check", "_attempt")]
    stored = _arrays(path, names)
    out: list[Draped] = []
    for piece in pieces:
        vertices = stored[piece.name].astype(float)
        if vertices.shape != piece.vertices.shape:
            return None
        check = dict(zip(_CHECKS, stored[f"{piece.name}_check"].tolist(), strict=True))
        attempt = int(stored[f"{piece.name}_attempt"])
        out.append(Draped(piece, vertices, DrapeCheck(**check), attempt))
    return out


def _arrays(path: Path, names: Sequence[str]) -> dict[str, np.ndarray]:
    """The arrays of some names in a stored drape, all of them."""
    return read_required_arrays(
        path, names, content="drape of an avatar's clothes", hint="Install the package again"
    )


def save_drape(recipe: AvatarRecipe, draped: Sequence[Draped], folder: Path = _FOLDER) -> Path:
    """Store a drape for ``load_drape``; the file's path."""
    arrays: dict[str, np.ndarray] = {"key": np.array(drape_key(recipe))}
    for item in draped:
        arrays[item.piece.name] = item.vertices.astype(np.float32)
        arrays[f"{item.piece.name}_check"] = np.array(
            [getattr(item.check, name) for name in _CHECKS]
        )
        arrays[f"{item.piece.name}_attempt"] = np.array(item.attempt)
    path = folder / f"{recipe.id}.npz"
    write_npz(path, arrays)
    return path

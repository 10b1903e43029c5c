"""One painted surface of the avatar, posed and at rest."""

from __future__ import annotations

from dataclasses import dataclass

from harness.data.avatars.surface import Floats, Ints

__all__ = ["Layer"]


@dataclass(frozen=True)
class Layer:
    """One material of the avatar: vertices (V,3) posed and at rest, metres, triangles (F,3).

    places (V,11): see ``anatomy.pattern_places``. uv (T,2): texture corners in the layer's own unit
    square, with triangles uv_faces (F,3).
    """

    name: str
    posed: Floats
    rest: Floats
    places: Floats
    faces: Ints
    uv: Floats
    uv_faces: Ints

"""One material of an avatar, on the posed body: skin, a garment, hair, a shoe."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from clothed_avatars.mesh.nearness import Nearness
from clothed_avatars.mesh.quads import Floats, Ints, border_loops, refine, triangles


@dataclass(frozen=True)
class Layer:
    """A surface with what its painter needs.

    vertices (V,3) posed, faces (F,3|4); place (V,5): x, y, z where it was cut or grew, on the
    unposed body, and two values that the layer's painter knows (cloth: limb and distance to the
    hem; skin: lips and lids). solid: closed, to be entered by half the sheets' thickness.
    """

    name: str
    vertices: Floats
    faces: Ints
    place: Floats
    solid: bool = False

    def places_at(self, points: Floats) -> Floats:
        """The place (N,5) of the nearest point of the layer."""
        near = Nearness(self.vertices, self.faces)
        _, ids, weights, _ = near.closest(points)
        return np.einsum("nk,nkd->nd", weights, self.place[near.faces[ids]])


def cloth_layer(
    name: str, vertices: Floats, quads: Ints, pattern: Floats, part: Ints, levels: int = 1
) -> Layer:
    """A draped garment, refined; its place holds the limb and the distance to the nearest hem."""
    from scipy.spatial import KDTree

    border = np.concatenate(border_loops(quads))
    hem, _ = KDTree(pattern[border]).query(pattern)
    values = np.concatenate([pattern, part[:, None].astype(float), hem[:, None]], axis=1)
    fine, faces, place = refine(vertices, quads, levels, values)
    return Layer(name, fine, faces, place)


def merge(layers: list[Layer]) -> tuple[Floats, Ints, Ints]:
    """All vertices, all triangles (T,3), and the layer (T,) of each triangle."""
    starts = np.cumsum([0] + [len(layer.vertices) for layer in layers])
    faces = [triangles(layer.faces) for layer in layers]
    return (
        np.concatenate([layer.vertices for layer in layers]),
        np.concatenate([f + start for f, start in zip(faces, starts, strict=False)]),
        np.concatenate([np.full(len(f), k) for k, f in enumerate(faces)]),
    )

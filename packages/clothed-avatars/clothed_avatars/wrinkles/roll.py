"""Hoods and collars, which are laid and not draped, with folds of their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from clothed_avatars.clothes.layer import Layer
from clothed_avatars.mesh.nearness import Nearness
from clothed_avatars.mesh.quads import refine, vertex_normals
from clothed_avatars.wrinkles.relaxation import Held, Steps, contacts, relaxed, springs
from clothed_avatars.wrinkles.ridges import ridges
from clothed_avatars.wrinkles.surplus import creases

_GAP_M = 0.003


@dataclass(frozen=True)
class Rumple:
    """Surplus length as a share, width of the folds, and steps of relaxation."""

    surplus: float
    wave_m: float
    steps: Steps


HOOD = Rumple(0.15, 0.060, Steps(150, 0.03))
COLLAR = Rumple(0.05, 0.045, Steps(80, 0.05))


def rumpled(layer: Layer, rumple: Rumple, seed: int, below: Sequence[Nearness]) -> Layer:
    """The layer of quads, twice as fine, with folds that run any way; it stays off ``below``."""
    points, quads, place = refine(layer.vertices, layer.faces, 1, layer.place)
    net = springs(len(points), quads)
    first, second = net.ends.T
    lengths = np.linalg.norm(points[first] - points[second], axis=1)
    surplus = rumple.surplus * creases(place[:, :3], net.ends, seed)
    heights = ridges(net, 0.8 * surplus, lengths, rumple.wave_m, seed + 10)
    start = points + heights[:, None] * vertex_normals(points, quads)
    held = Held(np.zeros(len(points), bool), contacts(points, below, _GAP_M))
    now = relaxed(points, start, lengths * (1 + surplus), net, rumple.steps, held)
    return replace(layer, vertices=now, faces=quads, place=place)

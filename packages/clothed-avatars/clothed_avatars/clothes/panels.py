"""Cloth that hangs free: tubes below a border, for skirts, coats and dresses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from clothed_avatars.mesh.quads import Floats, Ints, grid
from clothed_avatars.people.body import SKIN_VERTICES, AvatarBody
from clothed_avatars.people.landmarks import trunk_axis

_ROW_M = 0.013
_CLEAR_M = 0.02
_STEP_OUT_M = 0.006
_GATHER_M = 0.11


@dataclass(frozen=True)
class Tube:
    """New vertices (N,3) and where they lie in the cloth (N,3); quads index the border's vertices
    first, then the new ones.
    """

    vertices: Floats
    pattern: Floats
    quads: Ints


def _support(section: Floats, directions: Floats) -> Floats:
    """How far a section (N,2) reaches in each direction (D,2): the radius of its convex hull."""
    return (section @ directions.T).max(0) if len(section) else np.zeros(len(directions))


def _even(angle: Floats) -> Floats:
    """Angles (N,) around a loop, their steps evened out so that no column crosses its neighbour."""
    steps = np.diff(angle, append=angle[0])
    steps = (steps + np.pi) % (2 * np.pi) - np.pi
    for _ in range(12):
        steps = 0.5 * steps + 0.25 * (np.roll(steps, 1) + np.roll(steps, -1))
    even = np.cumsum(steps) - steps
    return (
        angle + np.angle(np.exp(1j * (even - angle))) - np.angle(np.exp(1j * (even - angle)).mean())
    )


def hang(body: AvatarBody, border: Floats, hem: float, flare: float, ripple: float) -> Tube:
    """A tube from a closed border (N,3), running against its own faces, down to the height ``hem``.

    It never narrows, clears the convex hull of the unposed legs, widens by ``flare`` of its width
    and is gathered ``ripple`` metres deep at the hem.
    """
    top = float(border[:, 1].mean())
    centre = trunk_axis(body, np.array([top]))[0]
    offset = border[:, [0, 2]] - centre[[0, 2]]
    angle = _even(np.arctan2(offset[:, 0], offset[:, 1]))
    out = np.stack([np.sin(angle), np.cos(angle)], axis=1)
    first = np.linalg.norm(offset, axis=1)
    legs = body.vertices[:SKIN_VERTICES]
    legs = legs[(legs[:, 1] < top + 0.02) & (np.abs(legs[:, 0]) < 0.33)]
    gathers = np.cos(np.round(2 * np.pi * first.mean() / _GATHER_M) * angle)
    rows, smooth_rows, radius = [border], [border], first
    count = max(2, round((top - hem) / _ROW_M))
    for k in range(1, count + 1):
        share = k / count
        y = top + (hem - top) * share
        section = legs[np.abs(legs[:, 1] - y) < 0.03][:, [0, 2]] - centre[[0, 2]]
        reach = np.minimum(_support(section, out) + _CLEAR_M, radius + _STEP_OUT_M)
        radius = np.maximum(np.maximum(radius, reach), first * (1 + flare * share))
        radius = 0.25 * np.roll(radius, 1) + 0.5 * radius + 0.25 * np.roll(radius, -1)
        for kept, width in ((rows, radius + ripple * share * gathers), (smooth_rows, radius)):
            flat = centre[[0, 2]] + out * width[:, None]
            kept.append(np.stack([flat[:, 0], np.full(len(flat), y), flat[:, 1]], axis=1))
    _, quads = grid(np.stack(rows), closed=True)
    # A border runs with its faces; the tube's own faces must run against it.
    quads = quads[:, ::-1]
    return Tube(np.concatenate(rows[1:]), np.concatenate(smooth_rows[1:]), quads)

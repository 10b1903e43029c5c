"""Cameras that make all outlines coherent: coarse to fine, with a search over views that do not.

Landmarks leave views of the side tens of degrees off, and the least cost nearby is then a wrong
one. It shows: such a view's rays miss. It is turned about the body's upright, with left and right
of its landmarks exchanged, too, and settles where it fits best.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.random import Generator
from scipy.spatial.transform import Rotation

from harness.core.arrays import Floats
from methods.body.photos.detection import Detections
from methods.cameras.adjustment import Rig, Solved, solved
from methods.cameras.coherence import DistanceMap, OutlineRows
from methods.cameras.landmarks import LandmarkRows, landmark_spans

#: Rays of a photo.
_RAYS = 90
#: Trusted distances of outlines and landmarks in pictures, metres, and most rounds: at first, after
#: a view was turned, and to finish.
_FIRST, _AFTER, _FINISH = (0.008, 0.015, 10), (0.008, 0.020, 8), (0.0028, 0.03, 10)
_SEARCHED = (0.008, 0.025)
#: Rays that miss by more than this, root mean square, make a view worth turning, metres: so many
#: views at most, by these angles.
_CALM_M, _TURNED_VIEWS = 0.001, 4
_TURNS_DEG = (-150, -110, -75, -50, -35, -22, -12, 0, 12, 22, 35, 50, 75, 110, 150, 180)
#: So many turns are refined, for so many rounds; the best must cost less than this share.
_REFINED, _REFINE_ROUNDS, _BETTER = 3, 4, 0.97
_SEARCHES = 3
#: Another start turns every camera by about this much.
_SHAKEN_DEG = 12.0


@dataclass(frozen=True, slots=True, eq=False)
class Silhouettes:
    """Outlines and landmarks of some photos, of which cameras are made.

    Attributes:
        maps: Distance maps, by view.
        told: Landmarks, by view; None where cameras are given.
        reach_m: How far before and behind the person's middle its rays are followed.
    """

    maps: tuple[DistanceMap, ...]
    told: Detections | None
    reach_m: float

    def at(self, views: Sequence[int]) -> Silhouettes:
        """Those of some views."""
        told = self.told and self.told.at(views)
        return replace(self, maps=tuple(self.maps[v] for v in views), told=told)

    def rays(self, rig: Rig, sd_m: float, number: int = _RAYS) -> OutlineRows:
        """The outlines as rows."""
        place = rig.points.mean(axis=0), self.reach_m
        return OutlineRows.of(self.maps, number, place, sd_m)

    def marks(self, rig: Rig, sd_m: float) -> LandmarkRows:
        """The landmarks as rows."""
        assert self.told is not None
        return LandmarkRows(self.told, landmark_spans(rig), sd_m, space_weight=0.1)

    def blocks(
        self, rig: Rig, sd_m: float, landmark_m: float, number: int = _RAYS
    ) -> list[OutlineRows | LandmarkRows]:
        """Both as rows."""
        return [self.rays(rig, sd_m, number), self.marks(rig, landmark_m)]

    def misses_m(self, rig: Rig) -> tuple[float, Floats]:
        """Root mean squares by which rays miss: of all, and (C,) of those a view is part of."""
        rays = self.rays(rig, 1.0)
        held = rays.held(rig)
        squared = np.minimum(held.value, 0.0) ** 2
        parts = np.stack([rays.views, held.near, held.far])
        each = [squared[(parts == view).any(axis=0)] for view in range(len(rig))]
        own = [float(np.sqrt(part.mean())) if len(part) else 0.0 for part in each]
        return held.missed_m, np.array(own)


def coherent(rig: Rig, given: Silhouettes) -> tuple[Rig, Silhouettes]:
    """The rig of least cost near this one, and the landmarks as left and right fit it.

    Args:
        rig: By landmarks, its points these landmarks.
        given: Coarse outlines.
    """
    rig = _settled(rig, given, _FIRST)
    for _ in range(_SEARCHES):
        rig, given, is_changed = _searched(rig, given)
        if not is_changed:
            break
        rig = _settled(rig, given, _AFTER)
    return rig, given


def settled(rig: Rig, given: Silhouettes) -> Rig:
    """The rig with outlines trusted more and landmarks less."""
    return _settled(rig, given, _FINISH)


def brought_back(rig: Rig, given: Silhouettes, view: int) -> tuple[Rig, Silhouettes]:
    """The rig with one view where it fits the others best, wherever it was before.

    That may be no place where anybody holds a camera, and too far from the right one: the search
    also begins from another view's.
    """
    elsewhere = rig.with_views([view], rig.at([int(view == 0)]))
    tried: list[tuple[float, Rig, Silhouettes]] = []
    for begun in (rig, elsewhere):
        found = _turned(begun, given, view) or (_refined(begun, given, view).rig, given)
        ended = settled(_settled(*found, _AFTER), found[1])
        tried.append((found[1].misses_m(ended)[0], ended, found[1]))
    return min(tried, key=lambda each: each[0])[1:]


def shaken(rig: Rig, rng: Generator) -> Rig:
    """The rig with each camera led round the body by a random angle."""
    for view in range(len(rig)):
        rig = _led_round(rig, view, float(rng.normal(0.0, _SHAKEN_DEG)))
    return rig


def upright(rig: Rig) -> Floats:
    """(3,) unit: up, across the horizontal axes of cameras that are held level, as the body has it.

    Cameras that look in nearly one direction tell it less than the mean of what is up in them.
    """
    body = rig.points[[0, 7, 8]].mean(axis=0) - rig.points[[23, 24]].mean(axis=0)
    up = upright_line(rig)
    return up if up @ body >= 0 else -up


def upright_line(rig: Rig) -> Floats:
    """(3,) unit: up or down, by the cameras alone."""
    _, spread, axes = np.linalg.svd(rig.rotations[:, 0])
    up = axes[2] if spread[1] > 0.2 * spread[0] else -rig.rotations[:, 1].mean(axis=0)
    return up / np.linalg.norm(up)


def _settled(rig: Rig, given: Silhouettes, stage: tuple[float, float, int]) -> Rig:
    sd_m, landmark_m, rounds = stage
    return solved(rig, given.blocks(rig, sd_m, landmark_m), rounds).rig


def _led_round(rig: Rig, view: int, angle_deg: float) -> Rig:
    """The rig with one camera led round the body's upright, so that it sees its other sides."""
    centre = rig.points.mean(axis=0)
    turn = Rotation.from_rotvec(np.radians(angle_deg) * upright(rig)).as_matrix()
    shift = rig.shifts[view] + rig.rotations[view] @ (centre - turn @ centre)
    led = replace(rig, rotations=(rig.rotations[view] @ turn)[None], shifts=shift[None])
    return rig.with_views([view], led)


def _searched(rig: Rig, given: Silhouettes) -> tuple[Rig, Silhouettes, bool]:
    """The rig with views turned to where they fit better."""
    _, misses = given.misses_m(rig)
    is_changed = False
    for view in np.argsort(-misses, kind="stable")[:_TURNED_VIEWS]:
        if misses[view] < _CALM_M:
            break
        found = _turned(rig, given, int(view))
        if found is not None:
            rig, given = found
            is_changed = True
    return rig, given, is_changed


def _turned(rig: Rig, given: Silhouettes, view: int) -> tuple[Rig, Silhouettes] | None:
    """The rig and landmarks with one view where it costs least; None if that is where it is."""
    assert given.told is not None
    exchanged = np.arange(len(rig)) == view
    ways = [given, replace(given, told=given.told.mirrored(exchanged))]
    here = _refined(rig, given, view)
    tried: list[tuple[float, Rig, Silhouettes]] = []
    rays = given.rays(rig, _SEARCHED[0])
    marks = [way.marks(rig, _SEARCHED[1]) for way in ways]
    for angle_deg in _TURNS_DEG:
        turned = _led_round(rig, view, angle_deg)
        outlines = rays.rows(turned).cost
        tried += [
            (outlines + each.rows(turned).cost, turned, way)
            for each, way in zip(marks, ways, strict=True)
        ]
    tried.sort(key=lambda each: each[0])
    best: tuple[Solved, Silhouettes] = here, given
    for _, turned, way in tried[:_REFINED]:
        found = _refined(turned, way, view)
        if found.cost < best[0].cost:
            best = found, way
    if best[0].cost > _BETTER * here.cost:
        return None
    return best[0].rig, best[1]


def _refined(rig: Rig, given: Silhouettes, view: int) -> Solved:
    return solved(rig, given.blocks(rig, *_SEARCHED), _REFINE_ROUNDS, [view])

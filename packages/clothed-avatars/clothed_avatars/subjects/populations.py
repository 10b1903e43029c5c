"""Subjects unlike the written list in pose, body and build: the sealed split, wide training.

Every person is taller, shorter, heavier or thinner than the written list and ``training`` have; the
body is moved off what Anny can give (``deformation``); the pose keeps a distance from the written
library, and the poses of wide training also from the sealed ones. Children are left out.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from clothed_avatars.clothes.looks import (
    SEALED_PALETTE,
    TRAINING_PALETTE,
    Palette,
    draw_bottom,
    draw_hair,
    draw_shoes,
    draw_top,
    one_of,
)
from clothed_avatars.clothes.wardrobe import Bottom, Top
from clothed_avatars.people.poses import POSES, Pose
from clothed_avatars.people.postures import KINDS, Figure, draw_pose
from clothed_avatars.people.shape import Deformation
from clothed_avatars.subjects.written import Person, Subject
from harness.core.files.hashing import derive_seed

WIDE_TRAINING_ID = re.compile(r"u\d{5}")
LEAST_POSE_DISTANCE_DEG = 18.0
"""Between sealed poses and all that are written, and between wide training's and both."""
USUAL_HEIGHT = (0.30, 0.48)
USUAL_WEIGHT = (0.35, 0.72)
"""Anny's values that the written list and ``training`` have; every person here is outside one."""

_SEALED_COUNT = 20
_WEIGHT = (0.08, 0.95)
_STATURE_M = {"male": (1.56, 1.92), "female": (1.49, 1.84)}
_RMS_M = (0.006, 0.010)
_BUMP_M = (0.11, 0.18)

_SPARE_M = 0.03

_REDRAWN: Mapping[str, int] = MappingProxyType({})
"""Sealed subjects whose clothes did not come to rest, and the draw that took their place."""


def sealed_ids() -> tuple[str, ...]:
    """The ids of the sealed split, in order."""
    return tuple(f"s{number:02d}" for number in range(1, _SEALED_COUNT + 1))


def _stature_m(gender: float, height: float) -> float:
    """What Anny's height value means for an adult, to a few centimetres."""
    return 1.365 - 0.14 * gender + 1.09 * height


def _draw_person(draw: np.random.Generator, palette: Palette, anyone: bool = False) -> Person:
    """A person outside the usual height or weight, or with ``anyone`` of any height and weight."""
    female = draw.random() < 0.5
    gender = float(draw.uniform(0.85, 1.0) if female else draw.uniform(0.0, 0.2))
    while True:
        stature = float(draw.uniform(*_STATURE_M["female" if female else "male"]))
        height = (stature - _stature_m(gender, 0.0)) / 1.09
        weight = float(draw.uniform(*_WEIGHT))
        if anyone or not (_within(height, USUAL_HEIGHT) and _within(weight, USUAL_WEIGHT)):
            break
    return Person(
        gender=gender,
        age=float(draw.uniform(0.66, 0.9)),
        height=height,
        weight=weight,
        muscle=float(draw.uniform(0.2, 0.85)),
        skin=one_of(draw, palette.skins),
        hair=draw_hair(draw, palette, gender),
        eyes=one_of(draw, palette.eyes),
        proportions=float(draw.uniform(0.25, 0.85)),
    )


def _within(value: float, bounds: tuple[float, float]) -> bool:
    return bounds[0] <= value <= bounds[1]


def _draw_clothes(
    draw: np.random.Generator, palette: Palette, female: bool
) -> tuple[Top, Bottom | None]:
    """Top and bottom, no bottom under a dress; men wear neither dresses nor skirts."""
    while True:
        top = draw_top(draw, palette)
        bottom = None if top.kind == "dress" else draw_bottom(draw, palette)
        if female or (bottom is not None and not bottom.skirt):
            return top, bottom


def draw_subject(
    seed: int, palette: Palette, avoided: Sequence[Pose], anyone: bool = False
) -> Subject:
    """A dressed person in a pose that keeps its distance from all avoided; equal seeds give equal
    subjects. ``anyone``: of any height and weight, not only outside the usual.
    """
    draw = np.random.default_rng(seed)
    person = _draw_person(draw, palette, anyone)
    top, bottom = _draw_clothes(draw, palette, person.gender > 0.5)
    shoes = draw_shoes(draw, palette)
    # Cloth that hangs below the crotch is not cut for two raised thighs.
    hangs = top.kind in ("dress", "coat") or (bottom is not None and bottom.skirt)
    kinds = tuple(kind for kind in KINDS if not (hangs and kind == "half sitting"))
    figure = Figure(
        _stature_m(person.gender, person.height),
        1.03 + 0.2 * (person.weight - 0.5),
        _SPARE_M if anyone else 0.0,
    )
    kind, pose = draw_pose(draw, figure, avoided, LEAST_POSE_DISTANCE_DEG, kinds)
    shape = Deformation(
        seed=derive_seed(seed, "shape"),
        rms_m=float(draw.uniform(*_RMS_M)),
        bump_m=float(draw.uniform(*_BUMP_M)),
    )
    return Subject(person, kind, top, bottom, shoes, drawn_pose=pose, shape=shape)


@functools.cache
def sealed_subject(subject_id: str) -> Subject:
    """The subject of a sealed id (``s01`` to ``s20``); equal ids give equal subjects."""
    seed = derive_seed(_REDRAWN.get(subject_id, 0), "avatar-sealed", subject_id)
    return draw_subject(seed, SEALED_PALETTE, tuple(POSES.values()))


@functools.cache
def written_and_sealed_poses() -> tuple[Pose, ...]:
    """All poses that somebody is tested in."""
    drawn = [sealed_subject(subject_id).drawn_pose for subject_id in sealed_ids()]
    return (*POSES.values(), *(pose for pose in drawn if pose is not None))


def wide_training_subject(subject_id: str) -> Subject:
    """The subject of a wide training id (``u`` and five digits); equal ids give equal subjects."""
    seed = derive_seed(0, "avatar-wide-training", subject_id)
    return draw_subject(seed, TRAINING_PALETTE, written_and_sealed_poses())

"""Subjects whose clothes crease: the second test set, and training subjects made like it.

Poses keep their distance from the written and the sealed ones, those of training also from those of
the test. Test and training share no seed, cut, colour of skin, hair or eyes, and no pattern size.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from clothed_avatars.clothes.looks import (
    CREASED_TEST_PALETTE,
    TRAINING_PALETTE,
    Palette,
    one_of,
)
from clothed_avatars.clothes.wardrobe import Bottom, Top
from clothed_avatars.clothes.weaves import Worn, woven
from clothed_avatars.people.poses import Pose
from clothed_avatars.subjects.populations import draw_subject, written_and_sealed_poses
from clothed_avatars.subjects.written import Subject
from harness.core.files.hashing import derive_seed

CREASED_TRAINING_ID = re.compile(r"v\d{5}")

_REVISION = 1
"""Changes whenever the same draws give clothes of another shape."""
_TEST_COUNT = 20
_STRENGTH = (0.85, 1.2)
_WEAVES_OF: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "t-shirt": ("jersey", "jersey", "poplin", "crumpled cotton"),
        "long-sleeved shirt": ("jersey", "jersey", "knit", "poplin"),
        "loose shirt": ("poplin", "poplin", "twill", "crumpled cotton", "crumpled cotton", "satin"),
        "hooded sweater": ("knit", "jersey", "twill"),
        "jacket": ("denim", "twill", "poplin", "wool"),
        "coat": ("wool", "twill", "poplin"),
        "dress": ("poplin", "satin", "jersey", "crumpled cotton"),
        "straight trousers": ("denim", "twill", "twill", "wool", "crumpled cotton"),
        "wide trousers": ("twill", "satin", "poplin", "crumpled cotton", "denim"),
        "shorts": ("denim", "twill", "jersey", "poplin"),
        "skirt": ("satin", "poplin", "wool", "crumpled cotton"),
    }
)


def _weave(draw: np.random.Generator, garment: Top | Bottom) -> str:
    """A weave that suits the garment: what its fabric's pattern names, else drawn."""
    suitable = _WEAVES_OF[garment.kind]
    drawn = one_of(draw, suitable)
    pattern = garment.fabric.pattern
    return pattern if pattern in suitable else drawn


def _creased(subject: Subject, seed: int) -> Subject:
    """The subject in clothes of drawn weaves."""
    draw = np.random.default_rng(derive_seed(seed, "weaves"))
    top, bottom = subject.top, subject.bottom
    above = _weave(draw, top)
    below = None if bottom is None else _weave(draw, bottom)
    strength = round(float(draw.uniform(*_STRENGTH)), 3)
    return replace(
        subject,
        top=replace(top, fabric=woven(top.fabric, above)),
        bottom=None
        if bottom is None or below is None
        else replace(bottom, fabric=woven(bottom.fabric, below)),
        worn=Worn(above, below, strength, _REVISION),
    )


def _draw(seed: int, palette: Palette, avoided: tuple[Pose, ...]) -> Subject:
    return _creased(draw_subject(seed, palette, avoided, anyone=True), seed)


def creased_test_ids() -> tuple[str, ...]:
    """The ids of the second test set, in order."""
    return tuple(f"b{number:02d}" for number in range(1, _TEST_COUNT + 1))


@functools.cache
def creased_test_subject(subject_id: str) -> Subject:
    """The subject of an id of the second test set; equal ids give equal subjects."""
    seed = derive_seed(0, "avatar-creased-test", subject_id)
    return _draw(seed, CREASED_TEST_PALETTE, written_and_sealed_poses())


@functools.cache
def _avoided_in_training() -> tuple[Pose, ...]:
    drawn = [creased_test_subject(subject_id).drawn_pose for subject_id in creased_test_ids()]
    return (*written_and_sealed_poses(), *(pose for pose in drawn if pose is not None))


def creased_training_subject(subject_id: str) -> Subject:
    """The subject of a training id (``v`` and five digits); equal ids give equal subjects."""
    seed = derive_seed(0, "avatar-creased-training", subject_id)
    return _draw(seed, TRAINING_PALETTE, _avoided_in_training())

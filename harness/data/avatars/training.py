"""Training subjects: as many as asked for, drawn by id, none of them like a test subject.

Colours have their own palette, and patterns their own sizes: a training set shares no texture and
no cut with the written list, and no seed, since seeds are derived from ids.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from harness.core.hashing import derive_seed
from harness.data.avatars import wardrobe
from harness.data.avatars.poses import POSES
from harness.data.avatars.subjects import Person, Subject
from harness.data.avatars.wardrobe import Bottom, Colour, Fabric, Hair, Shoes, Top

__all__ = ["TRAINING_ID", "training_subject"]

TRAINING_ID = re.compile(r"t\d{5}")

_SKINS: Sequence[Colour] = (
    (240, 206, 184),
    (228, 186, 160),
    (206, 156, 120),
    (174, 124, 90),
    (134, 90, 64),
    (92, 60, 44),
)
_HAIRS: Sequence[Colour] = (
    (26, 22, 20),
    (52, 36, 26),
    (84, 54, 34),
    (120, 82, 50),
    (172, 130, 80),
    (206, 172, 118),
    (160, 158, 156),
)
_EYES: Sequence[Colour] = ((84, 54, 34), (104, 124, 84), (66, 104, 150), (60, 44, 34))
_PATTERNS = ("plain", "plain", "stripes", "checks", "dots", "knit", "leaves", "denim")
_STYLES = ("short", "curly", "long", "bun", "ponytail")
_T = TypeVar("_T")


def _one(draw: np.random.Generator, items: Sequence[_T]) -> _T:
    return items[int(draw.integers(len(items)))]


def _colour(draw: np.random.Generator) -> Colour:
    red, green, blue = (int(v) for v in draw.integers(24, 232, 3))
    return red, green, blue


def _fabric(draw: np.random.Generator) -> Fabric:
    # Sizes from 1.25: the written list has 1.0 and less.
    return Fabric(
        _colour(draw),
        _one(draw, _PATTERNS),
        _colour(draw),
        scale=float(draw.uniform(1.25, 2.2)),
        stiffness=float(draw.uniform(0.6, 2.5)),
        surplus=float(draw.uniform(0.02, 0.05)),
    )


def _top(draw: np.random.Generator) -> Top:
    one_fabric: tuple[Callable[[Fabric], Top], ...] = (
        wardrobe.t_shirt,
        wardrobe.long_sleeved,
        wardrobe.loose_shirt,
        wardrobe.hooded_sweater,
    )
    kind = int(draw.integers(7))
    if kind < 4:
        top = one_fabric[kind](_fabric(draw))
    elif kind == 4:
        top = wardrobe.jacket(_fabric(draw), _fabric(draw))
    elif kind == 5:
        top = wardrobe.coat(_fabric(draw), _fabric(draw) if draw.random() < 0.5 else None)
    else:
        top = wardrobe.dress(_fabric(draw))
    sleeve = (
        top.sleeve
        if top.sleeve > 0.9
        else float(np.clip(top.sleeve + draw.uniform(-0.06, 0.14), 0, 1))
    )
    return replace(
        top,
        chest=top.chest * float(draw.uniform(0.97, 1.07)),
        sleeve_ease=top.sleeve_ease * float(draw.uniform(0.96, 1.1)),
        hem=top.hem + float(draw.uniform(-0.03, 0.05)),
        sleeve=sleeve,
    )


def _bottom(draw: np.random.Generator) -> Bottom:
    make = _one(
        draw, (wardrobe.straight_trousers, wardrobe.wide_trousers, wardrobe.shorts, wardrobe.skirt)
    )
    bottom = make(_fabric(draw))
    return replace(bottom, cuff=bottom.cuff * float(draw.uniform(0.95, 1.1)))


def training_subject(subject_id: str) -> Subject:
    """The subject of a training id (``t`` and five digits); equal ids give equal subjects."""
    draw = np.random.default_rng(derive_seed(0, "avatar-training", subject_id))
    gender = float(draw.uniform(0.0, 1.0))
    person = Person(
        gender=gender,
        age=float(draw.uniform(0.6, 0.85)),
        height=float(draw.uniform(0.3, 0.48)),
        weight=float(draw.uniform(0.35, 0.72)),
        muscle=float(draw.uniform(0.35, 0.7)),
        skin=_one(draw, _SKINS),
        hair=Hair(_one(draw, _STYLES if gender > 0.5 else _STYLES[:2]), _one(draw, _HAIRS)),
        eyes=_one(draw, _EYES),
    )
    top = _top(draw)
    return Subject(
        person,
        _one(draw, tuple(POSES)),
        top,
        None if top.kind == "dress" else _bottom(draw),
        Shoes(_colour(draw), _one(draw, ((228, 226, 220), (44, 42, 42)))),
    )

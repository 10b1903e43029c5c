"""Training subjects: as many as asked for, drawn by id, none of them like a test subject.

Colours have their own palette, and patterns their own sizes: a training set shares no texture and
no cut with the written list, and no seed, since seeds are derived from ids. Poses are those of the
written library; ``populations`` draws subjects with poses of their own.
"""

from __future__ import annotations

import re

import numpy as np

from clothed_avatars.clothes.looks import (
    TRAINING_PALETTE,
    draw_bottom,
    draw_hair,
    draw_shoes,
    draw_top,
    one_of,
)
from clothed_avatars.people.poses import POSES
from clothed_avatars.subjects.written import Person, Subject
from harness.core.files.hashing import derive_seed

TRAINING_ID = re.compile(r"t\d{5}")


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
        skin=one_of(draw, TRAINING_PALETTE.skins),
        hair=draw_hair(draw, TRAINING_PALETTE, gender),
        eyes=one_of(draw, TRAINING_PALETTE.eyes),
    )
    top = draw_top(draw, TRAINING_PALETTE)
    return Subject(
        person,
        one_of(draw, tuple(POSES)),
        top,
        None if top.kind == "dress" else draw_bottom(draw, TRAINING_PALETTE),
        draw_shoes(draw, TRAINING_PALETTE),
    )

"""Looks drawn at random: fabrics, cuts, hair, skin. A palette keeps populations apart."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from clothed_avatars.clothes import wardrobe
from clothed_avatars.clothes.wardrobe import Bottom, Colour, Fabric, Hair, Shoes, Top


@dataclass(frozen=True)
class Palette:
    """Colours of skin, hair, eyes and soles, and the range of the sizes of patterns."""

    skins: Sequence[Colour]
    hairs: Sequence[Colour]
    eyes: Sequence[Colour]
    soles: Sequence[Colour]
    pattern_scale: tuple[float, float]


# The written list has patterns of size 1.0 and less, training from 1.25 to 2.2; sealed lies
# between, and the second test set above.
TRAINING_PALETTE = Palette(
    skins=(
        (240, 206, 184),
        (228, 186, 160),
        (206, 156, 120),
        (174, 124, 90),
        (134, 90, 64),
        (92, 60, 44),
    ),
    hairs=(
        (26, 22, 20),
        (52, 36, 26),
        (84, 54, 34),
        (120, 82, 50),
        (172, 130, 80),
        (206, 172, 118),
        (160, 158, 156),
    ),
    eyes=((84, 54, 34), (104, 124, 84), (66, 104, 150), (60, 44, 34)),
    soles=((228, 226, 220), (44, 42, 42)),
    pattern_scale=(1.25, 2.2),
)
SEALED_PALETTE = Palette(
    skins=(
        (232, 194, 170),
        (218, 172, 142),
        (190, 138, 104),
        (160, 112, 80),
        (120, 80, 58),
        (80, 54, 42),
    ),
    hairs=(
        (32, 27, 25),
        (44, 32, 26),
        (94, 62, 40),
        (132, 88, 56),
        (182, 142, 92),
        (130, 128, 128),
        (156, 84, 46),
    ),
    eyes=((76, 50, 36), (96, 116, 78), (84, 120, 158), (66, 48, 38)),
    soles=((218, 216, 208), (56, 52, 50)),
    pattern_scale=(1.04, 1.21),
)
CREASED_TEST_PALETTE = Palette(
    skins=(
        (238, 202, 180),
        (220, 178, 148),
        (194, 142, 110),
        (154, 106, 76),
        (112, 76, 56),
        (86, 58, 46),
    ),
    hairs=(
        (30, 24, 22),
        (58, 40, 30),
        (98, 64, 40),
        (144, 100, 58),
        (196, 160, 108),
        (140, 138, 136),
        (148, 78, 42),
    ),
    eyes=((80, 52, 32), (92, 112, 76), (72, 108, 146), (64, 46, 36)),
    soles=((222, 220, 214), (50, 46, 46)),
    pattern_scale=(2.25, 2.9),
)

_PATTERNS = ("plain", "plain", "stripes", "checks", "dots", "knit", "leaves", "denim")
_STYLES = ("short", "curly", "long", "bun", "ponytail")
_T = TypeVar("_T")


def one_of(draw: np.random.Generator, items: Sequence[_T]) -> _T:
    """One of the items, each as likely as the others."""
    return items[int(draw.integers(len(items)))]


def _colour(draw: np.random.Generator) -> Colour:
    red, green, blue = (int(v) for v in draw.integers(24, 232, 3))
    return red, green, blue


def _fabric(draw: np.random.Generator, palette: Palette) -> Fabric:
    return Fabric(
        _colour(draw),
        one_of(draw, _PATTERNS),
        _colour(draw),
        scale=float(draw.uniform(*palette.pattern_scale)),
        stiffness=float(draw.uniform(0.6, 2.5)),
        surplus=float(draw.uniform(0.02, 0.05)),
    )


def draw_top(draw: np.random.Generator, palette: Palette) -> Top:
    """A top of any kind, its cut varied."""
    one_fabric: tuple[Callable[[Fabric], Top], ...] = (
        wardrobe.t_shirt,
        wardrobe.long_sleeved,
        wardrobe.loose_shirt,
        wardrobe.hooded_sweater,
    )
    kind = int(draw.integers(7))
    if kind < 4:
        top = one_fabric[kind](_fabric(draw, palette))
    elif kind == 4:
        top = wardrobe.jacket(_fabric(draw, palette), _fabric(draw, palette))
    elif kind == 5:
        top = wardrobe.coat(
            _fabric(draw, palette), _fabric(draw, palette) if draw.random() < 0.5 else None
        )
    else:
        top = wardrobe.dress(_fabric(draw, palette))
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


def draw_bottom(draw: np.random.Generator, palette: Palette) -> Bottom:
    """A bottom of any kind, its cut varied."""
    make = one_of(
        draw, (wardrobe.straight_trousers, wardrobe.wide_trousers, wardrobe.shorts, wardrobe.skirt)
    )
    bottom = make(_fabric(draw, palette))
    return replace(bottom, cuff=bottom.cuff * float(draw.uniform(0.95, 1.1)))


def draw_hair(draw: np.random.Generator, palette: Palette, gender: float) -> Hair:
    """Hair of any style that the gender wears here."""
    return Hair(one_of(draw, _STYLES if gender > 0.5 else _STYLES[:2]), one_of(draw, palette.hairs))


def draw_shoes(draw: np.random.Generator, palette: Palette) -> Shoes:
    """Shoes of any colour."""
    return Shoes(_colour(draw), one_of(draw, palette.soles))

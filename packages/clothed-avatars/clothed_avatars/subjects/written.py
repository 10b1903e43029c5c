"""The written list of the twenty test subjects: who they are, how they stand, what they wear."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from clothed_avatars.clothes.wardrobe import (
    Bottom,
    Colour,
    Fabric,
    Hair,
    Shoes,
    Top,
    coat,
    dress,
    hooded_sweater,
    jacket,
    long_sleeved,
    loose_shirt,
    shorts,
    skirt,
    straight_trousers,
    t_shirt,
    wide_trousers,
)
from clothed_avatars.clothes.weaves import Worn
from clothed_avatars.people.poses import Pose
from clothed_avatars.people.shape import Deformation


@dataclass(frozen=True)
class Person:
    """Anny's phenotype values, 0 to 1 (gender 0 male, 1 female; age 0.67 young adult), skin and
    eye colour, hair.
    """

    gender: float
    age: float
    height: float
    weight: float
    muscle: float
    skin: Colour
    hair: Hair
    eyes: Colour = (92, 62, 40)
    proportions: float = 0.6


@dataclass(frozen=True)
class Subject:
    """One line of the list; ``bottom`` is None under a dress, ``shoes`` on bare feet.

    ``pose`` names a pose of the written library, or says in a word what ``drawn_pose`` is like.
    ``worn`` is given if the clothes crease.
    """

    person: Person
    pose: str
    top: Top
    bottom: Bottom | None
    shoes: Shoes | None
    drawn_pose: Pose | None = None
    shape: Deformation | None = None
    worn: Worn | None = None


_PALE, _LIGHT, _TAN = (236, 200, 178), (224, 180, 152), (198, 148, 112)
_BROWN, _DARK = (148, 100, 70), (104, 70, 52)
_BLACK_HAIR, _DARK_HAIR, _CHESTNUT = (38, 32, 30), (66, 46, 34), (104, 66, 42)
_BLOND, _GREY, _RED = (190, 150, 96), (150, 148, 146), (142, 70, 38)
_BLUE_EYES, _GREEN_EYES = (74, 112, 142), (88, 108, 70)

_WHITE, _CREAM, _INK, _NAVY = (240, 240, 238), (236, 226, 204), (40, 40, 44), (40, 52, 92)
_BURGUNDY, _MUSTARD, _FOREST, _SKY = (122, 38, 52), (204, 156, 50), (44, 92, 64), (122, 164, 204)
_CORAL, _LILAC, _STONE, _TEAL = (222, 106, 86), (158, 132, 186), (172, 164, 148), (38, 112, 114)

_JEANS = Fabric((62, 84, 124), "denim", (128, 148, 180))
_BLACK_JEANS = Fabric((52, 54, 60), "denim", (92, 94, 100))
_LIGHT_JEANS = Fabric((112, 142, 182), "denim", (176, 196, 220))
_CHINO = Fabric((178, 152, 112))
_OLIVE = Fabric((96, 98, 62))

_SNEAKERS = Shoes(_WHITE, (196, 60, 52))
_WHITE_SHOES = Shoes((236, 236, 232))
_BLACK_SHOES = Shoes((48, 46, 46), (30, 30, 30))
_BROWN_SHOES = Shoes((104, 66, 44), (52, 38, 30))
_BLUE_SHOES = Shoes((52, 82, 140))
_BOOTS = Shoes((84, 60, 44), (40, 32, 28))

SUBJECTS: Mapping[str, Subject] = MappingProxyType(
    {
        "a01": Subject(
            Person(0.05, 0.66, 0.34, 0.50, 0.60, _LIGHT, Hair("short", _DARK_HAIR)),
            "relaxed",
            t_shirt(Fabric((176, 52, 48), "print", _CREAM)),
            straight_trousers(_JEANS),
            _SNEAKERS,
        ),
        "a02": Subject(
            Person(0.95, 0.64, 0.42, 0.45, 0.45, _PALE, Hair("long", _BLOND), _BLUE_EYES),
            "turning",
            long_sleeved(Fabric(_WHITE, "stripes", _NAVY), hem=-0.02),
            skirt(Fabric(_TEAL)),
            _BROWN_SHOES,
        ),
        "a03": Subject(
            Person(0.10, 0.72, 0.40, 0.62, 0.55, _DARK, Hair("curly", _BLACK_HAIR)),
            "walking",
            loose_shirt(Fabric(_SKY, "checks", _WHITE)),
            straight_trousers(_CHINO),
            _BLACK_SHOES,
        ),
        "a04": Subject(
            Person(0.90, 0.67, 0.34, 0.55, 0.50, _BROWN, Hair("bun", _BLACK_HAIR)),
            "hands-on-hips",
            t_shirt(Fabric(_MUSTARD)),
            shorts(_LIGHT_JEANS),
            _WHITE_SHOES,
        ),
        "a05": Subject(
            Person(0.15, 0.70, 0.30, 0.40, 0.45, _TAN, Hair("short", _BLACK_HAIR)),
            "arms-close",
            hooded_sweater(Fabric(_FOREST, "knit")),
            straight_trousers(_BLACK_JEANS),
            _WHITE_SHOES,
        ),
        "a06": Subject(
            Person(0.98, 0.66, 0.48, 0.42, 0.45, _LIGHT, Hair("ponytail", _RED), _GREEN_EYES),
            "knee-bent",
            dress(Fabric(_NAVY, "dots", _WHITE)),
            None,
            _SNEAKERS,
        ),
        "a07": Subject(
            Person(0.08, 0.82, 0.36, 0.68, 0.50, _PALE, Hair("short", _GREY), _BLUE_EYES),
            "standing",
            coat(Fabric((84, 74, 66)), Fabric(_BURGUNDY)),
            straight_trousers(Fabric((84, 86, 92))),
            _BROWN_SHOES,
        ),
        "a08": Subject(
            Person(0.92, 0.68, 0.38, 0.60, 0.45, _TAN, Hair("long", _DARK_HAIR)),
            "wide-stance",
            loose_shirt(Fabric(_CREAM, "stripes", _CORAL, scale=0.7)),
            wide_trousers(_JEANS),
            _WHITE_SHOES,
        ),
        "a09": Subject(
            Person(0.02, 0.64, 0.43, 0.45, 0.75, _BROWN, Hair("curly", _BLACK_HAIR)),
            "reaching",
            t_shirt(Fabric(_WHITE, "print", _NAVY), chest=1.2, hem=0.11),
            shorts(_OLIVE),
            _BLUE_SHOES,
        ),
        "a10": Subject(
            Person(0.96, 0.75, 0.30, 0.66, 0.40, _LIGHT, Hair("short", _GREY)),
            "arms-crossed",
            long_sleeved(Fabric(_LILAC, "knit")),
            wide_trousers(Fabric(_INK)),
            _BLACK_SHOES,
        ),
        "a11": Subject(
            Person(0.12, 0.66, 0.38, 0.52, 0.65, _LIGHT, Hair("short", _BLOND), _GREEN_EYES),
            "turning",
            jacket(_JEANS, Fabric(_WHITE)),
            straight_trousers(Fabric(_STONE)),
            _WHITE_SHOES,
        ),
        "a12": Subject(
            Person(0.94, 0.65, 0.36, 0.48, 0.50, _DARK, Hair("bun", _BLACK_HAIR)),
            "relaxed",
            dress(Fabric(_CORAL, "leaves", (250, 214, 160)), sleeve=0.5, hem=0.62, flare=0.55),
            None,
            _WHITE_SHOES,
        ),
        "a13": Subject(
            Person(0.06, 0.74, 0.33, 0.72, 0.45, _TAN, Hair("short", _DARK_HAIR)),
            "wide-stance",
            loose_shirt(Fabric((196, 70, 60), "checks", _INK)),
            straight_trousers(_JEANS),
            _BOOTS,
        ),
        "a14": Subject(
            Person(0.97, 0.63, 0.44, 0.38, 0.50, _TAN, Hair("ponytail", _BLACK_HAIR)),
            "walking",
            t_shirt(Fabric(_LILAC, "dots", _WHITE, scale=0.7), hem=0.02),
            wide_trousers(_LIGHT_JEANS),
            _SNEAKERS,
        ),
        "a15": Subject(
            Person(0.20, 0.68, 0.35, 0.46, 0.50, _PALE, Hair("curly", _CHESTNUT)),
            "hands-on-hips",
            hooded_sweater(Fabric(_MUSTARD, "stripes", (150, 92, 40))),
            straight_trousers(_BLACK_JEANS, knee=1.1, cuff=1.12),
            _BOOTS,
        ),
        "a16": Subject(
            Person(0.90, 0.80, 0.33, 0.58, 0.40, _PALE, Hair("bun", _GREY), _BLUE_EYES),
            "standing",
            coat(Fabric(_FOREST)),
            skirt(Fabric(_INK), length=0.62, flare=0.25),
            _BLACK_SHOES,
        ),
        "a17": Subject(
            Person(0.04, 0.67, 0.46, 0.42, 0.55, _DARK, Hair("short", _BLACK_HAIR)),
            "knee-bent",
            long_sleeved(Fabric(_FOREST, "stripes", _CREAM)),
            shorts(_CHINO),
            _WHITE_SHOES,
        ),
        "a18": Subject(
            Person(0.93, 0.66, 0.40, 0.52, 0.60, _BROWN, Hair("long", _CHESTNUT)),
            "arms-close",
            jacket(Fabric(_BURGUNDY), Fabric(_WHITE, "stripes", _NAVY, scale=0.5)),
            skirt(Fabric(_NAVY, "checks", _STONE)),
            _BLUE_SHOES,
        ),
        "a19": Subject(
            Person(0.10, 0.78, 0.31, 0.55, 0.50, _LIGHT, Hair("short", _CHESTNUT)),
            "reaching",
            hooded_sweater(Fabric(_INK, "print", _MUSTARD)),
            wide_trousers(_OLIVE),
            _BROWN_SHOES,
        ),
        "a20": Subject(
            Person(0.95, 0.70, 0.37, 0.70, 0.45, _LIGHT, Hair("long", _BLACK_HAIR), _GREEN_EYES),
            "arms-crossed",
            t_shirt(Fabric(_SKY, "leaves", _WHITE), sleeve=0.45),
            skirt(Fabric(_BURGUNDY, "checks", _INK)),
            _BOOTS,
        ),
    }
)

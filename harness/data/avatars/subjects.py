"""The written list of the twenty test subjects: who they are, how they stand, what they wear."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from harness.data.avatars.wardrobe import Bottom, Colour, Fabric, Hair, Shoes, Top

__all__ = ["SUBJECTS", "Person", "Subject"]


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


@dataclass(frozen=True)
class Subject:
    """One line of the list."""

    person: Person
    pose: str
    top: Top
    bottom: Bottom
    shoes: Shoes


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
_BOOTS = Shoes((84, 60, 44), (40, 32, 28), height=0.09)


def _t_shirt(fabric: Fabric, hem: float = 0.035) -> Top:
    return Top("t-shirt", fabric, sleeve=0.62, hem=hem, ease=0.014)


def _long(fabric: Fabric, hem: float = 0.03) -> Top:
    return Top("long-sleeved shirt", fabric, sleeve=1.92, hem=hem, ease=0.013)


def _loose(fabric: Fabric, sleeve: float = 1.94) -> Top:
    return Top("loose shirt", fabric, sleeve=sleeve, hem=0.045, ease=0.026, sleeve_radius=0.062)


def _sweater(fabric: Fabric) -> Top:
    return Top("sweater", fabric, sleeve=1.96, hem=0.035, ease=0.022, sleeve_radius=0.056)


def _dress(fabric: Fabric, length: float, sleeve: float = 0.5) -> tuple[Top, Bottom]:
    top = Top("dress", fabric, sleeve=sleeve, hem=-0.085, ease=0.012)
    return top, Bottom("skirt", fabric, length=length, flare=0.07)


def _straight(fabric: Fabric) -> Bottom:
    return Bottom("straight trousers", fabric, length=2.02, width=0.076)


def _slim(fabric: Fabric) -> Bottom:
    return Bottom("slim trousers", fabric, length=1.98, width=0.0, ease=0.007)


def _wide(fabric: Fabric) -> Bottom:
    return Bottom("wide trousers", fabric, length=2.04, width=0.096, ease=0.014)


def _shorts(fabric: Fabric) -> Bottom:
    return Bottom("shorts", fabric, length=0.86, width=0.094, ease=0.014)


def _skirt(fabric: Fabric, length: float, flare: float = 0.05) -> Bottom:
    return Bottom("skirt", fabric, length=length, flare=flare)


SUBJECTS: Mapping[str, Subject] = MappingProxyType(
    {
        "a01": Subject(
            Person(0.05, 0.66, 0.34, 0.50, 0.60, _LIGHT, Hair("short", _DARK_HAIR)),
            "a-pose",
            _t_shirt(Fabric((176, 52, 48), "print", _CREAM)),
            _straight(_JEANS),
            _SNEAKERS,
        ),
        "a02": Subject(
            Person(0.95, 0.64, 0.42, 0.45, 0.45, _PALE, Hair("long", _BLOND), _BLUE_EYES),
            "hand-on-hip",
            _long(Fabric(_WHITE, "stripes", _NAVY), hem=-0.02),
            _skirt(Fabric(_TEAL), 0.95),
            _BROWN_SHOES,
        ),
        "a03": Subject(
            Person(0.10, 0.72, 0.40, 0.62, 0.55, _DARK, Hair("short", _BLACK_HAIR)),
            "walking",
            _loose(Fabric(_SKY, "checks", _WHITE)),
            _straight(_CHINO),
            _BLACK_SHOES,
        ),
        "a04": Subject(
            Person(0.90, 0.67, 0.34, 0.55, 0.50, _BROWN, Hair("bun", _BLACK_HAIR)),
            "arms-bent",
            _t_shirt(Fabric(_MUSTARD), hem=0.02),
            _shorts(_LIGHT_JEANS),
            _WHITE_SHOES,
        ),
        "a05": Subject(
            Person(0.15, 0.70, 0.30, 0.40, 0.45, _TAN, Hair("short", _BLACK_HAIR)),
            "standing",
            _sweater(Fabric(_FOREST)),
            _slim(_BLACK_JEANS),
            _WHITE_SHOES,
        ),
        "a06": Subject(
            Person(0.98, 0.66, 0.48, 0.42, 0.45, _LIGHT, Hair("bob", _RED), _GREEN_EYES),
            "one-knee-bent",
            *_dress(Fabric(_NAVY, "dots", _WHITE), 1.0),
            _SNEAKERS,
        ),
        "a07": Subject(
            Person(0.08, 0.82, 0.36, 0.68, 0.50, _PALE, Hair("short", _GREY), _BLUE_EYES),
            "turning",
            _long(Fabric(_BURGUNDY)),
            _straight(Fabric((84, 86, 92))),
            _BROWN_SHOES,
        ),
        "a08": Subject(
            Person(0.92, 0.68, 0.38, 0.60, 0.45, _TAN, Hair("long", _DARK_HAIR)),
            "hands-on-hips",
            _sweater(Fabric(_CREAM, "stripes", _CORAL)),
            _wide(_JEANS),
            _WHITE_SHOES,
        ),
        "a09": Subject(
            Person(0.02, 0.64, 0.43, 0.45, 0.75, _BROWN, Hair("short", _BLACK_HAIR)),
            "greeting",
            _t_shirt(Fabric(_WHITE, "print", _NAVY)),
            _shorts(_OLIVE),
            _BLUE_SHOES,
        ),
        "a10": Subject(
            Person(0.96, 0.75, 0.30, 0.66, 0.40, _LIGHT, Hair("bob", _GREY)),
            "hand-to-chest",
            _loose(Fabric(_LILAC), sleeve=1.5),
            _slim(Fabric(_INK)),
            _BLACK_SHOES,
        ),
        "a11": Subject(
            Person(0.12, 0.66, 0.38, 0.52, 0.65, _LIGHT, Hair("short", _BLOND), _GREEN_EYES),
            "reaching",
            _long(Fabric(_INK, "stripes", _STONE)),
            _wide(Fabric(_STONE)),
            _WHITE_SHOES,
        ),
        "a12": Subject(
            Person(0.94, 0.65, 0.36, 0.48, 0.50, _DARK, Hair("bun", _BLACK_HAIR)),
            "hands-at-pockets",
            *_dress(Fabric(_CORAL), 1.45, sleeve=0.75),
            _WHITE_SHOES,
        ),
        "a13": Subject(
            Person(0.06, 0.74, 0.33, 0.72, 0.45, _TAN, Hair("short", _DARK_HAIR)),
            "hands-at-pockets",
            _loose(Fabric((196, 70, 60), "checks", _INK)),
            _straight(_JEANS),
            _BOOTS,
        ),
        "a14": Subject(
            Person(0.97, 0.63, 0.44, 0.38, 0.50, _TAN, Hair("long", _BLACK_HAIR)),
            "walking",
            _t_shirt(Fabric(_LILAC, "dots", _WHITE), hem=0.0),
            _slim(_LIGHT_JEANS),
            _SNEAKERS,
        ),
        "a15": Subject(
            Person(0.20, 0.68, 0.35, 0.46, 0.50, _PALE, Hair("bob", _CHESTNUT)),
            "arms-bent",
            _sweater(Fabric(_MUSTARD, "stripes", (150, 92, 40))),
            _slim(_BLACK_JEANS),
            _BOOTS,
        ),
        "a16": Subject(
            Person(0.90, 0.80, 0.33, 0.58, 0.40, _PALE, Hair("bun", _GREY), _BLUE_EYES),
            "standing",
            _long(Fabric(_TEAL, "dots", _CREAM)),
            _skirt(Fabric(_INK), 1.4, flare=0.035),
            _BLACK_SHOES,
        ),
        "a17": Subject(
            Person(0.04, 0.67, 0.46, 0.42, 0.55, _DARK, Hair("short", _BLACK_HAIR)),
            "hands-on-hips",
            _t_shirt(Fabric(_FOREST, "stripes", _CREAM)),
            _straight(_BLACK_JEANS),
            _WHITE_SHOES,
        ),
        "a18": Subject(
            Person(0.93, 0.66, 0.40, 0.52, 0.60, _BROWN, Hair("long", _CHESTNUT)),
            "greeting",
            _loose(Fabric(_WHITE), sleeve=1.2),
            _shorts(Fabric(_NAVY)),
            _BLUE_SHOES,
        ),
        "a19": Subject(
            Person(0.10, 0.78, 0.31, 0.55, 0.50, _LIGHT, Hair("short", _CHESTNUT)),
            "hand-on-hip",
            _t_shirt(Fabric(_INK, "print", _MUSTARD), hem=0.045),
            _wide(_OLIVE),
            _BROWN_SHOES,
        ),
        "a20": Subject(
            Person(0.95, 0.70, 0.37, 0.70, 0.45, _LIGHT, Hair("bob", _BLACK_HAIR), _GREEN_EYES),
            "turning",
            _sweater(Fabric(_SKY)),
            _skirt(Fabric(_BURGUNDY, "checks", _INK), 0.8, flare=0.06),
            _BOOTS,
        ),
    }
)

"""What can be worn: patterns as plain data, so that another draping can read them too."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Bottom", "Colour", "Fabric", "Hair", "Shoes", "Top"]

Colour = tuple[int, int, int]


@dataclass(frozen=True)
class Fabric:
    """Colours (8-bit sRGB) and pattern: plain, stripes, checks, dots, denim, print."""

    colour: Colour
    pattern: str = "plain"
    second: Colour = (235, 235, 230)


@dataclass(frozen=True)
class Top:
    """A shirt, sweater or dress.

    ``sleeve`` is where sleeves end (1 elbow, 2 wrist), ``hem`` how far below the hip joint (m),
    ``ease`` the mean distance from the body (m), ``sleeve_radius`` the least of a sleeve (m),
    ``neck`` the radius of the neckline (m).
    """

    kind: str
    fabric: Fabric
    sleeve: float = 0.6
    hem: float = 0.05
    ease: float = 0.014
    sleeve_radius: float = 0.0
    neck: float = 0.078


@dataclass(frozen=True)
class Bottom:
    """Trousers, shorts or a skirt.

    It ends at ``length`` along the leg (1 knee, 2 ankle); ``width`` is the least radius of a leg
    (m), ``flare`` what a skirt gains towards its hem (m).
    """

    kind: str
    fabric: Fabric
    length: float = 1.93
    width: float = 0.0
    flare: float = 0.0
    ease: float = 0.010


@dataclass(frozen=True)
class Hair:
    """Cut (short, bob, long, bun) and colour."""

    cut: str
    colour: Colour


@dataclass(frozen=True)
class Shoes:
    """Colour of the upper and of the sole; ``height`` (m) above the ankle joint."""

    colour: Colour
    sole: Colour = (230, 228, 222)
    height: float = 0.0

"""What can be worn: cloth, cuts and presets, as data.

Lengths are metres; ``ease`` factors are widths of the garment over widths of the body.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

Colour = tuple[int, int, int]


@dataclass(frozen=True)
class Fabric:
    """Colours (8-bit sRGB), pattern (plain, stripes, checks, dots, denim, knit, print, leaves), and
    how it falls: ``stiffness`` against bending, ``surplus`` the share by which the cloth is cut
    larger than what it hangs from.
    """

    colour: Colour
    pattern: str = "plain"
    second: Colour = (235, 235, 230)
    scale: float = 1.0
    stiffness: float = 1.0
    surplus: float = 0.04


@dataclass(frozen=True)
class Top:
    """A garment hung from the shoulders.

    sleeve: share of the arm from shoulder (0) to wrist (1). hem: below the hip joint. neck: above
    the base of the neck. scoop, vee: how far the neckline is cut down in front, round or pointed.
    chest, sleeve_ease, cuff, waist: ease factors. flare: widening to the hem; ripple: depth of
    gathers there. opening: width of the front opening, 0 if closed. collar: none, fold, hood (on
    the back) or hood up.
    """

    kind: str
    fabric: Fabric
    sleeve: float = 0.38
    hem: float = 0.08
    neck: float = 0.0
    scoop: float = 0.03
    vee: float = 0.0
    chest: float = 1.14
    sleeve_ease: float = 1.35
    cuff: float = 1.35
    waist: float = 1.0
    flare: float = 0.0
    ripple: float = 0.0
    opening: float = 0.0
    collar: str = "none"
    inner: Fabric | None = None


@dataclass(frozen=True)
class Bottom:
    """A garment hung from the waist: trousers, or a skirt if ``skirt``.

    length: share of the leg from hip (0) to ankle (1); for a skirt, below the hip joint, metres.
    knee, cuff: ease factors. flare: a skirt's widening to the hem; ripple: depth of its gathers.
    """

    kind: str
    fabric: Fabric
    length: float = 0.98
    knee: float = 1.18
    cuff: float = 1.25
    hip: float = 1.04
    skirt: bool = False
    flare: float = 0.0
    ripple: float = 0.0


@dataclass(frozen=True)
class Hair:
    """Style (short, curly, long, bun, ponytail), colour and thickness in metres."""

    style: str
    colour: Colour
    thickness: float = 0.016


@dataclass(frozen=True)
class Shoes:
    """Colour of the upper and of the sole."""

    colour: Colour
    sole: Colour = (230, 228, 222)


def _heavier(fabric: Fabric, stiffness: float, surplus: float) -> Fabric:
    return replace(fabric, stiffness=stiffness, surplus=surplus)


def t_shirt(fabric: Fabric, **cut: float) -> Top:
    """A T-shirt."""
    return replace(Top("t-shirt", fabric), **cut)


def long_sleeved(fabric: Fabric, **cut: float) -> Top:
    """A long-sleeved shirt that follows the body."""
    shirt = Top(
        "long-sleeved shirt", fabric, sleeve=0.98, hem=0.05, chest=1.07, sleeve_ease=1.2, cuff=1.15
    )
    return replace(shirt, **cut)


def loose_shirt(fabric: Fabric, **cut: float) -> Top:
    """A wide, long-sleeved shirt with a folded collar."""
    shirt = Top(
        "loose shirt",
        fabric,
        sleeve=0.98,
        hem=0.12,
        chest=1.22,
        sleeve_ease=1.45,
        cuff=1.25,
        vee=0.05,
        collar="fold",
    )
    return replace(shirt, **cut)


def hooded_sweater(fabric: Fabric, **cut: float) -> Top:
    """A thick sweater with its hood on the back."""
    sweater = Top(
        "hooded sweater",
        _heavier(fabric, 3.0, 0.05),
        sleeve=0.98,
        hem=0.09,
        chest=1.18,
        sleeve_ease=1.42,
        cuff=1.1,
        collar="hood",
    )
    return replace(sweater, **cut)


def jacket(fabric: Fabric, inner: Fabric, **cut: float) -> Top:
    """A short open jacket over a shirt."""
    open_jacket = Top(
        "jacket",
        _heavier(fabric, 4.0, 0.03),
        sleeve=0.98,
        hem=0.06,
        chest=1.2,
        sleeve_ease=1.4,
        cuff=1.2,
        opening=0.05,
        collar="fold",
        inner=inner,
    )
    return replace(open_jacket, **cut)


def coat(fabric: Fabric, inner: Fabric | None = None, **cut: float) -> Top:
    """A coat to the knees, open if there is something to see under it."""
    long_coat = Top(
        "coat",
        _heavier(fabric, 5.0, 0.02),
        sleeve=0.99,
        hem=0.42,
        chest=1.22,
        sleeve_ease=1.45,
        cuff=1.35,
        flare=0.18,
        collar="fold",
        inner=inner,
        opening=0.05 if inner else 0.0,
    )
    return replace(long_coat, **cut)


def dress(fabric: Fabric, **cut: float) -> Top:
    """A dress with a narrow waist and a gathered skirt."""
    gown = Top(
        "dress",
        fabric,
        sleeve=0.3,
        hem=0.46,
        chest=1.05,
        sleeve_ease=1.2,
        cuff=1.25,
        scoop=0.05,
        waist=0.97,
        flare=0.42,
        ripple=0.012,
    )
    return replace(gown, **cut)


def straight_trousers(fabric: Fabric, **cut: float) -> Bottom:
    """Straight trousers."""
    return replace(Bottom("straight trousers", _heavier(fabric, 1.6, 0.04)), **cut)


def wide_trousers(fabric: Fabric, **cut: float) -> Bottom:
    """Wide trousers."""
    wide = Bottom("wide trousers", fabric, length=1.0, knee=1.5, cuff=1.9, hip=1.07)
    return replace(wide, **cut)


def shorts(fabric: Fabric, **cut: float) -> Bottom:
    """Shorts to just above the knee."""
    return replace(Bottom("shorts", fabric, length=0.5, knee=1.35, cuff=1.5, hip=1.05), **cut)


def skirt(fabric: Fabric, **cut: float) -> Bottom:
    """A skirt to the knee."""
    gathered = Bottom("skirt", fabric, length=0.44, skirt=True, flare=0.35, ripple=0.012)
    return replace(gathered, **cut)

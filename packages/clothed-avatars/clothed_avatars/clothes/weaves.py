"""How cloth falls and creases, from jersey to crumpled cotton, as data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

from clothed_avatars.clothes.wardrobe import Fabric


@dataclass(frozen=True)
class Weave:
    """What decides how one kind of cloth folds.

    Attributes:
        name: As in ``WEAVES``.
        stiffness: Against bending while the cloth is draped.
        fullness: Surplus length along limbs and trunk, as a share of that of a cotton shirt.
        crumple: Surplus in all directions, as a share of the length: creases of wear and storage.
        waves_m: Widths of the folds that are laid at each of three levels, coarse to fine.
        laid: Shares of the surplus that they take up before the cloth is relaxed.
        bending: Against bending at each level, as the share of a bend taken away per step.
    """

    name: str
    stiffness: float
    fullness: float
    crumple: float
    waves_m: tuple[float, float, float]
    laid: tuple[float, float, float]
    bending: tuple[float, float, float]


_SOFT = (0.80, 0.30, 0.0)
_KINDS = (
    Weave("jersey", 1.2, 0.35, 0.0, (0.090, 0.050, 0.030), _SOFT, (0.10, 0.06, 0.05)),
    Weave("knit", 0.8, 0.50, 0.0, (0.110, 0.070, 0.040), _SOFT, (0.12, 0.08, 0.06)),
    Weave("wool", 1.0, 0.70, 0.0, (0.100, 0.060, 0.036), _SOFT, (0.08, 0.05, 0.04)),
    Weave("satin", 0.2, 0.75, 0.0, (0.095, 0.050, 0.030), _SOFT, (0.06, 0.05, 0.04)),
    Weave("twill", 0.5, 0.90, 0.0, (0.085, 0.046, 0.025), _SOFT, (0.06, 0.03, 0.025)),
    Weave("denim", 0.7, 1.00, 0.0, (0.090, 0.050, 0.028), _SOFT, (0.06, 0.035, 0.03)),
    Weave("poplin", 0.3, 1.00, 0.0, (0.080, 0.045, 0.024), _SOFT, (0.05, 0.02, 0.02)),
    Weave(
        "crumpled cotton",
        0.25,
        1.0,
        0.070,
        (0.075, 0.042, 0.022),
        (0.8, 0.4, 0.05),
        (0.05, 0.016, 0.012),
    ),
)

WEAVES: Mapping[str, Weave] = MappingProxyType({weave.name: weave for weave in _KINDS})
"""Every kind of cloth by its name."""


def woven(fabric: Fabric, weave: str) -> Fabric:
    """The fabric, as stiff as the weave of that name."""
    return replace(fabric, stiffness=WEAVES[weave].stiffness)


@dataclass(frozen=True)
class Worn:
    """How one person's clothes crease.

    Attributes:
        top: The top's weave by name.
        bottom: The bottom's weave by name; None under a dress.
        strength: Factor on all surplus lengths, drawn per person.
        revision: Changes whenever the same values give other clothes.
    """

    top: str
    bottom: str | None
    strength: float
    revision: int

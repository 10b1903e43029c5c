"""What a body fit hands to those who build on it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from harness.core.arrays import Mask
from harness.core.artifacts import Body
from harness.core.mesh import Mesh


@dataclass(frozen=True, slots=True)
class FitCost:
    """How the cost of a joint optimisation came down.

    Attributes:
        totals: Total cost at each iteration.
        terms: Mean over views of each unweighted term, at the start and at the end.
        ended: ``converged`` or ``iterations``.
    """

    totals: tuple[float, ...]
    terms: Mapping[str, tuple[float, float]]
    ended: Literal["converged", "iterations"]

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values for a record's reader."""
        return {
            "iterations": len(self.totals),
            "ended": self.ended,
            "cost": [self.totals[0], min(self.totals)] if self.totals else [],
            "terms": {name: list(pair) for name, pair in self.terms.items()},
        }


@dataclass(frozen=True, slots=True, eq=False)
class BodyFitResult:
    """A body fitted to some views of a capture.

    Attributes:
        body: The body, world metres.
        views_used: Indices of the views that it was fitted to, in the capture.
        hands_found: Whether the detector found the left and the right hand in the first of them.
        regions: (V,) masks of the body's vertices: ``left_hand``, ``right_hand``, ``face`` and
            ``eyeballs``.
        views_left_out: Why a view could not be used, by its index.
        depth_is_given: Whether the distance of the subject was known before the fit.
        first_is_regressed: Whether a network made the first body, and not a fit with a prior.
        swapped: Indices of the views whose landmarks had left and right exchanged; None where the
            fit does not look for them.
        cost: Cost of the joint optimisation; None for fits without one.
    """

    body: Body
    views_used: tuple[int, ...]
    hands_found: tuple[bool, bool]
    regions: Mapping[str, Mask]
    views_left_out: Mapping[int, str] = field(default_factory=dict[int, str])
    depth_is_given: bool = False
    first_is_regressed: bool = False
    swapped: tuple[int, ...] | None = None
    cost: FitCost | None = None

    @property
    def skin(self) -> Mesh:
        """The body's surface, world metres."""
        return Mesh(self.body.vertices, self.body.faces, source="fitted body")

    def details(self) -> dict[str, object]:
        """Plain JSON values for a record's reader; nothing is steered by them."""
        details: dict[str, object] = {"views_used": list(self.views_used)}
        if self.views_left_out:
            details["views_left_out"] = {
                str(view): why for view, why in self.views_left_out.items()
            }
        if len(self.views_used) == 1:
            details["depth"] = (
                "held at the subject's given centre"
                if self.depth_is_given
                else "one view cannot tell size from distance: "
                + (
                    "the size of the first body that a network regressed decides"
                    if self.first_is_regressed
                    else "the body model's height prior decides"
                )
            )
        if self.swapped is not None:
            details["swapped_views"] = list(self.swapped)
        if self.cost is not None:
            details["jmbo"] = self.cost.to_dict()
        return details

"""Two normal maps of one view, front and back of a body, to two depth maps that fit together.

ECON's depth-aware silhouette-consistent bilateral normal integration (d-BiNI; Xiu et al., "ECON:
Explicit Clothed humans Optimized via Normal integration", CVPR 2023, section 3.2). Both sheets lie
on the pixel grid of the front camera. They are integrated as one tall map, back below front, with
three terms that a single map lacks: each sheet stays near the body's depth, and the two meet at the
silhouette.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import binary_erosion

from harness.core.arrays import Floats, Mask
from harness.core.errors import DataError
from harness.geometry.window import Window
from methods.surface.bilateral import Anchors, Equations, Schedule, integrate
from methods.surface.integration import (
    checked_intrinsics,
    checked_mask,
    checked_normals,
    focal_length,
    tangent_planes,
)


@dataclass(frozen=True, slots=True)
class FrontBackParameters:
    """What the joint integration is run with; the defaults are the published ones.

    Attributes:
        k: Sharpness of the bilateral weights.
        prior_weight: Weight of a pixel's squared distance to the body, depth in pixels.
        silhouette_weight: Weight of a silhouette pixel's squared front-back gap, depth in pixels.
        thickness: Metres by which the body is inflated towards and away from the viewer; with an
            orthographic view, in the unit of which there are ``pixels_per_unit``.
        pixels_per_unit: Resolution that the two weights are published for. A perspective view has
            its own, at the depth of the body, and the weights are carried over to it, so that the
            same person at twice the resolution gives the same surface.
        cut_intersection: Drop pixels where the front lies behind the back.
        max_iter: Most rounds of reweighting.
        tol: Relative change of energy that ends them.
    """

    k: float = 4.0
    prior_weight: float = 1e-4
    silhouette_weight: float = 1e-6
    thickness: float = 0.02
    pixels_per_unit: float = 256.0
    cut_intersection: bool = True
    max_iter: int = 150
    tol: float = 1e-4

    def __post_init__(self) -> None:
        positive = min(self.k, self.prior_weight, self.pixels_per_unit, self.tol) > 0
        if not positive or min(self.silhouette_weight, self.thickness) < 0 or self.max_iter < 1:
            raise DataError(
                "front and back cannot be integrated with these parameters",
                expected="positive k, prior_weight, pixels_per_unit, tol; max_iter at least 1",
                got=str(self),
            )


@dataclass(frozen=True, slots=True, eq=False)
class BodyDepth:
    """Depth (H, W) of the body's front and back surface, NaN where the ray misses the body.

    In metres along the optical axis for a perspective view, in pixels for an orthographic one;
    growing away from the viewer in both. Not inflated: ``thickness`` is a parameter.
    """

    front: ArrayLike
    back: ArrayLike


@dataclass(frozen=True, slots=True, eq=False)
class FrontBackDepth:
    """Two depth maps of one view.

    Attributes:
        front: (H, W) depth of the front, in the unit of the prior, NaN outside the mask.
        back: (H, W) depth of the back.
        pixels_cut: How many pixels of the mask were dropped because the front lay behind the back.
        energies: Energy after each round.
    """

    front: Floats
    back: Floats
    pixels_cut: int
    energies: list[float]


def integrate_front_back(
    normals: tuple[ArrayLike, ArrayLike],
    mask: ArrayLike,
    prior: BodyDepth,
    K: ArrayLike | None = None,
    parameters: FrontBackParameters | None = None,
    device: str = "cpu",
) -> FrontBackDepth:
    """Front and back depth maps with the given normals, near the body, closed at the silhouette.

    Args:
        normals: Front and back (H, W, 3) unit normals in the front view's frame: x right, y up, z
            towards the viewer, so that z is negative on the back.
        mask: (H, W) boolean or integer silhouette of the clothed person, shared by both sheets.
        prior: The body's front and back depth.
        K: (3, 3) intrinsics in pixels for a perspective view, None for an orthographic one.
        parameters: Weights and stopping rule; None takes the published ones.
        device: "cpu", or the torch device that solves the linear systems, such as "cuda".

    A part of the mask without any body behind it is carried by the overall offset of its sheet
    alone: its depth is a guess, its shape is not.

    Raises:
        DataError: as ``integrate_normals``; no body inside the mask; a body behind the camera.
        MissingPart: this machine has no such device.
    """
    parameters = parameters or FrontBackParameters()
    mask = checked_mask(mask)
    front = checked_normals(normals[0], mask, "front normal map")
    back = checked_normals(normals[1], mask, "back normal map")
    intrinsics = None if K is None else checked_intrinsics(K)
    space = _DepthSpace.around(_inflated(prior, mask, parameters, intrinsics), intrinsics)

    window = Window.around(mask).slices
    origin = (window[0].start, window[1].start)
    link_rows = _odd_above(mask[window].shape[0])
    both = [
        tangent_planes(side[window], mask[window], origin, intrinsics) for side in (front, back)
    ]
    equations = Equations(
        inside=_stacked([side.inside for side in both], link_rows),
        facing_x=_stacked([side.facing_x for side in both], link_rows),
        facing_y=_stacked([side.facing_y for side in both], link_rows),
        slope_x=_stacked([side.slope_x for side in both], link_rows),
        slope_y=_stacked([side.slope_y for side in both], link_rows),
    )
    anchors = _anchors(space, mask, window, link_rows, parameters)
    schedule = Schedule(parameters.k, parameters.max_iter, parameters.tol, device)
    values, energies = integrate(equations, schedule, anchors)
    sheets = [space.to_depth(sheet) for sheet in _unstacked(values, mask, window, link_rows)]
    return _finished(sheets, mask, parameters.cut_intersection, energies)


@dataclass(frozen=True, slots=True)
class _DepthSpace:
    """The prior in the unknown of the integration: pixels of depth around ``centre``.

    ``resolution`` is pixels per unit of depth, None where depth is in pixels already.
    """

    front: Floats
    back: Floats
    centre: float
    focal: float | None
    resolution: float | None

    @classmethod
    def around(cls, depths: tuple[Floats, Floats], K: Floats | None) -> _DepthSpace:
        if K is None:
            centre = float(np.nanmean(np.stack(depths)))
            return cls(depths[0] - centre, depths[1] - centre, centre, None, None)
        focal = focal_length(K)
        logs = [focal * np.log(depth) for depth in depths]
        centre = float(np.nanmean(np.stack(logs)))
        resolution = focal / np.exp(centre / focal)
        return cls(logs[0] - centre, logs[1] - centre, centre, focal, float(resolution))

    def to_depth(self, values: Floats) -> Floats:
        if self.focal is None:
            return values + self.centre
        return np.exp((values + self.centre) / self.focal)


def _inflated(
    prior: BodyDepth, mask: Mask, parameters: FrontBackParameters, K: Floats | None
) -> tuple[Floats, Floats]:
    """The prior's two depths, moved apart by the thickness, NaN outside the mask."""
    thickness = parameters.thickness * (parameters.pixels_per_unit if K is None else 1.0)
    depths = []
    for name, given, sign in (("front", prior.front, -1), ("back", prior.back, 1)):
        depth = np.asarray(given, dtype=np.float64)
        if depth.shape != mask.shape:
            raise DataError(
                f"the body's {name} depth does not match the mask",
                expected=str(mask.shape),
                got=str(depth.shape),
            )
        known = mask & np.isfinite(depth)
        if not known.any():
            raise DataError(
                f"the body's {name} depth has no pixel inside the mask",
                expected="finite depth where body and silhouette overlap",
                got=f"{int(np.isfinite(depth).sum())} finite pixels, all outside",
                hint="Look at the fitted body over the photo",
            )
        inflated = np.where(known, depth + sign * thickness, np.nan)
        if K is not None and np.nanmin(inflated) <= 0:
            raise DataError(
                f"the body's {name} depth is not in front of the camera",
                expected="metres along the optical axis, positive",
                got=f"{np.nanmin(inflated):.3f} after inflation by {thickness} m",
            )
        depths.append(inflated)
    return depths[0], depths[1]


def _anchors(
    space: _DepthSpace,
    mask: Mask,
    window: tuple[slice, slice],
    link_rows: int,
    parameters: FrontBackParameters,
) -> Anchors:
    """The prior and silhouette terms on the stacked grid."""
    carried = 1.0
    if space.resolution is not None:
        # The data term counts pixels and these terms pixels times squared depth in pixels.
        carried = (parameters.pixels_per_unit / space.resolution) ** 2
    priors = [space.front[window], space.back[window]]
    known = [np.isfinite(side) * (parameters.prior_weight * carried) for side in priors]
    rim = mask & np.logical_not(binary_erosion(mask))
    link = rim[window] * (parameters.silhouette_weight * carried)
    return Anchors(
        prior=_stacked([np.nan_to_num(side) for side in priors], link_rows),
        prior_weight=_stacked(known, link_rows),
        link_weight=_stacked([link, np.zeros_like(link)], link_rows),
        link_rows=link_rows,
    )


def _odd_above(rows: int) -> int:
    """The least odd number of rows that keeps a blank one between the sheets."""
    return rows + 1 + rows % 2


def _stacked(sides: list[NDArray[Any]], link_rows: int) -> NDArray[Any]:
    """Front above back, the back's rows beginning at ``link_rows``; odd columns, even rows."""
    height, width = sides[0].shape
    tall = np.zeros((2 * link_rows, width + 1 - width % 2), dtype=sides[0].dtype)
    tall[:height, :width] = sides[0]
    tall[link_rows : link_rows + height, :width] = sides[1]
    return tall


def _unstacked(
    values: Floats, mask: Mask, window: tuple[slice, slice], link_rows: int
) -> tuple[Floats, Floats]:
    """The two sheets of a stacked grid in the full image, NaN outside the mask."""
    height, width = mask[window].shape
    sheets = []
    for start in (0, link_rows):
        sheet = np.full(mask.shape, np.nan)
        sheet[window] = values[start : start + height, :width]
        sheet[~mask] = np.nan
        sheets.append(sheet)
    return sheets[0], sheets[1]


def _finished(
    sheets: list[Floats], mask: Mask, cut_intersection: bool, energies: list[float]
) -> FrontBackDepth:
    front, back = sheets
    result = FrontBackDepth(front, back, 0, energies)
    if not cut_intersection:
        return result
    crossed = mask & (front >= back)
    return replace(
        result,
        front=np.where(crossed, np.nan, front),
        back=np.where(crossed, np.nan, back),
        pixels_cut=int(crossed.sum()),
    )

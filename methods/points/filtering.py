"""Which pixels of aligned depth maps become points; every step says what it kept."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from harness.core.arrays import Floats, Ints, Mask
from harness.core.camera import Camera
from harness.core.errors import MethodError
from harness.core.settings import check_choice, check_range
from methods.points.cloud import ALIGNMENTS, OrientedPoints

#: Determinant of the window's spread of pixels, px^4, below which they are on one line.
_ON_ONE_LINE = 1e-3


def grid_normals(depth: Floats, mask: Mask, camera: Camera, radius_px: int) -> Floats:
    """(H, W, 3) unit world normals towards the camera; 0 where they cannot be told.

    The inverse depth of a plane is linear over a picture, its depth over an orthographic one. In
    the window around each pixel that
    linear function is fitted to the pixels of the mask, and the plane's normal follows: exact for
    planes at any angle, and of the least squares where depth is noisy.

    Args:
        depth: (H, W) along the optical axis, positive inside the mask.
        mask: (H, W) which pixels count.
        camera: Camera of these pixels.
        radius_px: Half the window; 1 takes 3 x 3 pixels.
    """
    from scipy.ndimage import uniform_filter

    normals = np.zeros((*depth.shape, 3))
    if not mask.any():
        return normals
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    window = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    inside = mask[window].astype(np.float64)
    inverse = np.where(mask[window], 1.0 / np.where(mask[window], depth[window], 1.0), 0.0)
    if camera.is_orthographic:
        inverse = np.where(mask[window], depth[window], 0.0)
    # From the window's own corner: squares of small numbers lose fewer digits.
    v, u = np.indices(inside.shape, dtype=np.float64)

    def mean(values: Floats) -> Floats:
        found = uniform_filter(inside * values, 2 * radius_px + 1, mode="constant")
        return np.asarray(found)

    share = np.maximum(mean(np.ones_like(inside)), 1e-9)
    mu, mv, mw = mean(u) / share, mean(v) / share, mean(inverse) / share
    uu, vv = mean(u * u) / share - mu * mu, mean(v * v) / share - mv * mv
    uv = mean(u * v) / share - mu * mv
    uw, vw = mean(u * inverse) / share - mu * mw, mean(v * inverse) / share - mv * mw
    spread = uu * vv - uv * uv
    good = (spread > _ON_ONE_LINE) & mask[window]
    safe = np.where(good, spread, 1.0)
    across, down = (vv * uw - uv * vw) / safe, (uu * vw - uv * uw) / safe
    at_corner = mw - across * (mu + columns[0] + 0.5) - down * (mv + rows[0] + 0.5)
    # 1 / z = n . K^-1 (x, y, 1) / d, so the fitted plane is K^-T n / d.
    in_camera = -np.stack([across, down, at_corner], axis=-1) @ camera.K
    if camera.is_orthographic:
        in_camera = np.concatenate(
            [-in_camera[..., :2], np.full((*across.shape, 1), -1.0)], axis=-1
        )
    length = np.linalg.norm(in_camera, axis=-1, keepdims=True)
    good &= length[..., 0] > 0
    in_camera = np.where(good[..., None], in_camera / np.maximum(length, 1e-300), 0.0)
    normals[window] = in_camera @ camera.rotation
    return normals


@dataclass(frozen=True, slots=True)
class AlignSettings:
    """How a source's world becomes the harness's.

    Attributes:
        mode: One of ``ALIGNMENTS``; it is printed in the method's title.
    """

    mode: str = "sim3_cameras"

    def __post_init__(self) -> None:
        check_choice("mode", self.mode, ALIGNMENTS)


@dataclass(frozen=True, slots=True)
class KeepSettings:
    """Which pixels of the depth maps become points, in the order of the steps.

    Attributes:
        erode_px: The mask loses so many pixels of the picture at its rim, where depth maps run over
            from the subject to the background.
        edge: A pixel goes whose depth differs from a neighbour's by more than this share of it:
            3 cm at 3 m, which a surface has only where it is seen at less than 8 degrees.
        drop_share: So many of a view's least confident pixels go; 0.2 is what VGGT's author
            advises. A source without confidences loses none.
        consistency_m: A point goes where more views contradict it than confirm it: where it is
            beside their mask, or before their surface by more than this. 0 turns the step off.
        outlier_neighbours: A point is compared with so many nearest ones.
        outlier_spacing: It goes where its mean distance to them is above so many times the distance
            of neighbouring pixels on a surface like its own. 0 turns the step off. The usual rule,
            a distance far above the mean of all, takes what only one view sees: on an avatar's
            true depth it made hands 2.6 mm worse instead of 0.3.
        normal_px: Half the window in which a pixel's normal is fitted.
    """

    erode_px: int = 1
    edge: float = 0.01
    drop_share: float = 0.2
    consistency_m: float = 0.02
    outlier_neighbours: int = 16
    outlier_spacing: float = 4.0
    normal_px: int = 2

    def __post_init__(self) -> None:
        check_range("erode_px", self.erode_px, 0, 50)
        check_range("edge", self.edge, 1e-4, 10.0)
        check_range("drop_share", self.drop_share, 0.0, 0.95)
        check_range("consistency_m", self.consistency_m, 0.0, 10.0)
        check_range("outlier_neighbours", self.outlier_neighbours, 2, 200)
        check_range("outlier_spacing", self.outlier_spacing, 0.0, 1000.0)
        check_range("normal_px", self.normal_px, 1, 20)


@dataclass(frozen=True, slots=True)
class MeshSettings:
    """How points become a surface.

    Attributes:
        cell_m: Points that face the same way are averaged in cells of this size; 0 keeps all.
        depth: Depth of the octree of the screened Poisson reconstruction; at 9 a finest cell is
            4.4 mm on a standing adult.
        silhouettes: ``held`` presses what bulges beyond a mask back to its outline; ``ignored`` is
            the plain way.
        trim: The surface loses this share of its vertices, those with the fewest points around. It
            is open then; 0 leaves it closed. With ``--keep`` both are written.
    """

    cell_m: float = 0.002
    depth: int = 9
    silhouettes: str = "ignored"
    trim: float = 0.0

    def __post_init__(self) -> None:
        check_range("cell_m", self.cell_m, 0.0, 0.1)
        check_range("depth", self.depth, 4, 12)
        check_choice("silhouettes", self.silhouettes, ("ignored", "held"))
        check_range("trim", self.trim, 0.0, 0.9)


@dataclass(frozen=True, slots=True)
class SurfaceRooms:
    """The settings of the steps, by room."""

    align: AlignSettings = field(default_factory=AlignSettings)
    keep: KeepSettings = field(default_factory=KeepSettings)
    mesh: MeshSettings = field(default_factory=MeshSettings)

    @classmethod
    def of(cls, parameters: Mapping[str, Mapping[str, object]]) -> SurfaceRooms:
        """Those among a method's parameters; the defaults where it has none."""
        kinds = {"align": AlignSettings, "keep": KeepSettings, "mesh": MeshSettings}
        return cls(
            **{name: kinds[name](**parameters[name]) for name in kinds if name in parameters}
        )


#: The mask holds pixels that the subject covers at least half of.
_COVERED = 0.5
#: Flatter angles do not make pixels' points any further apart: depth edges are cut by then.
_LEAST_FACING = 0.2


@dataclass(frozen=True, slots=True, eq=False)
class WorldDepth:
    """A view's depth in the world's metres.

    Attributes:
        camera: Camera of these pixels, world metres.
        depth: (H, W) metres along the optical axis; not finite or not positive where unknown.
        coverage: (H, W) how much of each pixel the subject covers, 0 to 1.
        confidence: (H, W), larger is better; None where the source has none.
    """

    camera: Camera
    depth: Floats
    coverage: Floats
    confidence: Floats | None = None

    @property
    def covered(self) -> Mask:
        """(H, W) the mask."""
        return self.coverage >= _COVERED


@dataclass(frozen=True, slots=True, eq=False)
class Kept:
    """The points that are left.

    Attributes:
        points: Oriented, world metres.
        shares: By step, in order, which share of the points before it each step kept.
        by_view: Share of each view's covered pixels that are points in the end.
    """

    points: OrientedPoints
    shares: Mapping[str, float]
    by_view: tuple[float, ...]

    def details(self) -> dict[str, object]:
        """What a record says of it."""
        return {
            "points": len(self.points),
            "kept_shares": {name: round(share, 4) for name, share in self.shares.items()},
            "kept_by_view": [round(share, 4) for share in self.by_view],
        }


def kept_points(views: Sequence[WorldDepth], settings: KeepSettings) -> Kept:
    """The points of all views that pass every step, with normals.

    The steps: ``mask`` (eroded, depth known), ``edges``, ``confidence``, ``consistency`` of the
    views, ``normals`` (those that can be told), ``outliers``. Shares of the first step are of the
    pixels that the subject covers.

    Raises:
        MethodError: a step leaves nothing.
    """
    steps = {
        "mask": [_masked(view, settings.erode_px) for view in views],
    }
    steps["edges"] = [
        before & _away_from_edges(view.depth, before, settings.edge)
        for view, before in zip(views, steps["mask"], strict=True)
    ]
    steps["confidence"] = [
        _confident(view, before, settings.drop_share)
        for view, before in zip(views, steps["edges"], strict=True)
    ]
    steps["consistency"] = _consistent(views, steps["confidence"], settings.consistency_m)
    normals = [
        grid_normals(view.depth, mask, view.camera, settings.normal_px)
        for view, mask in zip(views, steps["consistency"], strict=True)
    ]
    steps["normals"] = [
        mask & np.any(found != 0, axis=-1)
        for found, mask in zip(normals, steps["consistency"], strict=True)
    ]
    shares = _shares(views, steps)
    points = [
        OrientedPoints(_world(view, mask), found[mask])
        for view, found, mask in zip(views, normals, steps["normals"], strict=True)
    ]
    joined = OrientedPoints.joined(points)
    spacing = np.concatenate(
        [
            _spacing_m(view, each.positions, each.normals)
            for view, each in zip(views, points, strict=True)
        ]
    )
    keep = _near_others(joined.positions, spacing, settings)
    shares["outliers"] = float(keep.mean()) if len(keep) else 0.0
    refuse_nothing(shares)
    owner = np.repeat(np.arange(len(views)), [len(each) for each in points])
    left = np.bincount(owner[keep], minlength=len(views))
    covered = [max(1, int(view.covered.sum())) for view in views]
    by_view = tuple(float(n) / of for n, of in zip(left, covered, strict=True))
    return Kept(joined.chosen(keep), shares, by_view)


def _shares(views: Sequence[WorldDepth], steps: Mapping[str, Sequence[Mask]]) -> dict[str, float]:
    before = sum(int(view.covered.sum()) for view in views)
    shares: dict[str, float] = {}
    for name, masks in steps.items():
        now = sum(int(mask.sum()) for mask in masks)
        shares[name] = now / max(1, before)
        before = now
    return shares


def refuse_nothing(shares: Mapping[str, float]) -> None:
    """Nothing, if every step kept some.

    Raises:
        MethodError: one did not; with what each kept.
    """
    empty = next((name for name, share in shares.items() if share == 0.0), None)
    if empty is not None:
        raise MethodError(
            f"no point is left after the step '{empty}'",
            expected="points on the subject",
            got=", ".join(f"{name} kept {share:.1%}" for name, share in shares.items()),
            hint="Look at the depth maps with --keep, or loosen the settings of 'keep'",
        )


def _masked(view: WorldDepth, erode_px: int) -> Mask:
    from scipy.ndimage import binary_erosion

    mask = view.covered
    if erode_px and mask.any():
        # Beyond the frame the subject goes on: there is no rim.
        mask = np.asarray(binary_erosion(mask, iterations=erode_px, border_value=1), dtype=bool)
    known = np.isfinite(view.depth) & (np.nan_to_num(view.depth) > 0)
    return mask & known


def _away_from_edges(depth: Floats, mask: Mask, edge: float) -> Mask:
    """(H, W) pixels whose depth is about that of all their neighbours in the mask."""
    smooth = np.ones_like(mask)
    for axis in (0, 1):
        near, far = _beside(axis)
        both = mask[near] & mask[far]
        least = np.minimum(np.where(both, depth[near], 1.0), np.where(both, depth[far], 1.0))
        apart = np.abs(np.where(both, depth[near], 0.0) - np.where(both, depth[far], 0.0))
        jump = both & (apart > edge * least)
        smooth[near] &= ~jump
        smooth[far] &= ~jump
    return smooth


def _beside(axis: int) -> tuple[tuple[slice, ...], tuple[slice, ...]]:
    """Index of all pixels but the last, and of all but the first, along an axis."""
    first, second = [slice(None), slice(None)], [slice(None), slice(None)]
    first[axis], second[axis] = slice(None, -1), slice(1, None)
    return tuple(first), tuple(second)


def _confident(view: WorldDepth, mask: Mask, drop_share: float) -> Mask:
    if view.confidence is None or drop_share == 0 or not mask.any():
        return mask
    with np.errstate(invalid="ignore"):
        known = mask & np.isfinite(view.confidence)
        if not known.any():
            return known
        # Ranked and not compared with a limit: where most pixels are equally sure, none of them go.
        least = np.quantile(view.confidence[known], drop_share)
        return known & (view.confidence >= least)


def _world(view: WorldDepth, mask: Mask) -> Floats:
    rows, columns = np.nonzero(mask)
    pixels = np.stack([columns + 0.5, rows + 0.5], axis=1)
    return view.camera.unproject(pixels, view.depth[mask])


def _consistent(
    views: Sequence[WorldDepth], masks: Sequence[Mask], tolerance_m: float
) -> list[Mask]:
    """The points that at least as many other views confirm as contradict."""
    if tolerance_m == 0:
        return list(masks)
    known = [
        replace(view, depth=np.where(m, view.depth, np.nan))
        for view, m in zip(views, masks, strict=True)
    ]
    found: list[Mask] = []
    for index, (view, mask) in enumerate(zip(views, masks, strict=True)):
        points = _world(view, mask)
        votes = np.zeros(len(points), dtype=np.int64)
        for number, other in enumerate(known):
            if number != index:
                votes += _votes(points, other, tolerance_m)
        keep = mask.copy()
        keep[mask] = votes >= 0
        found.append(keep)
    return found


def _votes(points: Floats, other: WorldDepth, tolerance_m: float) -> Ints:
    """(N,) 1 where another view has the point on its surface, -1 where it sees through it."""
    pixels, depth = other.camera.project(points)
    with np.errstate(invalid="ignore"):  # behind the camera: NaN, so not in the frame
        framed = ((pixels >= 0) & (pixels < other.camera.size)).all(axis=1)
    columns, rows = pixels[framed].astype(np.int64).T
    theirs = other.depth[rows, columns]
    apart = depth[framed] - theirs
    with np.errstate(invalid="ignore"):  # unknown depth says nothing
        said = np.where(np.abs(apart) <= tolerance_m, 1, np.where(apart < -tolerance_m, -1, 0))
    said[~(other.coverage[rows, columns] > 0)] = -1
    votes = np.zeros(len(points), dtype=np.int64)
    votes[framed] = said
    return votes


def _spacing_m(view: WorldDepth, points: Floats, normals: Floats) -> Floats:
    """(N,) how far the next pixel's point is on a surface like a point's own, metres."""
    sight = points - view.camera.eye_of(points)
    depth = sight @ view.camera.forward
    cosine = -np.einsum("ij,ij->i", sight, normals) / np.maximum(
        np.linalg.norm(sight, axis=1), 1e-9
    )
    return view.camera.spread(depth) / view.camera.K[0, 0] / np.maximum(cosine, _LEAST_FACING)


def _near_others(points: Floats, spacing_m: Floats, settings: KeepSettings) -> Mask:
    from scipy.spatial import KDTree

    count = settings.outlier_neighbours
    if settings.outlier_spacing == 0 or len(points) <= count + 1:
        return np.ones(len(points), dtype=bool)
    distance = KDTree(points).query(points, k=count + 1, workers=-1)[0][:, 1:].mean(axis=1)
    return np.asarray(distance <= settings.outlier_spacing * spacing_m)

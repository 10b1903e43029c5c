"""Folds in degrees: how far the normals of a map stray from their own blur.

A body bends slowly and cloth folds quickly. A Gaussian of 15 mm keeps what is slow, and the angle
between a normal and the blurred one measures what is quick: 0 on a plane, 2 to 3 degrees on a bare
body, 7 on smooth jersey, 12 to 14 on a jacket with trousers, 18 on crumpled cotton.
"""

from dataclasses import dataclass

import numpy as np

from harness.core.arrays import Floats, Mask
from harness.core.camera import Camera, look_at
from harness.core.errors import DataError
from harness.core.mesh import Mesh
from harness.core.records import FoldErrors
from harness.geometry.raycast import Raycaster
from metrics.normals import angles_deg

BLUR_M = 0.015
"""Standard deviation of the blur."""
MARGIN_M = 0.030
"""Pixels nearer to the mask's border do not count: the blur there knows one side only."""
PIXEL_M = 0.004
"""Finer maps are brought to about this first, so that maps of all sizes measure the same folds."""

_COARSEST_M = 2 * PIXEL_M
_FAR_M = 40.0
"""Distance of the camera that photographs a mesh; perspective changes nothing from there."""
_RIM_PX = 4


@dataclass(frozen=True, slots=True)
class FoldStrength:
    """Mean, median and 90th percentile of the angles over ``n`` pixels, degrees."""

    mean_deg: float
    median_deg: float
    p90_deg: float
    n: int


@dataclass(frozen=True, slots=True)
class _Split:
    """A map of about 4 mm a pixel: unit normals, their blur, and which pixels count."""

    normals: Floats
    smooth: Floats
    counted: Mask

    def angles_deg(self) -> Floats:
        """(N,) between normals and their blur, where pixels count."""
        return angles_deg(self.normals[self.counted], self.smooth[self.counted])


def _coarser(normals: Floats, mask: Mask, times: int) -> tuple[Floats, Mask]:
    """Mean normals of blocks of ``times`` by ``times`` pixels that the mask covers wholly."""
    height, width = (size // times * times for size in mask.shape)
    blocks = (height // times, times, width // times, times)
    inside: Mask = np.all(mask[:height, :width].reshape(blocks), axis=(1, 3), keepdims=True)
    inside = inside.reshape(blocks[0], blocks[2])
    means = normals[:height, :width].reshape(*blocks, 3).mean(axis=(1, 3))
    return means * inside[..., None], inside


def _unit(vectors: Floats) -> Floats:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)


def _split(normals: Floats, mask: Mask, pixel_m: float) -> _Split:
    from scipy.ndimage import distance_transform_edt, gaussian_filter

    if normals.shape != (*mask.shape, 3):
        raise DataError(
            "folds cannot be measured: normals and mask have different shapes",
            expected=f"{(*mask.shape, 3)}, as the mask",
            got=f"{normals.shape}",
        )
    if not 0 < pixel_m <= _COARSEST_M:
        raise DataError(
            "folds cannot be measured: the map is too coarse",
            expected=f"at most {1000 * _COARSEST_M:.0f} mm a pixel",
            got=f"{1000 * pixel_m:.1f} mm",
        )
    times = max(1, round(PIXEL_M / pixel_m))
    fine = np.where(mask[..., None], normals, 0.0)
    if times > 1:
        fine, mask = _coarser(fine, mask, times)
    size_m = pixel_m * times
    sharp = _unit(fine)
    # Outside the mask all is 0, so what is outside does not pull; the length is of no account.
    smooth = [gaussian_filter(sharp[..., k], BLUR_M / size_m, mode="constant") for k in range(3)]
    depth = np.asarray(distance_transform_edt(np.pad(mask, 1)))[1:-1, 1:-1] * size_m
    return _Split(sharp, _unit(np.stack(smooth, axis=-1)), depth >= MARGIN_M)


def fold_angles_deg(normals: Floats, mask: Mask, pixel_m: float) -> Floats:
    """(H', W') angles between normals and their blur, degrees; NaN within 30 mm of the mask's edge.

    normals (H, W, 3) of any length, mask (H, W), pixel_m the size of a pixel on the subject in
    metres. A map finer than 4 mm a pixel comes back as many times smaller as brings it there.

    Raises:
        DataError: shapes that do not fit, or a map coarser than 8 mm a pixel.
    """
    split = _split(normals, mask, pixel_m)
    out = np.full(split.counted.shape, np.nan)
    out[split.counted] = split.angles_deg()
    return out


def fold_strength(normals: Floats, mask: Mask, pixel_m: float) -> FoldStrength:
    """The fold strength of a map; arguments and errors as in ``fold_angles_deg``.

    Raises:
        DataError: also if no pixel is 30 mm inside the mask.
    """
    angles = fold_angles_deg(normals, mask, pixel_m)
    known = angles[np.isfinite(angles)]
    if not len(known):
        raise DataError(
            "folds cannot be measured: the subject is too small in the map",
            expected=f"pixels at least {1000 * MARGIN_M:.0f} mm inside the mask",
            got="none",
        )
    return FoldStrength(
        mean_deg=float(known.mean()),
        median_deg=float(np.median(known)),
        p90_deg=float(np.percentile(known, 90)),
        n=len(known),
    )


def fold_correlation(predicted: Floats, truth: Floats, mask: Mask, pixel_m: float) -> float:
    """How well the folds of two maps agree: 1 the same but for their size, 0 unrelated.

    The cosine between what the blur takes away from either map, as vectors over all pixels that
    count. 0 if one of the maps has no folds. Arguments as in ``fold_angles_deg``.
    """
    return _correlation(*(_split(normals, mask, pixel_m) for normals in (predicted, truth)))


def _correlation(first: _Split, second: _Split) -> float:
    quick = [(s.normals - s.smooth)[s.counted].ravel() for s in (first, second)]
    lengths = np.linalg.norm(quick[0]) * np.linalg.norm(quick[1])
    return float(quick[0] @ quick[1] / lengths) if lengths > 0 else 0.0


def fold_errors(estimate: Floats, truth: Floats, mask: Mask, pixel_m: float) -> FoldErrors | None:
    """The fold strengths of two maps and their correlation; arguments as in ``fold_angles_deg``.

    None where a pixel is larger than 8 mm, or no pixel is 30 mm inside the mask: such maps cannot
    tell.
    """
    if pixel_m > _COARSEST_M:
        return None
    found, true = (_split(normals, mask, pixel_m) for normals in (estimate, truth))
    if not found.counted.any():
        return None
    return FoldErrors(
        estimate_deg=float(found.angles_deg().mean()),
        truth_deg=float(true.angles_deg().mean()),
        correlation=_correlation(found, true),
    )


def pixel_size_m(camera: Camera, place: Floats) -> float:
    """Size in metres of a pixel of a camera at a place (3,) in the world."""
    return float(camera.spread(np.linalg.norm(camera.position - place)) / camera.K[0, 0])


def true_normals(mesh: Mesh, yaw_deg: float = 0.0) -> tuple[Floats, Mask]:
    """Normals (H, W, 3) of a mesh (+Y up) in the camera's frame, and its mask, 4 mm a pixel.

    Seen from far away at a yaw in degrees: 0 looks at the front (+Z), 180 at the back.
    """
    low, high = mesh.bounds
    middle = 0.5 * (low + high)
    turn = np.radians(yaw_deg)
    eye = middle + _FAR_M * np.array([np.sin(turn), 0.0, np.cos(turn)])
    reach = 0.5 * float(np.hypot(high[0] - low[0], high[2] - low[2]))
    half = np.ceil(np.array([reach, 0.5 * (high[1] - low[1])]) / PIXEL_M).astype(int) + _RIM_PX
    focal = _FAR_M / PIXEL_M
    K = np.array([[focal, 0, half[0]], [0, focal, half[1]], [0, 0, 1]], float)
    camera = Camera(K, look_at(eye, middle), 2 * int(half[0]), 2 * int(half[1]))
    caster = Raycaster(mesh)
    hits = caster.cast(camera)
    return caster.normals_at(hits, camera, "camera"), hits.mask

"""Closed-form surfaces, the field's benchmark, and the errors of ``integrate_normals``."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from harness.core.errors import DataError
from methods.surface import integrate_normals
from tests.plain_integration import plain_integration

DILIGENT = Path(__file__).resolve().parents[5] / "shared" / "data" / "diligent"

# Mean absolute depth error of the field's reference solver with the same k, max_iter and tol, which
# counts pixels from 0 at the top-left centre; given to a thousandth of a millimetre.
REFERENCE_MM = {"bear": 0.334, "cat": 0.074}
HALF_A_DIGIT_MM = 0.0005


def aligned_error(depth, truth, where, perspective):
    """Absolute depth error at ``where`` after taking out what normals cannot tell."""
    if perspective:
        return np.abs(depth * np.median(truth[where] / depth[where]) - truth)[where]
    return np.abs(depth - truth - np.median((depth - truth)[where]))[where]


@pytest.mark.parametrize("perspective", [False, True])
def test_sphere(perspective, camera_matrix, ellipsoid) -> None:
    size = 256
    K = camera_matrix(size, 2.0) if perspective else None
    centre, radius = ((0, 0.05, 3), 0.6) if perspective else ((128, 126, 0), 115)
    near, _ = ellipsoid(size, centre, (radius,) * 3, K)
    depth = integrate_normals(near.normals, near.mask, K)
    # Towards the rim a step of one pixel is many pixels deep; that is where depth jumps.
    error = aligned_error(depth, near.depth, near.facing > 0.3, perspective)
    assert error.max() < 1e-3 * 2 * radius
    np.testing.assert_array_equal(np.isnan(depth), ~near.mask)


@pytest.mark.parametrize("perspective", [False, True])
def test_plane(perspective, camera_matrix) -> None:
    size = 120
    K = camera_matrix(size, 1.5) if perspective else None
    normal = np.array([0.3, -0.5, 0.8]) / np.linalg.norm([0.3, -0.5, 0.8])
    y, x = np.mgrid[:size, :size] + 0.5
    towards = normal * (1, -1, -1)  # the camera's x right, y down, z forward
    if perspective:
        rays = np.stack([(x - K[0, 2]) / K[0, 0], (y - K[1, 2]) / K[1, 1], np.ones_like(x)])
        truth = 2.0 * towards[2] / np.einsum("i,ijk->jk", towards, rays)
    else:
        truth = -(towards[0] * x + towards[1] * y) / towards[2]
    mask = np.ones((size, size), dtype=bool)
    depth = integrate_normals(np.broadcast_to(normal, (size, size, 3)), mask, K)
    error = aligned_error(depth, truth, mask, perspective)
    assert error.max() < 1e-3 * np.ptp(truth)


@pytest.mark.parametrize("perspective", [False, True])
def test_step(perspective, camera_matrix, log_relief) -> None:
    """A slit: to its right the surface rises by a tenth of the size, and dies out further on."""
    size = 192
    height = 0.1 * size
    K = camera_matrix(size, 2.0) if perspective else None
    y, x = np.mgrid[:size, :size] + 0.5
    along = np.clip((y / size - 0.25) / 0.5, 0, 1)
    across = np.clip((x - size / 2) / (0.35 * size), 0, 1)
    right = x > size / 2
    along_slope = np.where((along > 0) & (along < 1), np.cos(np.pi * along) * np.pi / 0.5, 0) / size
    across_slope = -np.sin(np.pi * across) * np.pi / 2 / (0.35 * size)
    ridge, fall = np.sin(np.pi * along), np.cos(np.pi * across / 2) ** 2
    relief = -height * right * ridge * fall
    slopes = (
        -height * right * ridge * across_slope,
        -height * right * along_slope * fall,
    )
    view = log_relief(relief, *slopes, K)
    depth = integrate_normals(view.normals, view.mask, K, k=10.0)
    flat = np.sqrt(K[0, 0] * K[1, 1]) * np.log(depth) if perspective else depth
    near_slit = (np.abs(x - size / 2) < 4) & (np.abs(y - size / 2) < size / 4 + 4)
    assert aligned_error(flat, relief, ~near_slit, False).max() < 1e-3 * size
    middle = size // 2
    assert flat[middle, middle - 1] - flat[middle, middle] == pytest.approx(height, rel=0.01)


def test_depth_grows_away_from_the_viewer(ellipsoid) -> None:
    near, _ = ellipsoid(64, (32, 32, 0), (28, 28, 28), None)
    depth = integrate_normals(near.normals, near.mask)
    assert depth[32, 32] < depth[32, 8]


def test_scale_of_focal_length_and_pixels_is_consistent(camera_matrix, ellipsoid) -> None:
    """Twice the resolution is the same surface."""
    coarse, _ = ellipsoid(128, (0, 0, 3.0), (0.5, 0.6, 0.4), camera_matrix(128, 2.0))
    fine, _ = ellipsoid(256, (0, 0, 3.0), (0.5, 0.6, 0.4), camera_matrix(256, 2.0))
    one = integrate_normals(coarse.normals, coarse.mask, camera_matrix(128, 2.0))
    two = integrate_normals(fine.normals, fine.mask, camera_matrix(256, 2.0))
    two = two.reshape(128, 2, 128, 2).mean(axis=(1, 3))
    both = np.isfinite(one) & np.isfinite(two) & (coarse.facing > 0.5)
    ratio = two[both] / one[both]
    assert np.ptp(ratio) < 2e-3


@pytest.mark.parametrize("perspective", [False, True])
def test_parts_that_do_not_touch_have_their_own_mean(perspective, camera_matrix, ellipsoid) -> None:
    size = 96
    K = camera_matrix(size, 2.0) if perspective else None
    centre, radii = ((0, 0, 3), (0.6, 0.5, 0.4)) if perspective else ((48, 48, 0), (40, 40, 40))
    near, _ = ellipsoid(size, centre, radii, K)
    mask = near.mask.copy()
    mask[:, 47:50] = False
    mask[2, 2] = True  # a part of one pixel
    normals = near.normals.copy()
    normals[2, 2] = (0, 0, 1)
    depth = integrate_normals(normals, mask, K)
    values = np.log(depth) if perspective else depth
    assert depth[2, 2] == (1.0 if perspective else 0.0)
    for part in (np.s_[3:, :47], np.s_[:, 50:]):
        own = np.isfinite(values[part])
        assert values[part][own].mean() == pytest.approx(0.0, abs=1e-9)
        alone = np.zeros_like(mask)
        alone[part] = mask[part]
        inside = alone & (near.facing > 0.5)
        assert aligned_error(depth, near.depth, inside, perspective).max() < (
            5e-3 * (1.0 if perspective else 80)
        )


def test_mask_may_be_an_8_bit_image_and_outside_is_not_read(ellipsoid) -> None:
    near, _ = ellipsoid(48, (24, 24, 0), (20, 20, 20), None)
    outside = np.where(near.mask[..., None], near.normals, np.nan)
    np.testing.assert_array_equal(
        integrate_normals(outside, near.mask.astype(np.uint8) * 255),
        integrate_normals(near.normals, near.mask),
    )


@pytest.mark.parametrize("name", sorted(REFERENCE_MM))
@pytest.mark.parametrize("shift", [0.0, 0.5])
def test_benchmark_of_the_field(name: str, shift: float) -> None:
    """DiLiGenT, with its K read as ours and as counting from 0 at the top-left centre.

    Which one its authors meant cannot be told from normals and depth: the offset that fits best,
    averaged over both objects and axes, is 0.6 +- 0.2 pixels.
    """
    folder = DILIGENT / name
    if not folder.is_dir():
        pytest.skip("DiLiGenT is not on this machine")
    import cv2  # the map has 16 bits in three channels, which pillow reads as 8

    mask = cv2.imread(str(folder / "mask.png"), cv2.IMREAD_UNCHANGED) > 0
    stored = cv2.imread(str(folder / "normal_map.png"), cv2.IMREAD_UNCHANGED)
    normals = stored[..., ::-1] / 65535.0 * 2.0 - 1.0
    with np.load(folder / "depth_gt.npz") as archive:
        truth = archive["depth_gt"].astype(np.float64)
    K = np.loadtxt(folder / "K.txt")
    K[:2, 2] += shift
    error, plain = (
        aligned_error(way(normals, mask, K), truth, mask, perspective=True).mean()
        for way in (integrate_normals, plain_integration)
    )
    assert error <= 1.02 * plain
    if shift == 0.5:
        assert error < REFERENCE_MM[name] + HALF_A_DIGIT_MM


GOOD = np.broadcast_to([0.0, 0.0, 1.0], (5, 6, 3))
MASK = np.ones((5, 6), dtype=bool)


def spoilt(value) -> np.ndarray:
    normals = GOOD.copy()
    normals[2, 3] = value
    return normals


@pytest.mark.parametrize(
    ("normals", "mask", "options", "words"),
    [
        (GOOD[:4], MASK, {}, "do not match"),
        (GOOD[..., :2], MASK, {}, "do not match"),
        (GOOD, MASK[0], {}, "mask of a normal map is not usable"),
        (GOOD, MASK.astype(float), {}, "boolean or integer"),
        (GOOD, np.zeros_like(MASK), {}, "empty"),
        (spoilt((0, 0, 0.9)), MASK, {}, "row 2, column 3"),
        (spoilt(np.nan), MASK, {}, "1 pixels in the mask that are no unit vector"),
        (GOOD, MASK, {"K": np.eye(4)}, "K is not an intrinsic matrix"),
        (GOOD, MASK, {"K": -np.eye(3)}, "K is not an intrinsic matrix"),
        (GOOD, MASK, {"k": 0.0}, "k > 0"),
        (GOOD, MASK, {"tol": -1.0}, "tol > 0"),
        (GOOD, MASK, {"max_iter": 0}, "max_iter >= 1"),
    ],
)
def test_what_cannot_be_integrated_is_said(normals, mask, options, words) -> None:
    with pytest.raises(DataError, match=words):
        integrate_normals(normals, mask, **options)

"""Fold strength of surfaces whose folds are known in closed form."""

import numpy as np
import pytest

from harness.core.errors import DataError
from harness.core.mesh import Mesh
from harness.core.rigs import RingRig
from metrics.folds import (
    BLUR_M,
    PIXEL_M,
    fold_angles_deg,
    fold_correlation,
    fold_errors,
    fold_strength,
    pixel_size_m,
    true_normals,
)

SIDE_M = 0.6


def ridges(wavelength_m, slope, pixel_m=PIXEL_M, phase=0.0, turn_deg=0.0):
    """Normals and mask of z = (slope / k) sin(k u), u a level direction, on a square of 0.6 m."""
    size = round(SIDE_M / pixel_m)
    y, x = (np.mgrid[:size, :size] + 0.5) * pixel_m
    turn = np.radians(turn_deg)
    k = 2 * np.pi / wavelength_m
    rise = slope * np.cos(k * (x * np.cos(turn) + y * np.sin(turn)) + phase)
    normals = np.stack([-rise * np.cos(turn), -rise * np.sin(turn), np.ones_like(rise)], axis=-1)
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    return normals / length, np.ones((size, size), bool)


@pytest.mark.parametrize("tilt_deg", [0.0, 30.0, 75.0])
def test_a_plane_has_no_folds(tilt_deg):
    tilt = np.radians(tilt_deg)
    normals = np.broadcast_to([np.sin(tilt), 0.0, np.cos(tilt)], (150, 120, 3))
    found = fold_strength(normals, np.ones((150, 120), bool), PIXEL_M)
    assert found.mean_deg == pytest.approx(0, abs=1e-6)
    assert found.p90_deg == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("wavelength_m", [0.04, 0.08, 0.16, 0.32])
@pytest.mark.parametrize("turn_deg", [0.0, 90.0, 33.0])
def test_low_ridges_keep_what_the_blur_takes_away(wavelength_m, turn_deg):
    """The blur leaves exp(-(k sigma)^2 / 2) of a wave, and the rest is the angle at each place."""
    slope = 0.02
    normals, mask = ridges(wavelength_m, slope, turn_deg=turn_deg)
    rise = np.hypot(normals[..., 0], normals[..., 1]) / normals[..., 2]
    taken = 1 - np.exp(-0.5 * (2 * np.pi / wavelength_m * BLUR_M) ** 2)
    inner = slice(20, -20)  # away from the border, where the blur sees one side
    found = fold_angles_deg(normals, mask, PIXEL_M)[inner, inner]
    expected = np.degrees(rise * taken)[inner, inner]
    np.testing.assert_allclose(found, expected, atol=0.01 * np.degrees(slope))


@pytest.mark.parametrize("slope", [0.1, 0.5, 2.0])
def test_narrow_ridges_keep_their_whole_slope(slope):
    """The blur of waves much narrower than itself is level; angles are then those of the slope."""
    found = fold_strength(*ridges(0.0237, slope), PIXEL_M)
    quarter = np.linspace(0, np.pi / 2, 4001)
    angles = np.degrees(np.arctan(slope * np.cos(quarter)))
    assert found.mean_deg == pytest.approx(angles.mean(), rel=0.03)


def test_finer_maps_measure_the_same_folds_and_ten_times_the_pixels_count_once():
    coarse = fold_strength(*ridges(0.06, 0.3), PIXEL_M)
    fine = fold_strength(*ridges(0.06, 0.3, PIXEL_M / 4), PIXEL_M / 4)
    assert fine.n == coarse.n
    assert fine.mean_deg == pytest.approx(coarse.mean_deg, rel=0.03)


def test_only_pixels_thirty_millimetres_inside_count():
    normals, mask = ridges(0.05, 0.2)
    mask[:, 75:] = False
    counted = np.isfinite(fold_angles_deg(normals, mask, PIXEL_M))
    rows, columns = np.nonzero(counted)
    # The eighth pixel from the border is the first whose centre is 30 mm from the next one outside.
    assert (rows.min(), rows.max()) == (7, 142)
    assert (columns.min(), columns.max()) == (7, 67)


def test_what_lies_outside_the_mask_does_not_count():
    normals, mask = ridges(0.05, 0.2)
    mask[40:60, 40:60] = False
    spoilt = np.where(mask[..., None], 5 * normals, np.nan)
    clean = fold_strength(normals, mask, PIXEL_M)
    found = fold_strength(spoilt, mask, PIXEL_M)
    assert found.n == clean.n
    assert found.mean_deg == pytest.approx(clean.mean_deg, rel=1e-9)
    assert found.p90_deg == pytest.approx(clean.p90_deg, rel=1e-9)


def test_folds_correlate_with_themselves_at_any_size_and_not_with_others():
    truth, mask = ridges(0.05, 0.3)
    weak, _ = ridges(0.05, 0.1)
    across, _ = ridges(0.05, 0.3, turn_deg=90)
    shifted, _ = ridges(0.05, 0.3, phase=np.pi)
    plane, _ = ridges(0.05, 0.0)
    assert fold_correlation(truth, truth, mask, PIXEL_M) == pytest.approx(1)
    assert fold_correlation(weak, truth, mask, PIXEL_M) == pytest.approx(1, abs=0.01)
    assert fold_correlation(shifted, truth, mask, PIXEL_M) < -0.9
    assert abs(fold_correlation(across, truth, mask, PIXEL_M)) < 0.05
    assert fold_correlation(plane, truth, mask, PIXEL_M) == 0


def test_errors_of_folds_are_both_strengths_and_their_correlation():
    truth, mask = ridges(0.05, 0.3)
    weak, _ = ridges(0.05, 0.1, turn_deg=5)
    found = fold_errors(weak, truth, mask, PIXEL_M)
    assert found.estimate_deg == fold_strength(weak, mask, PIXEL_M).mean_deg
    assert found.truth_deg == fold_strength(truth, mask, PIXEL_M).mean_deg
    assert found.correlation == fold_correlation(weak, truth, mask, PIXEL_M)
    assert fold_errors(weak, truth, mask, 0.01) is None
    assert fold_errors(weak[:10, :10], truth[:10, :10], mask[:10, :10], PIXEL_M) is None


def test_the_size_of_a_pixel_is_that_at_the_place():
    camera = RingRig(radius_m=3.0).cameras(360, 640)[2]
    place = np.array([0.0, 0.0, 0.0])
    assert pixel_size_m(camera, place) == pytest.approx(3.0 / camera.K[0, 0])
    assert pixel_size_m(camera, camera.position / 2) == pytest.approx(1.5 / camera.K[0, 0])


@pytest.mark.parametrize("yaw_deg", [0.0, 180.0])
def test_a_mesh_of_ridges_measures_as_its_map_does(yaw_deg):
    """A corrugated board 0.6 m high and wide, seen from either side."""
    step, wavelength, slope = 0.002, 0.06, 0.3
    count = round(SIDE_M / step) + 1
    y, x = np.mgrid[:count, :count] * step
    k = 2 * np.pi / wavelength
    board = np.stack([x, y, slope / k * np.sin(k * x)], axis=-1).reshape(-1, 3)
    index = np.arange(count * count).reshape(count, count)
    corners = [index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]]
    a, b, c, d = (corner.ravel() for corner in corners)
    mesh = Mesh(board, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]))
    normals, mask = true_normals(mesh, yaw_deg)
    assert mask.sum() * PIXEL_M**2 == pytest.approx(SIDE_M**2, rel=0.02)
    expected = fold_strength(*ridges(wavelength, slope), PIXEL_M)
    found = fold_strength(normals, mask, PIXEL_M)
    assert found.mean_deg == pytest.approx(expected.mean_deg, rel=0.03)
    assert found.median_deg == pytest.approx(expected.median_deg, rel=0.05)


def test_maps_that_cannot_be_measured_are_refused():
    normals, mask = ridges(0.05, 0.2)
    with pytest.raises(DataError, match="different shapes"):
        fold_strength(normals[1:], mask, PIXEL_M)
    with pytest.raises(DataError, match="too coarse"):
        fold_strength(normals, mask, 0.01)
    with pytest.raises(DataError, match="too small"):
        fold_strength(normals[:10, :10], mask[:10, :10], PIXEL_M)

"""Errors of normal maps against known rotations, and their summary against known shares."""

import numpy as np
import pytest

from harness.core.errors import DataError
from harness.core.truth import FaceRegions
from harness.core.typed_json import to_json
from metrics.normals import THRESHOLDS_DEG, angular_error_map, angular_errors


def hemisphere(size=41):
    """Normals (H, W, 3) of a ball in the frame of maps, and where it is."""
    y, x = np.mgrid[1 : -1 : size * 1j, -1 : 1 : size * 1j]
    mask = x**2 + y**2 < 0.9
    z = np.sqrt(np.clip(1 - x**2 - y**2, 0, None))
    return np.stack([x, y, z], axis=-1) * mask[..., None], mask


def about(axis, angle_deg):
    """(3, 3) rotation, by Rodrigues' formula."""
    x, y, z = np.asarray(axis) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = np.radians(angle_deg)
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


@pytest.mark.parametrize("angle_deg", [0.0, 1e-6, 11.0, 90.0, 180.0])
def test_a_wall_that_is_turned_is_off_by_the_angle(angle_deg):
    mask = np.ones((3, 5), bool)
    wall = np.broadcast_to([0.0, 0.0, 1.0], (3, 5, 3))
    errors_deg = angular_error_map(wall @ about((0, 1, 0), angle_deg).T, wall, mask)
    np.testing.assert_allclose(errors_deg, angle_deg, atol=1e-9)


def test_a_ball_that_is_turned_is_off_by_the_angle_and_by_its_distance_from_the_axis():
    """Rotation by a about z moves a normal at polar angle p by 2 asin(sin p sin a/2)."""
    normals, mask = hemisphere()
    errors_deg = angular_error_map(normals @ about((0, 0, 1), 40).T, normals, mask)
    sine = np.hypot(normals[..., 0], normals[..., 1])[mask]
    expected = 2 * np.degrees(np.arcsin(sine * np.sin(np.radians(20))))
    np.testing.assert_allclose(errors_deg[mask], expected, atol=1e-9)
    assert np.isnan(errors_deg[~mask]).all()


def test_lengths_do_not_matter_and_pixels_outside_do_not_count():
    normals, mask = hemisphere()
    spoilt = np.where(mask[..., None], 3 * normals, np.nan)
    errors_deg = angular_error_map(spoilt, normals, mask)
    np.testing.assert_allclose(errors_deg[mask], 0, atol=1e-9)


def test_shares_are_of_pixels_strictly_below():
    errors_deg = np.array([0.0, 11.25, 11.24, 22.5, 29.9, 30.0, 30.1, 180.0])
    found = angular_errors(errors_deg)
    assert found.n == 8
    assert found.mean_deg == pytest.approx(errors_deg.sum() / 8)
    assert found.median_deg == pytest.approx((22.5 + 29.9) / 2)
    shares = (found.share_below_11_25, found.share_below_22_5, found.share_below_30)
    assert shares == (2 / 8, 3 / 8, 5 / 8)
    assert THRESHOLDS_DEG == (11.25, 22.5, 30.0)


def test_no_pixels_have_no_error():
    found = to_json(angular_errors(np.empty(0)))
    assert found.pop("n") == 0
    assert set(found.values()) == {None}


def test_maps_that_do_not_fit_are_refused():
    normals, mask = hemisphere()
    with pytest.raises(DataError, match="different shapes"):
        angular_error_map(normals[1:], normals, mask)
    holed = normals.copy()
    holed[20, 20] = 0
    with pytest.raises(DataError, match="predicted normal map.*1 of"):
        angular_error_map(holed, normals, mask)
    with pytest.raises(DataError, match="true normal map"):
        angular_error_map(normals, np.where(holed == 0, np.nan, holed), mask)


def test_what_is_no_part_of_the_person_is_worn():
    names = ("head", "hair", "legs", "dress", "shoes")
    regions = FaceRegions(names, np.array([0, 3, 2, 1, 4, 3]))
    assert regions.worn.tolist() == [False, True, False, False, True, True]

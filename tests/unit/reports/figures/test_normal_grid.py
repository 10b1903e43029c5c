"""The normals figure: what is drawn where, and which rows do not go together."""

import matplotlib.image
import numpy as np
import pytest

from harness.core.artifacts import Capture, NormalMaps, image_name
from harness.core.errors import HarnessError
from harness.core.rigs import RingRig
from harness.geometry.images import save_png
from reports.figures.comparison import NormalPanels, NormalRow, _errors, normal_grid

CAMERAS = RingRig().cameras(90, 160)
FACING = np.array([0.0, 0.0, 1.0])


@pytest.fixture
def capture(tmp_path):
    """Eight red rectangles."""
    rgba = np.zeros((160, 90, 4), np.uint8)
    rgba[30:130, 30:60] = (255, 0, 0, 255)
    for view in range(8):
        save_png(tmp_path / image_name(view), rgba)
    return Capture("toy", "t1", "tiny", "key", tmp_path, CAMERAS)


def panels(view=0, side="near", title="Front photo", error_deg=20.0):
    camera = CAMERAS[view].cropped(-10, 25, 110, 110).resized(55, 55)
    mask = np.zeros((55, 55), bool)
    mask[3:52, 20:35] = True
    normals = FACING * mask[..., None]
    maps = NormalMaps(view, camera, mask, normals, -normals, normals, -normals)
    errors_deg = np.where(mask, error_deg, np.nan)
    return NormalPanels(title, maps, side, normals, errors_deg, "20.0° off", "10.0° off")


def test_a_figure_of_both_photos_is_drawn(capture, tmp_path):
    row = NormalRow(capture, (panels(), panels(4, title="Back photo")))
    path = tmp_path / "normals.png"
    normal_grid([row, row], path)
    pixels = matplotlib.image.imread(path)[..., :3]
    red = np.abs(pixels - [1, 0, 0]).max(axis=2) < 0.02
    facing = np.abs(pixels - [0.5, 0.5, 1]).max(axis=2) < 0.02
    assert red.sum() > 1000
    # Body, estimate and truth, as large as the photo but for blurred edges.
    assert facing.sum() == pytest.approx(3 * red.sum(), rel=0.2)


def test_the_hidden_side_has_no_photo_of_its_own(capture, tmp_path):
    def width(*sides):
        path = tmp_path / "normals.png"
        normal_grid([NormalRow(capture, sides)], path)
        return matplotlib.image.imread(path).shape[1]

    alone = width(panels())
    with_far = width(panels(), panels(side="far", title=""))
    with_photo = width(panels(), panels(4))
    assert (with_far - alone) == pytest.approx((with_photo - alone) * 4 / 5, abs=3)


def test_rows_of_other_sides_are_refused(capture, tmp_path):
    rows = [NormalRow(capture, (panels(),)), NormalRow(capture, (panels(side="far"),))]
    for wrong in ([], rows):
        with pytest.raises(HarnessError, match="same photos and sides"):
            normal_grid(wrong, tmp_path / "normals.png")


def test_pixels_without_an_error_are_white_and_60_degrees_the_last_colour():
    colours = _errors(np.array([[np.nan, 0.0, 60.0, 170.0]]))
    np.testing.assert_array_equal(colours[0, 0], 1.0)
    np.testing.assert_array_equal(colours[0, 2], colours[0, 3])
    assert np.abs(colours[0, 1] - colours[0, 2]).max() > 0.3

"""The whole way, on photos of a figure: what is found, left out, and kept."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates

from harness.core.camera import Camera
from methods.cameras.adjustment import Rig
from methods.cameras.estimate import estimate_cameras, refine_cameras
from methods.cameras.search import upright_line
from methods.cameras.values import EstimatedCameras, Focal, PhotoView
from tests.unit.methods.cameras.conftest import Taken, errors_deg, turned

pytestmark = pytest.mark.nightly


def estimated(taken: Taken, **changes: object) -> EstimatedCameras:
    known = {
        "photos": taken.photos,
        "focal": Focal(tuple(float(camera.K[0, 0]) for camera in taken.cameras)),
        "height_m": taken.height_m,
        "landmarks": taken.marks,
    }
    return estimate_cameras(**(known | changes))


@pytest.fixture(scope="module")
def found(taken) -> EstimatedCameras:
    return estimated(taken)


def test_cameras_are_found(taken, found):
    off_deg = errors_deg(found.cameras, taken.cameras)
    assert np.median(off_deg) < 0.05
    assert off_deg.max() < 0.1
    assert found.left_out == ()
    assert all(photo.match_px < 0.15 for photo in found.photos)
    assert [stage.name for stage in found.stages[:3]] == ["landmarks", "outlines", "photos 1"]
    # Metres and from the front, as the figure itself stands; upright as cameras are that roll.
    up = upright_line(Rig.of(taken.cameras))
    up *= np.sign(up[1])
    for own, known in zip(found.cameras, taken.cameras, strict=True):
        assert own is not None
        assert np.linalg.norm(own.position - known.position) < 0.25
        above = float((known.position - taken.mesh.bounds.mean(axis=0)) @ up)
        assert own.position[1] == pytest.approx(above, abs=0.025)
    assert found.warnings == ()


def test_the_order_of_photos_changes_no_bit(taken, found):
    order = [4, 2, 7, 0, 1, 6, 3, 5]
    again = estimated(
        taken,
        photos=[taken.photos[n] for n in order],
        focal=Focal(tuple(float(taken.cameras[n].K[0, 0]) for n in order)),
        landmarks=taken.marks.at(order),
    )
    for place, number in enumerate(order):
        one, other = again.cameras[place], found.cameras[number]
        assert one is not None
        assert other is not None
        assert np.array_equal(one.world_to_camera, other.world_to_camera)


def test_an_unknown_focal_length_is_found(taken):
    found = estimated(taken, focal=Focal.unknown(taken.photos))
    assert found.focal_px[0] == pytest.approx(taken.cameras[0].K[0, 0], rel=0.01)
    assert 0 < found.focal_relative_sd < 0.01


def test_a_mirrored_photo_is_left_out_by_name(taken):
    photos = list(taken.photos)
    photos[2] = PhotoView("2.png", np.ascontiguousarray(photos[2].rgba[:, ::-1]))
    told = taken.marks
    width = photos[2].size[0]
    flipped = replace(
        told,
        pixels=np.where(
            (np.arange(8) == 2)[:, None, None], (width, 0.0) + told.pixels * (-1, 1), told.pixels
        ),
        points_camera=np.where(
            (np.arange(8) == 2)[:, None, None], told.points_camera * (-1, 1, 1), told.points_camera
        ),
    ).mirrored(np.arange(8) == 2)
    found = estimated(taken, photos=photos, landmarks=flipped)
    assert [name for name, _ in found.left_out] == ["2.png"]
    assert errors_deg(found.cameras, taken.cameras).max() < 0.15


def test_exact_cameras_stay_and_wrong_ones_are_refined(taken):
    same = refine_cameras(taken.photos, taken.cameras)
    for own, known in zip(same.cameras, taken.cameras, strict=True):
        assert isinstance(own, Camera)
        assert np.array_equal(own.world_to_camera, known.world_to_camera)
    assert "stay as they were given" in same.warnings[-1]
    off = turned(taken.cameras, 1.0, 8)
    better = refine_cameras(taken.photos, off)
    assert errors_deg(off, taken.cameras).max() > 0.5
    assert errors_deg(better.cameras, taken.cameras).max() < 0.08


def test_rough_masks_leave_it_to_matches(taken):
    """Outlines that wobble by some millimetres: two wide searches for matches, and a narrow one."""
    photos = []
    for number, photo in enumerate(taken.photos):
        rng, rgba = np.random.default_rng(number), photo.rgba.copy()
        moves = [gaussian_filter(rng.normal(size=rgba.shape[:2]), 8.0) for _ in range(2)]
        places = [
            axis + 0.7 * move / move.std()
            for axis, move in zip(np.indices(rgba.shape[:2]), moves, strict=True)
        ]
        rgba[..., 3] = map_coordinates(rgba[..., 3].astype(float), places, order=1)
        photos.append(PhotoView(photo.name, rgba))
    found = estimated(taken, photos=photos)
    assert errors_deg(found.cameras, taken.cameras).max() < 0.15
    (missed_mm,) = (s.residuals["missed_mm"] for s in found.stages if s.name == "outlines")
    assert missed_mm > 0.8
    assert found.stages[-1].name == "photos 3"

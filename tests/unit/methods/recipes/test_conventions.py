"""VGGT's conventions against stored numbers of its own code: pictures, cameras, points.

The stored numbers lie outside the repository; what they showed is also checked here in numbers
worked out by hand, so that these tests bite without them.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from harness.core.camera import Camera
from tests.unit.methods.recipes.conftest import decoded_cameras, exchange

SHARED = Path(__file__).parents[5] / "shared" / "data"
GOLDEN = next(
    (
        folder
        for folder in (SHARED, Path(__file__).parents[6] / "shared" / "data")
        if (folder / "golden_vggt_conventions.npz").is_file()
    ),
    None,
)
needs_golden = pytest.mark.skipif(GOLDEN is None, reason="the stored numbers are not here")

#: Encoding, rotation's first row, shift, focal lengths, centre; of pictures of 98 x 70.
FIRST = [0.1, -0.2, 0.3, 0.1, 0.2, -0.3, 0.9, 0.8, 1.0]
SECOND = [-0.4, 0.5, 0.6, 0.2, -0.4, 0.6, -1.8, 0.7, 0.9]


def golden(name: str) -> dict[str, np.ndarray]:
    assert GOLDEN is not None
    with np.load(GOLDEN / name) as file:
        return {key: file[key] for key in file.files}


def test_worked_cameras():
    first, second = decoded_cameras(np.array([FIRST, SECOND]), (98, 70))
    np.testing.assert_allclose(
        first.rotation,
        [
            [0.7263157, 0.6105264, 0.3157895],
            [-0.5263158, 0.7894737, -0.3157895],
            [-0.4421053, 0.0631579, 0.8947368],
        ],
        atol=1e-7,
    )
    np.testing.assert_allclose(first.world_to_camera[:3, 3], [0.1, -0.2, 0.3])
    np.testing.assert_allclose([first.K[0, 0], first.K[1, 1]], [89.6939, 82.782776], rtol=1e-6)
    np.testing.assert_allclose(first.position, [-0.0452632, 0.0778947, -0.3631579], atol=1e-7)
    np.testing.assert_allclose([second.K[0, 0], second.K[1, 1]], [101.437706, 95.88293], rtol=1e-6)
    np.testing.assert_allclose(second.position, [0.7852632, 0.0052632, -0.3915789], atol=1e-7)


def unprojected(camera: Camera, depth: np.ndarray) -> np.ndarray:
    rows, columns = np.indices(depth.shape)
    pixels = np.stack([columns + 0.5, rows + 0.5], axis=-1).reshape(-1, 2)
    return camera.unproject(pixels, depth.ravel()).reshape(*depth.shape, 3)


#: The network's own unprojection of a depth map of 3 x 2 pixels with the first camera.
DEPTH = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
POINTS = np.array(
    [
        [
            [-0.6616337, -0.5262636, 0.492576],
            [-1.2618089, -1.1168084, 1.3553515],
            [-1.8457886, -1.6937396, 2.2251684],
        ],
        [
            [-2.5361767, -2.3005919, 3.0445191],
            [-3.1184164, -2.8611795, 3.9140421],
            [-3.6844607, -3.4081539, 4.7906066],
        ],
    ]
)


def test_worked_points():
    (camera,) = decoded_cameras(np.array([FIRST]), (98, 70))
    np.testing.assert_allclose(unprojected(camera, DEPTH), POINTS, atol=1e-6)


MISTAKES = {
    "quaternion starts with w": lambda e: e[[0, 1, 2, 6, 3, 4, 5, 7, 8]],
    "fields of view exchanged": lambda e: e[[0, 1, 2, 3, 4, 5, 6, 8, 7]],
    "quaternion conjugated": lambda e: e * [1, 1, 1, -1, -1, -1, 1, 1, 1],
    "shift of the other sign": lambda e: e * [-1, -1, -1, 1, 1, 1, 1, 1, 1],
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_wrong_reading_of_the_encoding_is_seen(mistake):
    (camera,) = decoded_cameras(MISTAKES[mistake](np.array(FIRST))[None], (98, 70))
    assert np.abs(unprojected(camera, DEPTH) - POINTS).max() > 0.05


def test_half_a_pixel_is_seen():
    """The network counts pixels from 0 with the middle at half the picture; so does this."""
    (camera,) = decoded_cameras(np.array([FIRST]), (98, 70))
    K = camera.K - np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])
    other = Camera(K, camera.world_to_camera, 98, 70)
    apart = np.linalg.norm(unprojected(other, DEPTH) - POINTS, axis=-1)
    np.testing.assert_allclose(apart, DEPTH * np.hypot(0.5 / 89.6939, 0.5 / 82.782776), rtol=1e-4)


def test_a_quaternion_need_not_be_of_unit_length():
    encoded = np.array(FIRST)
    longer = encoded * [1, 1, 1, 3, 3, 3, 3, 1, 1]
    (camera,), (same,) = (decoded_cameras(each[None], (98, 70)) for each in (encoded, longer))
    np.testing.assert_allclose(camera.world_to_camera, same.world_to_camera, atol=1e-12)


@pytest.mark.parametrize(
    ("place", "value"), [(7, 0.0), (8, 0.0), (0, np.nan), (8, np.pi), (slice(3, 7), 0.0)]
)
def test_no_camera_is_said(place, value):
    """The fields of view pass a rectifier: exactly 0 would be an infinite focal length."""
    encoded = np.array([FIRST, FIRST])
    encoded[1, place] = value
    with pytest.raises(SystemExit, match="^refused: .*no camera for photo 2 of 2"):
        decoded_cameras(encoded, (98, 70))


@needs_golden
def test_stored_cameras_and_points():
    stored = golden("golden_vggt_conventions.npz")
    height, width = stored["image_hw"]
    cameras = decoded_cameras(stored["pose_enc"][0], (int(width), int(height)))
    for camera, extrinsic, intrinsic, depth, points, pose in zip(
        cameras,
        stored["extrinsic"][0],
        stored["intrinsic"][0],
        stored["depth"][..., 0],
        stored["points"],
        stored["cam_to_world"],
        strict=True,
    ):
        np.testing.assert_allclose(camera.world_to_camera[:3], extrinsic, atol=1e-6)
        np.testing.assert_allclose(np.diag(camera.K), np.diag(intrinsic), atol=2e-5)
        np.testing.assert_allclose(camera.K[:2, 2] - 0.5, intrinsic[:2, 2])
        np.testing.assert_allclose(camera.camera_to_world, pose, atol=1e-6)
        np.testing.assert_allclose(unprojected(camera, depth), points, atol=5e-6)


#: As worked out by hand: photo, fit, resized, shift, size.
WORKED = [
    ((1080, 1920), "pad", (294, 518), (112, 0), (518, 518)),
    ((1080, 1920), "fit", (294, 518), (0, 0), (294, 518)),
    ((1080, 1920), "crop", (518, 924), (0, -203), (518, 518)),
    ((270, 480), "pad", (294, 518), (112, 0), (518, 518)),
    ((1920, 1080), "pad", (518, 294), (0, 112), (518, 518)),
    ((512, 512), "pad", (518, 518), (0, 0), (518, 518)),
]


@pytest.mark.parametrize(("photo", "fit", "resized", "shift", "size"), WORKED)
def test_worked_frames(photo, fit, resized, shift, size):
    """Cropping a portrait photo loses head and feet: 406 of 924 rows."""
    rgba = np.zeros((photo[1], photo[0], 4), np.uint8)
    found = exchange.fitted(rgba, 518, 14, fit, 255)
    assert (found.resized, found.shift, found.picture.shape[1::-1]) == (resized, shift, size)
    # Transparent pixels show the background, and so does the padding.
    assert (found.picture == 255).all()


def test_a_fit_that_is_none_is_refused():
    with pytest.raises(SystemExit, match="^refused: network.fit must be pad, fit or crop"):
        exchange.fitted(np.zeros((20, 20, 4), np.uint8), 518, 14, "stretch", 255)


def shown(photo: np.ndarray, fit: str = "pad", background: int = 255) -> np.ndarray:
    """A stored photo, with or without alpha, as the network sees it."""
    if photo.shape[2] == 3:
        photo = np.dstack([photo, np.full(photo.shape[:2], 255, np.uint8)])
    return exchange.fitted(photo, 518, 14, fit, background).picture


@needs_golden
@pytest.mark.parametrize("name", ["portrait", "landscape", "rgba"])
@pytest.mark.parametrize("fit", ["pad", "crop"])
def test_stored_pictures(name, fit):
    """Not a single level off: the same resizing, rounding, padding and background."""
    stored = golden("golden_vggt_conventions.npz")
    picture = shown(stored[f"{name}_in"], fit)
    assert tuple(stored[f"{name}_{fit}_shape"][-2:]) == picture.shape[:2]
    every = picture.transpose(2, 0, 1)[:, ::7, ::7]
    np.testing.assert_array_equal(every, stored[f"{name}_{fit}_every7"])


PICTURE_MISTAKES = {
    "padding is black": lambda photo: shown(photo, background=0),
    "colours exchanged": lambda photo: shown(photo)[..., ::-1],
    "mirrored": lambda photo: shown(photo[:, ::-1]),
}


@needs_golden
@pytest.mark.parametrize("mistake", PICTURE_MISTAKES)
def test_a_wrong_picture_is_seen(mistake):
    stored = golden("golden_vggt_conventions.npz")
    wrong = PICTURE_MISTAKES[mistake](stored["portrait_in"]).transpose(2, 0, 1)[:, ::7, ::7]
    apart = np.abs(wrong.astype(int) - stored["portrait_pad_every7"])
    assert apart.max() > 20


@needs_golden
def test_stored_outputs_of_a_small_network_are_unprojected_as_it_does():
    stored = golden("golden_vggt_tiny.npz")
    cameras = decoded_cameras(stored["h_pose_enc"][0], (98, 70))
    for camera, depth, points, extrinsic in zip(
        cameras, stored["h_depth"][0, ..., 0], stored["h_points_from_depth"],
        stored["h_extrinsic"][0], strict=True,
    ):  # fmt: skip
        scale = np.abs(points).max()
        np.testing.assert_allclose(camera.world_to_camera[:3], extrinsic, atol=1e-6)
        np.testing.assert_allclose(unprojected(camera, depth), points, atol=1e-5 * scale)

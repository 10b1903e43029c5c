"""The compiled windows against plain ones, sample by sample."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from harness.core.errors import HarnessError
from harness.core.rigs import RingRig
from methods.stereo.kernels import Planes, device_array, match_first
from methods.stereo.kernels import launch as launched
from methods.stereo.narrow import correlation_curves
from methods.stereo.patchmatch import _reference, _sources, window_weights
from methods.stereo.settings import MOST_RADIUS, MatchSettings, NarrowSettings, StereoSettings
from methods.stereo.views import OUTSIDE, Contrast

CAMERAS = RingRig(views=8).cameras(60, 80)


def picture(seed: int, camera, shape=None) -> Contrast:
    """Smooth noise with a hole and an edge beside the subject."""
    rng = np.random.default_rng(seed)
    values = rng.normal(size=shape or (camera.height, camera.width)).astype(np.float32)
    for axis in (0, 1):
        values = (values + np.roll(values, 1, axis) + np.roll(values, -1, axis)) / 3
    values[18:22, 20:23] = values[:, :6] = OUTSIDE
    return Contrast(camera, values, 0.02)


def bilinear(image: np.ndarray, x: float, y: float) -> float:
    x, y = x - 0.5, y - 0.5
    if not (0 <= x < image.shape[1] - 1 and 0 <= y < image.shape[0] - 1):
        return OUTSIDE
    column, row = int(x), int(y)
    four = image[row : row + 2, column : column + 2].astype(float)
    if four.min() < OUTSIDE / 2:
        return OUTSIDE
    top, bottom = four @ [1 - (x - column), x - column]
    return top + (y - row) * (bottom - top)


def correlated(a: np.ndarray, b: np.ndarray, weights: np.ndarray, floor: float) -> float:
    """Of the samples that both have; -1 where over 40 % of the first's have no partner."""
    shown = a > OUTSIDE / 2
    both = shown & (b > OUTSIDE / 2)
    if (shown & ~both).sum() > 0.4 * a.size or not both.any():
        return -1.0
    a, b, w = a[both], b[both], weights[both] / weights[both].sum()
    a, b = a - w @ a, b - w @ b
    return (w @ (a * b)) / np.sqrt(max(w @ a**2, floor) * max(w @ b**2, floor))


@pytest.mark.parametrize("radius", [1, 4, MOST_RADIUS])
def test_windows_under_planes_are_the_plain_ones(radius: int) -> None:
    first, second = picture(0, CAMERAS[0]), picture(1, CAMERAS[1], (76, 58))
    settings, depth_m = MatchSettings(radius_px=radius), 3.0
    normal = np.array([0.3, 0.2, -1.0]) / np.linalg.norm([0.3, 0.2, -1.0])
    rows, columns = np.mgrid[0:80:3, 6:60:3]
    shape = first.values.shape
    planes = Planes()
    planes.depth = device_array(np.full(shape, depth_m), wp.float32)
    planes.normal = device_array(np.broadcast_to(normal, (*shape, 3)), wp.vec3)
    planes.cost = device_array(np.zeros(shape), wp.float32)
    depth = np.full(shape, depth_m, np.float32)
    reference = _reference(first, depth, np.zeros((*shape, 3), np.float32), settings)
    sources = _sources(first, [second], np.ones((1, *shape), np.int32))
    pixels = np.stack([columns.ravel(), rows.ravel()], axis=1)
    launched(
        match_first,
        len(pixels),
        [reference, sources, planes, device_array(pixels, wp.vec2i), 1, 0],
    )
    found = 1.0 - planes.cost.numpy()[pixels[:, 1], pixels[:, 0]]

    weights, exact = window_weights(radius), []
    way = np.arange(-radius, radius + 1)
    for x, y in pixels:
        middle = first.camera.unproject(np.array([[x + 0.5, y + 0.5]]), np.array([depth_m]))[0]
        facing = first.camera.rotation.T @ normal
        a, b = np.full(weights.shape, OUTSIDE), np.full(weights.shape, OUTSIDE)
        for j, dy in enumerate(way):
            for i, dx in enumerate(way):
                if not (0 <= x + dx < 60 and 0 <= y + dy < 80):
                    continue
                a[j, i] = first.values[y + dy, x + dx]
                seen = np.array([[x + dx + 0.5, y + dy + 0.5]])
                ray = first.camera.unproject(seen, np.array([1.0]))[0] - first.camera.position
                share = (middle - first.camera.position) @ facing / (ray @ facing)
                there = first.camera.position + share * ray
                b[j, i] = bilinear(second.values, *second.camera.project(there[None])[0][0])
        exact.append(correlated(a, b, weights, 0.02**2))
    np.testing.assert_allclose(found, exact, atol=2e-3)
    assert (np.array(exact) > -0.9).sum() > 200


@pytest.mark.parametrize("radius", [1, 5, MOST_RADIUS])
def test_patches_along_normals_are_the_plain_ones(radius: int) -> None:
    two = picture(2, CAMERAS[0]), picture(3, CAMERAS[1], (76, 58))
    settings = NarrowSettings(radius=radius, reach_m=0.01, step_m=0.01)
    rng = np.random.default_rng(5)
    points = rng.uniform([-0.25, -0.35, -0.02], [0.25, 0.35, 0.02], (60, 3))
    normals = rng.normal(size=(60, 3)) * [0.2, 0.2, 0.0] + [0, 0, 1]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    sample_m = 0.02
    found = correlation_curves(points, normals, two, settings, sample_m)

    weights, way = window_weights(radius, 0.6), np.arange(-radius, radius + 1)
    for point, normal, curve in zip(points, normals, found, strict=True):
        across = np.cross([0.0, 1.0, 0.0], normal)
        across /= np.linalg.norm(across)
        along = np.cross(normal, across)
        for offset, value in zip((-0.01, 0.0, 0.01), curve, strict=True):
            samples = []
            for photo in two:
                # The projection is affine over a patch.
                middle, right, up = (
                    photo.camera.project((point + offset * normal + radius * sample_m * d)[None])[
                        0
                    ][0]
                    for d in (np.zeros(3), across, along)
                )
                samples.append(
                    np.array(
                        [
                            [
                                bilinear(
                                    photo.values,
                                    *(
                                        middle
                                        + q / radius * (right - middle)
                                        + r / radius * (up - middle)
                                    ),
                                )
                                for q in way
                            ]
                            for r in way
                        ]
                    )
                )
            a, b = samples
            both = (a > OUTSIDE / 2) & (b > OUTSIDE / 2)
            lost = (~both).sum() > 0.4 * both.size
            exact = -1.0 if lost else correlated(a, np.where(both, b, 0.0), weights * both, 0.02**2)
            assert value == pytest.approx(exact, abs=2e-3)
    assert (found > -0.9).mean() > 0.5


@pytest.mark.parametrize("settings", [{"match": MatchSettings(radius_px=8)},
                                      {"narrow": NarrowSettings(radius=8)}])  # fmt: skip
def test_wider_windows_than_the_kernels_read_are_refused(settings) -> None:
    with pytest.raises(HarnessError, match="cannot search with these settings") as caught:
        StereoSettings(**settings)
    assert "15 x 15" in str(caught.value)

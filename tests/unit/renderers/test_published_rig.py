"""The recipe ``published8`` photographs as the authors' public example does."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from harness.core.artifacts import Capture
from harness.core.camera_frames import read_published_cameras
from harness.core.mesh import Mesh
from harness.data.manifest import Dataset, load_manifest
from harness.data.scans import load_scan
from harness.files.obj import write_obj
from harness.geometry.images import load_rgba, save_png
from renderers.capture import capture

ROOT = Path(__file__).parents[3]
RECIPE = load_manifest(ROOT / "data_manifest.yaml").recipe("published8")
#: The same cameras at a hundredth of the pixels, drawn by ray casting.
SMALL = replace(
    RECIPE,
    width=192,
    height=108,
    renderer="raycast",
    light_strength=1.0,
    key_light_strength=0.0,
    minimum_mask_iou=0.97,
)
#: Colours of the figure by the side that it shows: its face is red and its left is blue.
FRONT, LEFT, BACK, RIGHT = (200, 30, 30), (40, 60, 200), (30, 160, 30), (220, 200, 40)


def test_the_recipe_has_the_published_cameras(published_camera_file):
    published = read_published_cameras(published_camera_file)
    for theirs, ours in zip(published, RECIPE.cameras(), strict=True):
        assert ours.size == theirs.size == (1920, 1080)
        np.testing.assert_allclose(ours.K, theirs.K, atol=1e-6)
        np.testing.assert_allclose(ours.position, theirs.position, atol=1e-6)
        np.testing.assert_allclose(ours.rotation, theirs.rotation, atol=1e-6)


@pytest.fixture(scope="module")
def person(tmp_path_factory):
    """As high and as far off its origin as the published scan, in its own units, facing +Z."""
    folder = tmp_path_factory.mktemp("scans") / "model" / "0001"
    folder.mkdir(parents=True)
    low, high = np.array([-0.18, -0.476, -0.12]), np.array([0.19, 0.345, 0.08])
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    # Two triangles a side: -x, +x, -y, +y, -z, +z; each side has one texel of the texture.
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([f for a, b, c, d in sides for f in ((a, b, c), (a, c, d))])
    colours = (RIGHT, LEFT, BACK, FRONT, BACK, FRONT)
    texture = np.repeat(np.array([colours], dtype=np.uint8), 8, axis=1).repeat(16, axis=0)
    save_png(folder / "material0.png", texture)
    uv = np.array([[(side + 0.5) / 6, 0.5] for side in range(6)])
    face_uv = np.repeat(np.arange(6), 2)[:, None].repeat(3, axis=1)
    write_obj(folder / "0001.obj", Mesh(low + corners * (high - low), faces, uv, face_uv))
    (folder / "material0.mtl").write_text("newmtl material0\nmap_Kd material0.png\n")
    dataset = Dataset(
        title="Scans in their own units",
        kind="thuman",
        licence="own",
        root="scans",
        scale="units",
        facing="+z",
        subjects=("0001",),
    )
    return load_scan("toy", dataset, folder.parents[1], "0001")


@pytest.fixture(
    scope="module", params=["raycast", pytest.param("blender", marks=pytest.mark.nightly)]
)
def photos(request, person, tmp_path_factory):
    recipe = replace(SMALL, renderer=request.param)
    return capture(*person, recipe, tmp_path_factory.mktemp("photos") / "published8")


def colour(path):
    rgba = load_rgba(path, (192, 108))
    return np.median(rgba[rgba[..., 3] == 255][:, :3], axis=0)


def test_views_are_filed_under_the_published_numbers(photos):
    assert photos.warnings == ()
    for view, expected in ((6, FRONT), (0, LEFT), (2, BACK), (4, RIGHT)):
        assert colour(photos.image_path(view)) == pytest.approx(expected, abs=12), view
    # Camera 7 has the front in the picture's left half, the subject's left in the right.
    rgba = load_rgba(photos.image_path(7))
    columns = [
        np.nonzero((rgba[..., 3] == 255) & (np.abs(rgba[..., :3] - np.array(c)).max(2) < 9))[1]
        for c in (FRONT, LEFT)
    ]
    assert np.median(columns[0]) < np.median(columns[1])


def test_methods_see_them_counted_from_the_front(photos):
    seen = Capture.load(photos.directory).from_front()
    for view, expected in ((0, FRONT), (2, LEFT), (4, BACK), (6, RIGHT)):
        assert colour(seen.image_path(view)) == pytest.approx(expected, abs=12), view


def test_the_scan_fills_as_many_rows_as_in_the_published_frames(photos):
    rgba = load_rgba(photos.image_path(6))
    rows = np.flatnonzero((rgba[..., 3] > 127).any(axis=1))
    # 740 of 1080 rows, and lower than the middle, for the scan keeps its own origin.
    assert len(rows) == pytest.approx(74, abs=3)
    assert rows.mean() + 0.5 == pytest.approx(54 + 266.7 * 0.0655 / 2.92, abs=1.5)


def test_the_published_cameras_at_that_size_took_these_photos(photos, published_camera_file):
    published = read_published_cameras(published_camera_file)
    for theirs, ours in zip(published, photos.cameras, strict=True):
        small = theirs.resized(192, 108)
        np.testing.assert_allclose(ours.K, small.K, atol=1e-6)
        np.testing.assert_allclose(ours.position, small.position, atol=1e-6)
        np.testing.assert_allclose(ours.rotation, small.rotation, atol=1e-6)

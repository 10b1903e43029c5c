"""Photos as cameras take them, and cameras as calibrations find them."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from harness.core.artifacts import Capture
from harness.core.camera import Camera
from harness.core.errors import DataError
from harness.core.rigs import PhotoFaults, RingRig
from harness.geometry.images import load_rgba
from renderers.capture import CaptureInputs, calibrated, capture, photographed, reprojection_px

BOUNDS = np.array([[-0.4, -0.9, -0.3], [0.4, 0.9, 0.3]])


def flat(level: int, size: int = 128) -> np.ndarray:
    rgba = np.full((size, size, 4), level, np.uint8)
    rgba[..., 3] = 255
    return rgba


def test_without_faults_a_photo_stays():
    rng = np.random.default_rng(0)
    rgba = rng.integers(0, 256, (40, 30, 4)).astype(np.uint8)
    rgba[rgba[..., 3] == 0, :3] = 0
    np.testing.assert_array_equal(photographed(rgba, PhotoFaults(), 3), rgba)


def test_noise_at_middle_grey_is_as_stated_and_grows_with_the_light():
    faults = PhotoFaults(noise=4.0)
    spread = [photographed(flat(v), faults, 1)[..., :3].std() for v in (40, 128, 200)]
    assert spread[1] == pytest.approx(4.0, rel=0.05)
    # In sRGB, shot noise is spread more evenly than in light, but it is not the same everywhere.
    assert abs(spread[0] - spread[1]) > 0.1
    means = photographed(flat(128), faults, 1)[..., :3].mean()
    assert means == pytest.approx(128, abs=0.2)


def test_exposure_differs_from_view_to_view_and_alike_in_all_pixels():
    faults = PhotoFaults(exposure_stops=0.3)
    levels = [np.unique(photographed(flat(120), faults, seed)[..., :3]) for seed in range(8)]
    assert all(len(level) == 1 for level in levels)
    assert len(np.unique(levels)) > 4


def test_blur_spreads_an_edge_and_stays_within_the_subject():
    rgba = flat(60)
    rgba[:, 64:, :3] = 180
    rgba[:, :10] = 0
    blurred = photographed(rgba, PhotoFaults(blur_px=2.0), 0)
    np.testing.assert_array_equal(blurred[..., 3], rgba[..., 3])
    assert len(np.unique(blurred[64, 58:70, 0])) > 6
    np.testing.assert_allclose(blurred[64, 10:20, 0], 60, atol=1)
    assert not blurred[:, :10].any()


def test_compression_changes_little_and_equal_seeds_give_equal_photos():
    rng = np.random.default_rng(2)
    rgba = flat(128)
    rgba[..., :3] += rng.integers(0, 30, (128, 128, 1)).astype(np.uint8)
    faults = PhotoFaults(noise=2.0, jpeg_quality=92)
    first, again, other = (photographed(rgba, faults, seed) for seed in (5, 5, 6))
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()
    assert 1 < np.abs(first[..., :3].astype(int) - rgba[..., :3]).mean() < 6


@pytest.mark.parametrize("error_px", [0.3, 1.0, 5.0])
def test_cameras_are_off_by_what_is_stated(error_px):
    exact = RingRig(views=8).cameras(1080, 1920)
    given = calibrated(exact, BOUNDS, error_px, 4)
    off = [reprojection_px(a, b, BOUNDS) for a, b in zip(exact, given, strict=True)]
    np.testing.assert_allclose(off, error_px, rtol=1e-3)
    again = calibrated(exact, BOUNDS, error_px, 4)
    assert [c.to_dict() for c in given] == [c.to_dict() for c in again]
    assert calibrated(exact, BOUNDS, 0.0, 4) == exact


@pytest.mark.parametrize(
    "faults", [{"noise": -1.0}, {"jpeg_quality": 101}, {"calibration_px": float("nan")}]
)
def test_impossible_faults_are_refused(faults):
    with pytest.raises(DataError, match=next(iter(faults))):
        PhotoFaults(**faults)


def test_a_capture_keeps_the_exact_cameras_in_its_proof(figure, scan, recipe, tmp_path):
    faults = PhotoFaults(noise=3.0, calibration_px=1.0)
    exact = capture(scan, figure, recipe, tmp_path / "exact")
    taken = capture(scan, figure, replace(recipe, photo=faults), tmp_path / "taken")
    assert taken.key != exact.key
    loaded = Capture.load(tmp_path / "taken")
    true_cameras = [Camera.from_dict(c) for c in loaded.provenance["exact_cameras"]]
    assert [c.to_dict() for c in true_cameras] == [c.to_dict() for c in recipe.cameras()]
    np.testing.assert_allclose(loaded.provenance["calibration_px"], 1.0, rtol=1e-3)
    assert loaded.cameras[0].to_dict() != recipe.cameras()[0].to_dict()
    assert min(p["mask_iou"] for p in loaded.provenance["proof"]) > 0.98
    first, second = (load_rgba(each.image_path(0)) for each in (exact, taken))
    np.testing.assert_array_equal(first[..., 3], second[..., 3])
    assert (first[..., :3] != second[..., :3]).any()
    assert loaded.damage() == ""
    assert "exact_cameras" not in exact.provenance


def test_a_camera_s_faults_over_copied_pictures_are_those_over_rendered_ones(
    figure, scan, recipe, tmp_path, monkeypatch
):
    faulty = replace(recipe, name="camera", photo=PhotoFaults(noise=3.0, calibration_px=1.0))
    assert recipe.is_exact_of(faulty)
    assert not recipe.is_exact_of(recipe)
    assert not replace(recipe, samples=1 + recipe.samples).is_exact_of(faulty)
    exact = capture(scan, figure, recipe, tmp_path / "exact")
    rendered = capture(scan, figure, faulty, tmp_path / "rendered")
    monkeypatch.setattr("renderers.capture.RENDERERS.resolve", lambda _: pytest.fail("rendered"))
    told = []
    copied = capture(
        scan, figure, faulty, tmp_path / "copied", lambda *views: told.append(views), exact
    )
    assert copied.key == rendered.key
    assert copied.provenance["images"] == rendered.provenance["images"]
    assert copied.provenance["pictures_of"] == recipe.name
    assert copied.warnings == rendered.warnings
    assert told[-1] == (len(exact.cameras), len(exact.cameras))


def test_each_fault_is_part_of_the_key_and_exact_recipes_keep_theirs(scan, recipe):
    exact = CaptureInputs.of(scan, recipe, "CPU")
    assert "photo" not in json.dumps(exact.to_dict()["recipe"])
    keys = {exact.key}
    for faults in (PhotoFaults(), PhotoFaults(noise=1.0), PhotoFaults(calibration_px=0.3)):
        keys.add(CaptureInputs.of(scan, replace(recipe, photo=faults), "CPU").key)
    assert len(keys) == 4

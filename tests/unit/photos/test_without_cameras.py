"""Photos without cameras, or with inexact ones: what was found is said, and nothing is guessed."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest

import methods.cameras.estimate as estimate_module
from harness.core.artifacts import Capture
from harness.core.errors import HarnessError, MethodError
from harness.core.process.threads import silent
from harness.core.protocols import MethodInfo, Privilege
from harness.photos.importing import import_photos
from harness.photos.request import ImportRequest
from harness.run.view_choice import as_given
from methods.cameras.values import EstimatedCameras, PhotoReport

INFO = MethodInfo("m", "M", privileges=(Privilege.KNOWN_CAMERAS,))


@pytest.fixture
def photos(native, tmp_path):
    return shutil.copytree(native.directory / "rgb", tmp_path / "maria")


def asked(photos, **more) -> ImportRequest:
    directory = photos.parent / "in"
    request = ImportRequest(str(photos), "", str(directory), "captures", "t", "imported")
    return replace(request, height_m=1.74, **more)


class Estimator:
    """Finds the true cameras, without the photo that is left out; counts how often."""

    def __init__(self, native, leave=-1):
        self.native, self.leave, self.calls = native, leave, []

    def answer(self, photos, cameras):
        there = [None if k == self.leave else camera for k, camera in enumerate(cameras)]
        return EstimatedCameras(
            cameras=tuple(there),
            covariances=tuple(camera and 1e-6 * np.eye(6) for camera in there),
            focal_px=tuple(float(camera.K[0, 0]) for camera in cameras),
            focal_relative_sd=0.0,
            stages=(),
            photos=tuple(
                PhotoReport(photo.name, np.nan, 0, np.nan, "it moved")
                if k == self.leave
                else PhotoReport(photo.name, 0.1, 9, 0.2)
                for k, photo in enumerate(photos)
            ),
            contradiction_mm=0.3,
            warnings=("five photos are few",),
        )

    def estimate(self, photos, *, focal, height_m, report):
        self.calls.append((focal, height_m))
        report(9, 9)
        return self.answer(photos, self.native.cameras)

    def refine(self, photos, cameras, *, report):
        self.calls.append(cameras)
        report(9, 9)
        return self.answer(photos, self.native.cameras)


def test_photos_alone_become_a_capture_that_says_so(native, photos, monkeypatch):
    estimator = Estimator(native)
    monkeypatch.setattr(estimate_module, "estimate_cameras", estimator.estimate)
    steps = []
    made = import_photos(asked(photos), lambda *step: steps.append(step))
    capture = Capture.load(made.path)
    for found, true in zip(capture.cameras, native.cameras, strict=True):
        np.testing.assert_allclose(found.world_to_camera, true.world_to_camera, atol=1e-12)
    assert steps[-2:] == [(8, 8), (9, 9)]
    assert capture.provenance["imported"]["cameras"] == "estimated"
    estimate = capture.provenance["estimate"]
    assert (estimate["focal"], estimate["height_m"]) == ("found", 1.74)
    assert "cameras were estimated from the photos" in made.notes[0]
    assert "one for all photos" in made.notes[1]
    assert made.warnings == ("five photos are few",)
    ((focal, _),) = estimator.calls
    assert focal.relative_sd > 0
    assert as_given(INFO, capture).privileges == ()

    again = import_photos(asked(photos), silent)
    assert again.notes == made.notes
    assert len(estimator.calls) == 1
    import_photos(asked(photos, field_deg=50.0), silent)
    assert estimator.calls[1][0].relative_sd == 0
    assert estimator.calls[1][0].px[0] == pytest.approx(80 / np.tan(np.radians(25)))
    given = as_given(INFO, Capture.load(made.path))
    assert given.privileges == (Privilege.FOCAL_LENGTH,)


def test_a_photo_that_is_left_out_is_named_and_its_place_is_taken(native, photos, monkeypatch):
    monkeypatch.setattr(estimate_module, "estimate_cameras", Estimator(native, leave=2).estimate)
    made = import_photos(asked(photos), silent)
    capture = Capture.load(made.path)
    assert made.views == len(capture.cameras) == 7
    assert made.warnings[-1] == "02.png was left out: it moved"
    assert not capture.damage()
    names = [view["photo"] for view in capture.provenance["imported"]["views"]]
    assert names == [f"{k:02d}.png" for k in (0, 1, 3, 4, 5, 6, 7)]


def test_masks_beside_the_photos_are_no_photos(native, photos, monkeypatch):
    for path in sorted(photos.iterdir()):
        shutil.copy(path, photos / f"{path.stem}_mask.png")
    monkeypatch.setattr(estimate_module, "estimate_cameras", Estimator(native).estimate)
    assert import_photos(asked(photos), silent).views == 8


def test_given_cameras_are_refined_where_asked(native, photos, monkeypatch):
    estimator = Estimator(native)
    monkeypatch.setattr(estimate_module, "refine_cameras", estimator.refine)
    monkeypatch.setattr(estimate_module, "estimate_cameras", None)
    cameras = str(native.directory / "capture.json")
    request = replace(
        asked(native.directory, refine=True), cameras=cameras, height_m=0.0,
        directory=str(photos.parent / "in"),
    )  # fmt: skip
    made = import_photos(request, silent)
    capture = Capture.load(made.path)
    assert made.notes[-1].startswith("cameras were refined: by 0.00 degrees and 0.0 mm")
    assert "refined" in capture.provenance
    assert as_given(INFO, capture).privileges == (Privilege.KNOWN_CAMERAS,)
    import_photos(request, silent)
    assert len(estimator.calls) == 1
    import_photos(replace(request, refine=False), silent)
    assert "refined" not in Capture.load(made.path).provenance


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"height_m": 0.0}, "the height of the person in .* has to be told"),
        ({"height_m": 172.0}, "--height 172"),
        ({"field_deg": 200.0}, "--fov 200"),
        ({"up": "+z"}, "--up for photos without cameras"),
        ({"facing": "00.png"}, "--facing for photos without cameras"),
        ({"scale": "0.01"}, "--scale for photos without cameras"),
        ({"refine": True}, "--refine-cameras for photos without cameras"),
    ],
)
def test_what_only_a_camera_file_could_mean_is_refused(photos, more, said):
    with pytest.raises(HarnessError, match=said):
        import_photos(replace(asked(photos), **more), silent)
    assert not (photos.parent / "in").exists()


@pytest.mark.parametrize("count", [1, 4])
def test_too_few_photos_are_refused(photos, count):
    for path in sorted(photos.iterdir())[count:]:
        path.unlink()
    with pytest.raises(MethodError, match=f"from so many photos.*5 to 64.*{count}"):
        import_photos(asked(photos), silent)
    assert not (photos.parent / "in").exists()

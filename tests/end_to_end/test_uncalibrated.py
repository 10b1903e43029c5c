"""Cameras withheld: what was found decides, and a Sim(3) by cameras brings it to the scan."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import methods.cameras.estimate as estimate_module
from harness.core.artifacts import Capture
from harness.core.camera import Camera
from harness.core.errors import HarnessError, MethodError
from harness.core.process.threads import silent
from harness.core.protocols import Privilege
from harness.core.records import Record
from harness.data.manifest import load_manifest
from harness.geometry.similarity import Similarity
from harness.report.figures import FIGURES
from harness.report.tables import ReportRequest, build_table
from harness.run import cell_worker
from harness.run.cell_job import CellJob
from harness.run.evaluate import _record
from harness.run.method_choice import chosen_methods
from harness.run.plan import EvalRequest, SubjectFiles
from harness.run.sources import Source
from harness.run.store import RunStore
from harness.run.uncalibrated import camera_suffix
from harness.run.workspace import Workspace
from methods.cameras.values import EstimatedCameras, PhotoReport

TURN = np.array([[np.cos(0.1), 0, np.sin(0.1)], [0, 1, 0], [-np.sin(0.1), 0, np.cos(0.1)]])
#: The world that is found: turned, larger, elsewhere.
OWN = Similarity(1.02, TURN, np.array([0.01, -0.02, 0.03]))


def found(cameras: list[Camera], leave: int = -1) -> EstimatedCameras:
    """These cameras in a world of their own, without the one that is left out."""
    there = [None if k == leave else OWN.camera(each) for k, each in enumerate(cameras)]
    return EstimatedCameras(
        cameras=tuple(there),
        covariances=tuple(None if each is None else np.eye(6) for each in there),
        focal_px=tuple(float(each.K[0, 0]) for each in cameras),
        focal_relative_sd=0.0,
        stages=(),
        photos=tuple(
            PhotoReport(f"photo {k}", np.nan, 0, np.nan, "it fits no other")
            if k == leave
            else PhotoReport(f"photo {k}", 0.1, 20, 0.2)
            for k in range(len(cameras))
        ),
        contradiction_mm=0.3,
    )


@pytest.fixture
def source(world: Path) -> Source:
    manifest = load_manifest(world / "data_manifest.yaml")
    return Source.select(manifest, Workspace(world), "toy", ("t1",), "tiny-uncalibrated")


def evaluated(source: Source, suffix: str = "") -> Record:
    source = replace(source, suffix=suffix)
    (method,) = chosen_methods(["hull8"], {"hull.voxel_m": "0.02"}, "", suffix=suffix)
    protocol = source.manifest.protocol("exact")
    request = EvalRequest(source, (method,), protocol, RunStore(source.workspace.run("main")))
    capture = source.ensure_capture("t1", silent)
    cell = request.cell(method, SubjectFiles(capture, source.scan_of("t1")))
    assert cell.inputs is not None
    folder = source.workspace.root / f"results{suffix}"
    job = CellJob(source, method.ref, "exact", 0, cell.inputs, folder, keep=False)
    result = cell_worker.handle(job, silent)
    assert result.status == "ok", result.reason
    return _record(request, cell, result)


def test_results_of_found_cameras_are_scored_as_those_of_true_ones(source, monkeypatch):
    true = source.calibrated.ensure_capture("t1", silent).cameras
    calls = []

    def estimate(photos, *, focal, height_m, **_):
        calls.append((len(photos), focal, height_m))
        return found(list(true))

    monkeypatch.setattr(estimate_module, "estimate_cameras", estimate)
    plain, ours = evaluated(source), evaluated(source, "-uncalibrated")
    again = source.ensure_capture("t1", silent)

    ((count, focal, height_m),) = calls  # cached by what it is made from
    assert (count, height_m) == (8, 1.6)
    assert focal.relative_sd == 0
    assert focal.px[0] == pytest.approx(true[0].K[0, 0])
    assert source.capture_state("t1") == ("cached", "")
    # The hull is carved in another world, on another grid.
    assert ours.metrics["chamfer"].value == pytest.approx(plain.metrics["chamfer"].value, abs=2.0)
    assert ours.metrics["camera_rotation"].value == pytest.approx(0, abs=1e-5)
    assert ours.metrics["camera_auc_1"].value == pytest.approx(1, abs=1e-5)
    told = np.degrees(np.sqrt(3))  # of the unit covariances above
    assert ours.metrics["camera_rotation_sd"].value == pytest.approx(told, rel=1e-4)
    assert plain.method.privileges == (Privilege.KNOWN_CAMERAS, Privilege.EXACT_MASKS)
    assert ours.method.privileges == (
        Privilege.FOCAL_LENGTH,
        Privilege.ALIGNED,
        Privilege.EXACT_MASKS,
    )
    moved = ours.details["brought_to_scan"]
    assert moved["by"] == ours.diagnostics.alignment == "sim3-cameras"
    assert moved["scale"] == pytest.approx(1 / 1.02)
    assert moved["before_mm"] > moved["after_mm"]
    for camera, goal in zip(again.cameras, true, strict=True):
        np.testing.assert_allclose(camera.world_to_camera, goal.world_to_camera, atol=1e-9)

    drawn = source.workspace.root / "rig.png"
    FIGURES["cameras"](RunStore(source.workspace.run("main")), source, [plain, ours], drawn)
    assert drawn.stat().st_size > 10_000
    table = build_table([plain, ours], ReportRequest("geometry"))
    assert "uncalibrated" in table
    assert "Given: focal length, aligned to the scan, exact masks" in table
    rig = build_table([plain, ours], ReportRequest("cameras"))
    assert "AUC at 5" in rig
    assert "Visual hull, 8 views" in rig


def test_refined_cameras_stay_in_the_world_in_which_they_were_given(source, monkeypatch):
    true = source.calibrated.ensure_capture("t1", silent).cameras
    lifted = np.eye(4)
    lifted[1, 3] = 0.1
    calls = []

    def refine(photos, cameras, **_):
        calls.append(len(photos))
        corrected = tuple(camera.in_frame(lifted) for camera in cameras)
        return replace(found(list(true)), cameras=corrected)

    monkeypatch.setattr(estimate_module, "refine_cameras", refine)
    plain, ours = evaluated(source), evaluated(source, "-refined")
    capture = replace(source, suffix="-refined").ensure_capture("t1", silent)
    assert calls == [8]
    assert ours.recipe == "tiny-refined"
    assert ours.method.title.startswith("Visual hull, 8 views, refined")
    assert ours.method.privileges == plain.method.privileges
    assert "brought_to_scan" not in ours.details
    assert "camera_position" not in plain.metrics
    # Cameras are judged without a common move; of the result nothing takes it away.
    assert ours.metrics["camera_position"].value == pytest.approx(0, abs=1e-6)
    assert ours.metrics["chamfer"].value > plain.metrics["chamfer"].value + 10
    for camera, goal in zip(capture.cameras, true, strict=True):
        np.testing.assert_allclose(camera.position - goal.position, [0, 0.1, 0], atol=1e-9)


def test_a_photo_that_is_left_out_is_named(source, monkeypatch):
    true = list(source.calibrated.ensure_capture("t1", silent).cameras)
    monkeypatch.setattr(estimate_module, "estimate_cameras", lambda *_, **__: found(true, leave=3))
    capture = source.ensure_capture("t1", silent)
    assert len(capture.cameras) == 7
    assert capture.warnings[-1] == "photo 3 was left out: it fits no other"
    pictures = [file.read_bytes() for file in sorted((capture.directory / "rgb").iterdir())]
    photos = Capture.load(source.calibrated.capture_directory("t1"))
    assert pictures[3] == photos.image_path(4).read_bytes()


def test_a_refusal_leaves_no_cameras(source, monkeypatch):
    def estimate(*_, **__):
        raise MethodError("no cameras can be trusted")

    monkeypatch.setattr(estimate_module, "estimate_cameras", estimate)
    with pytest.raises(MethodError, match="trusted"):
        source.ensure_capture("t1", silent)
    assert source.capture_state("t1") == ("missing", "cameras not estimated yet")


def test_changed_photos_need_new_cameras(source, monkeypatch):
    true = list(source.calibrated.ensure_capture("t1", silent).cameras)
    monkeypatch.setattr(estimate_module, "estimate_cameras", lambda *_, **__: found(true))
    made = source.ensure_capture("t1", silent)
    document = replace(made, provenance={**made.provenance, "inputs": {"photos": "others"}})
    assert document.key == made.key
    other = replace(source, suffix="-uncalibrated-all")
    assert other.capture_state("t1")[0] == "missing"
    assert other.capture_directory("t1") != made.directory


def test_a_method_that_is_lent_the_scan_is_refused(source, monkeypatch):
    true = list(source.calibrated.ensure_capture("t1", silent).cameras)
    monkeypatch.setattr(estimate_module, "estimate_cameras", lambda *_, **__: found(true))
    (method,) = chosen_methods(["gt"], {}, suffix="-uncalibrated")
    request = EvalRequest(
        source, (method,), source.manifest.protocol("exact"), RunStore(source.workspace.run("m"))
    )
    capture = source.ensure_capture("t1", silent)
    cell = request.cell(method, SubjectFiles(capture, source.scan_of("t1")))
    job = CellJob(source, method.ref, "exact", 0, cell.inputs, source.workspace.root / "r", False)
    result = cell_worker.handle(job, silent)
    assert result.status == "failed"
    assert "world of their own" in result.reason


def test_cameras_of_imported_photos_are_told_at_their_import(world):
    text = (world / "data_manifest.yaml").read_text()
    entry = (
        "  captures: {title: c, kind: captures, licence: own, root: c, scale: metres, facing: +z}\n"
    )
    (world / "data_manifest.yaml").write_text(text.replace("splits:", entry + "splits:"))
    manifest = load_manifest(world / "data_manifest.yaml")
    with pytest.raises(HarnessError, match="at their import"):
        Source.select(manifest, Workspace(world), "captures", (), "tiny-uncalibrated")


def test_how_cameras_are_known_is_one_of_four_words():
    assert camera_suffix("given") == ""
    assert camera_suffix("estimated-all") == "-uncalibrated-all"
    words = "given or refined or estimated or estimated-all"
    with pytest.raises(HarnessError, match=f"--cameras known.*{words}"):
        camera_suffix("known")

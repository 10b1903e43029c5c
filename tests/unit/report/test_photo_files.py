"""Figures without a scan beside records: made once, kept, and made anew when anything changes."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from harness.core.artifacts import Capture, image_name
from harness.core.errors import DataError, HarnessError
from harness.core.files.atomic import write_json
from harness.core.files.hashing import file_sha256
from harness.core.mesh import Mesh
from harness.core.process.source_digest import SourceTree
from harness.core.rigs import RingRig
from harness.data.manifest import load_manifest
from harness.files.mesh_files import save_mesh
from harness.geometry.images import save_png
from harness.geometry.raycast import Raycaster
from harness.report import tables as photo_files
from harness.report.tables import (
    FORMATS,
    PHOTOS_FILE,
    PhotoFiles,
    PhotoReport,
    ReportRequest,
    build_photo_table,
)
from harness.run.progress import Silent
from harness.run.store import RunStore
from harness.run.workspace import Workspace

GOLDEN = RunStore(Path(__file__).parents[2] / "golden" / "run").records()
TEMPLATE = next(r for r in GOLDEN if r.method_name == "hull8" and r.status == "ok")


def ball(radius: float = 0.4) -> Mesh:
    made = trimesh.creation.icosphere(subdivisions=3, radius=radius)
    return Mesh(made.vertices, made.faces, source="ball")


@pytest.fixture(autouse=True)
def coarse_colours(monkeypatch: pytest.MonkeyPatch) -> None:
    """Vertices as far apart as two pixels of these small photos."""
    monkeypatch.setattr("metrics.photos._MOST_VERTICES", 3000)


@pytest.fixture
def workspace(tmp_path: Path) -> Workspace:
    """Three photos of a ball, and a record of a method that found it."""
    place = Workspace(tmp_path)
    folder = place.capture(TEMPLATE.dataset, TEMPLATE.subject, TEMPLATE.recipe)
    cameras = RingRig(views=3).cameras(90, 160)
    caster = Raycaster(ball())
    for view, camera in enumerate(cameras):
        mask = caster.mask(camera)
        save_png(folder / image_name(view), np.where(mask[..., None], 200, 0).astype(np.uint8)
                 * np.ones(4, np.uint8))  # fmt: skip
    images = {image_name(view): file_sha256(folder / image_name(view)) for view in range(3)}
    capture = Capture(
        TEMPLATE.dataset, TEMPLATE.subject, TEMPLATE.recipe, "photos-1", folder, cameras,
        provenance={"images": images},
    )  # fmt: skip
    write_json(folder / "capture.json", capture.to_dict())
    store = RunStore(place.run("main"))
    store.begin()
    cell = store.cell(TEMPLATE.method_name, TEMPLATE.subject).directory
    save_mesh(cell / "mesh.ply", ball())
    record = replace(
        TEMPLATE,
        capture=replace(TEMPLATE.capture, key="photos-1", warnings=()),
        files={"mesh.ply": file_sha256(cell / "mesh.ply")},
    )
    record.save(cell / "record.json")
    return place


def store_of(workspace: Workspace) -> RunStore:
    return RunStore(workspace.run("main"))


def figures(workspace: Workspace):
    store = store_of(workspace)
    return PhotoFiles(store, workspace).figures(store.records(), Silent())


def test_figures_are_made_once_and_the_record_stays_as_it_is(workspace, monkeypatch):
    cell = store_of(workspace).cell(TEMPLATE.method_name, TEMPLATE.subject).directory
    before = (cell / "record.json").read_bytes()
    ((name, made),) = figures(workspace).scores.items()
    assert name == (TEMPLATE.method_name, TEMPLATE.subject)
    assert made.worst_iou == 1.0
    assert len(made.views) == 3
    assert made.soundness.watertight
    assert (cell / "record.json").read_bytes() == before

    def never(*_):
        raise AssertionError("made again")

    monkeypatch.setattr(photo_files, "photo_quality", never)
    assert figures(workspace).scores[name] == made


def test_figures_of_something_else_are_made_anew(workspace):
    figures(workspace)
    store = store_of(workspace)
    cell = store.cell(TEMPLATE.method_name, TEMPLATE.subject).directory
    document = json.loads((cell / PHOTOS_FILE).read_text())
    write_json(cell / PHOTOS_FILE, {**document, "key": "another"})
    files = PhotoFiles(store, workspace)
    assert len(files.waiting(store.records())) == 1
    files.figures(store.records(), Silent())
    assert json.loads((cell / PHOTOS_FILE).read_text()) == document


def test_a_mesh_that_the_record_did_not_measure_is_refused(workspace):
    cell = store_of(workspace).cell(TEMPLATE.method_name, TEMPLATE.subject).directory
    save_mesh(cell / "mesh.ply", ball(0.3))
    with pytest.raises(DataError, match="is not what its record measured"):
        figures(workspace)


def test_photos_that_are_gone_or_others_are_told(workspace):
    folder = workspace.capture(TEMPLATE.dataset, TEMPLATE.subject, TEMPLATE.recipe)
    document = json.loads((folder / "capture.json").read_text())
    write_json(folder / "capture.json", {**document, "key": "photos-2"})
    assert list(figures(workspace).absent.values()) == ["its photos were made anew since"]
    (folder / "capture.json").unlink()
    found = figures(workspace)
    assert list(found.absent.values()) == ["its photos are not there any more"]
    assert not found.scores


@pytest.mark.parametrize("form", FORMATS)
def test_the_table_in_every_format(workspace, form):
    request = ReportRequest(table="photos", format=form)
    report = PhotoReport(request, store_of(workspace), load_manifest(None), workspace)
    text = build_photo_table(report, Silent())
    assert "Visual hull" in text
    assert "Held-out PSNR" in text or "held_out_psnr" in text


def test_what_cannot_be_reported_is_refused_before_anything_is_measured(workspace, monkeypatch):
    monkeypatch.setattr(photo_files, "photo_quality", lambda *_: 1 / 0)
    store, manifest = store_of(workspace), load_manifest(None)
    for request, match in (
        (ReportRequest(table="photos", format="latx"), "unknown format"),
        (ReportRequest(table="photos", methods=("econ",)), "no record of method 'econ'"),
        (ReportRequest(table="photos", subjects=("nobody",)), "there are no records"),
    ):
        with pytest.raises(HarnessError, match=match):
            build_photo_table(PhotoReport(request, store, manifest, workspace), Silent())


def test_too_few_reconstructions_have_no_correlation(workspace):
    request = ReportRequest(table="photo-errors")
    report = PhotoReport(request, store_of(workspace), load_manifest(None), workspace)
    with pytest.raises(HarnessError, match="no method has the numbers of the table 'photo-errors'"):
        build_photo_table(report, Silent())


@pytest.mark.parametrize("root", ["harness.run.cell", "harness.run.mesh_scores"])
def test_no_record_depends_on_the_code_of_these_figures(root):
    modules = SourceTree.installed().digest([root]).modules
    own = ("metrics.photos", "harness.geometry.colouring", "harness.core.photo_scores",
           "harness.run.photo_figures")  # fmt: skip
    assert modules
    assert not [name for name in modules if name.startswith(own)]

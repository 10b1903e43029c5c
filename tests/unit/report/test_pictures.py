"""Which records, subjects and methods a figure of a run shows."""

import functools
import tempfile
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from harness.core.artifacts import Scan
from harness.core.errors import DataError, HarnessError
from harness.core.files.hashing import file_sha256
from harness.core.mesh import Mesh
from harness.core.protocols import MethodInfo, Privilege
from harness.core.records import CaptureStamp, ProtocolStamp, Record, RegionErrors
from harness.files.mesh_files import save_mesh
from harness.report import figures as pictures
from harness.run.store import RunStore

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], float)
MESH = Mesh(CORNERS, np.array([[0, 1, 2], [1, 3, 2]]))
SUBJECTS = tuple("abcdef")


@functools.cache
def mesh_sha256():
    with tempfile.TemporaryDirectory() as folder:
        save_mesh(Path(folder, "mesh.ply"), MESH)
        return file_sha256(Path(folder, "mesh.ply"))


def errors(completeness):
    return RegionErrors(
        area_share=0.5,
        accuracy_mm=1.0,
        completeness_mm=completeness,
        normal_error_deg=5.0,
        missing_share=0.0,
        bulge_share=0.0,
        n_predicted=10,
        n_truth=10,
    )


def record(method, subject, worst=None, privileges=(), status="ok"):
    return Record(
        key="",
        method=MethodInfo(method, method.upper(), privileges=tuple(privileges)),
        dataset="toy",
        subject=subject,
        recipe="tiny",
        protocol=ProtocolStamp("exact", 1, ""),
        capture=CaptureStamp(),
        seed=0,
        status=status,
        regions={"left": errors(worst), "right": errors(2.0)} if worst else {},
        files={"mesh.ply": mesh_sha256()} if status == "ok" else {},
    )


@pytest.fixture
def run(tmp_path, monkeypatch):
    """``run(records, subjects)``: the rows that the failure figure is drawn from."""
    labels = tmp_path / "labels.npz"
    np.savez(labels, face_labels=np.array([0, 1], np.int16), names=np.array(["left", "right"]))
    scan = Scan("toy", "", tmp_path / "x.obj", "metres", "+z", np.eye(4), {}, labels_path=labels)
    drawn = {}
    monkeypatch.setattr(
        "harness.report.figures.failure_grid",
        lambda rows, _, scale: drawn.update(rows=rows, label=scale.label),
    )
    store = RunStore(tmp_path / "run")

    def draw(records, subjects=SUBJECTS, scan=scan, scale_rule="metres", spoilt=None):
        for one in records:
            if one.status == "ok":
                save_mesh(store.cell(one.method_name, one.subject).directory / "mesh.ply", MESH)
        if spoilt:
            save_mesh(
                store.cell(*spoilt).directory / "mesh.ply", replace(MESH, vertices=2 * CORNERS)
            )
        source = SimpleNamespace(
            subjects=subjects, load=lambda _: (scan, MESH), capture=str, scale_rule=scale_rule
        )
        pictures.failures(store, source, records, tmp_path / "failures.png")
        return drawn["rows"]

    draw.scan, draw.drawn = scan, drawn
    return draw


def test_the_four_worst_subjects_are_shown_worst_first(run):
    rows = run([record("m", subject, 10.0 + 5 * i) for i, subject in enumerate(SUBJECTS)])
    assert [row.capture for row in rows] == list("fedc")
    assert rows[0].panels[0].found.failure.text == "left: 35 mm"
    assert rows[0].face_regions.tolist() == ["left", "right"]
    assert rows[0].panels[0].found.errors_mm == pytest.approx(np.zeros(4), abs=1e-3)


def test_colours_say_whether_they_are_of_millimetres(run):
    run([record("m", "a", 10.0)])
    assert run.drawn["label"] == "distance to the true surface (mm)"
    run([record("m", "a", 10.0)], scale_rule="units")
    assert run.drawn["label"].endswith("(thousandths of a scan unit)")


def test_only_subjects_that_were_asked_for_are_shown(run):
    records = [record("m", subject, 10.0) for subject in SUBJECTS]
    assert [row.capture for row in run(records, ("b", "a"))] == ["a", "b"]


def test_a_method_that_failed_on_a_subject_keeps_its_place(run):
    rows = run(
        [
            record("m", "a", 10.0),
            record("m", "b", 9.0),
            record("n", "a", status="failed"),
            record("n", "b", 5.0),
            record("gt", "a", 99.0, privileges=[Privilege.GROUND_TRUTH_MESH]),
            record("unlabelled", "a"),
        ]
    )
    assert [panel.title for panel in rows[0].panels] == ["M", "N"]
    assert [panel.found is None for panel in rows[0].panels] == [False, True]
    assert [panel.found is None for panel in rows[1].panels] == [False, False]


def test_records_without_regions_are_refused_with_the_next_step(run):
    with pytest.raises(HarnessError, match="has errors by region.*scans have labels"):
        run([record("m", "a")])


def test_labels_that_are_gone_are_not_overlooked(run):
    with pytest.raises(DataError, match="no labels any more"):
        run([record("m", "a", 10.0)], scan=replace(run.scan, labels_path=None))


def test_a_mesh_that_is_not_the_records_is_refused(run):
    records = [record("m", "a", 10.0), record("m", "b", 9.0)]
    with pytest.raises(DataError, match=r"m/b/mesh\.ply is not what its record measured") as caught:
        run(records, spoilt=("m", "b"))
    assert "\n" not in str(caught.value)


def test_a_record_that_does_not_tell_its_mesh_is_refused(run):
    with pytest.raises(DataError, match="the record of m on a has no mesh.ply.*Evaluate again"):
        run([replace(record("m", "a", 10.0), files={})])

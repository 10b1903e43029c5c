"""Lengths in scan units are scored as they are, say so in every format, and never meet metres."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from harness.core.errors import ProtocolMismatch
from harness.core.mesh import Mesh
from harness.core.settings import MetricProtocol
from harness.data.manifest import Dataset
from harness.files.obj import write_obj
from harness.geometry.images import save_png
from harness.report.tables import FORMATS, TABLES, ReportRequest, build_table
from harness.run.external_meshes import FolderRequest, score_folder
from harness.run.progress import Silent
from harness.run.sources import ScanSet
from harness.run.store import RunStore
from reports.tables.geometry import geometry_table

GOLDEN = RunStore(Path(__file__).parents[2] / "golden" / "run").records()
PROTOCOL = MetricProtocol("exact", 1, 2000, "stratified", "point-to-surface")


def plate(shift: float) -> Mesh:
    """A person-sized slab in scan units, away from the origin, moved along its normal."""
    x, y = np.meshgrid(np.linspace(-0.2, 0.2, 9), np.linspace(-0.5, 0.3, 17), indexing="ij")
    points = np.stack([x.ravel(), y.ravel(), np.full(x.size, 0.1 + shift)], axis=1)
    index = np.arange(x.size).reshape(x.shape)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)]).reshape(-1, 3)
    return Mesh(points, faces, np.zeros((1, 2)), np.zeros_like(faces))


@pytest.fixture(scope="module")
def records(tmp_path_factory):
    """A plate that lies 0.02 units before the true one, scored under each of two rules."""
    place = tmp_path_factory.mktemp("place")
    scan = place / "scans" / "model" / "0001"
    for folder, shift in ((scan, 0.0), (place / "meshes", 0.02)):
        folder.mkdir(parents=True)
        write_obj(folder / "0001.obj", plate(shift))
        (folder / "material0.mtl").write_text("newmtl material0\nmap_Kd material0.png\n")
        save_png(folder / "material0.png", np.full((8, 8, 3), 200, np.uint8))

    def scored(scale, name):
        dataset = Dataset(
            title="Plates", kind="thuman", licence="own", root="scans",
            scale=scale, facing="+z", subjects=("0001",),
        )  # fmt: skip
        store = RunStore(place / name)
        target = ScanSet("plates", dataset, place / "scans", ("0001",))
        request = FolderRequest(place / "meshes", name, name, target, PROTOCOL, store)
        return score_folder(request, Silent())[0].record

    return scored("units", "own"), scored("metres", "centred")


def test_a_thousandth_of_a_unit_is_printed_as_a_millimetre(records):
    own, centred = records
    assert own.status == "ok", own.reason
    assert own.scale_rule == "units"
    assert own.metrics["p2s_accuracy"].value == pytest.approx(20.0, abs=1e-3)
    # Under a rule that centres the scan the same files lie apart, where they do not belong.
    assert centred.scale_rule == "metres"
    assert centred.metrics["p2s_accuracy"].value == pytest.approx(120.0, abs=20)


def test_the_rule_is_read_back_from_the_record(records, tmp_path):
    own, _ = records
    path = tmp_path / "record.json"
    own.save(path)
    assert type(own).load(path, own.method_name, own.subject).length_unit == "scan unit"


def test_scan_units_and_metres_never_share_a_table(records):
    own, centred = records
    # One dataset name, as after an edit of the manifest: the rule alone tells them apart.
    assert own.dataset == centred.dataset
    with pytest.raises(ProtocolMismatch, match="unit of length.*'scan unit'.*'metre'"):
        geometry_table([own, centred])
    with pytest.raises(ProtocolMismatch, match="unit of length"):
        geometry_table([centred, own])
    assert geometry_table([own]).rows


@pytest.mark.parametrize("form", FORMATS)
def test_every_format_says_what_a_millimetre_is(form):
    plain = build_table(GOLDEN, ReportRequest(format=form))
    own = [replace(record, scale_rule="units") for record in GOLDEN]
    assert "thousandths of a scan unit" not in plain
    assert "thousandths of a scan unit" in build_table(own, ReportRequest(format=form))


@pytest.mark.parametrize("table", ["geometry", "paired", "cost"])
def test_every_table_of_scan_units_has_the_note(table):
    own = [replace(record, scale_rule="units") for record in GOLDEN]
    made = TABLES[table](own)
    assert "mm are thousandths of a scan unit" in made.caption
    assert all("mm: thousandths of a scan unit" in row.notes for row in made.rows if row.n)

"""What a record's key covers: for every method of the catalogue its own code, and no other's."""

from __future__ import annotations

import time
from dataclasses import replace
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest

from harness.core.artifacts import Capture, Scan
from harness.core.process import source_digest
from harness.core.process import source_digest as module_source
from harness.core.process.source_digest import differences
from harness.core.protocols import MethodInfo, Part, Privilege
from harness.core.settings import MetricProtocol
from harness.data.manifest import Dataset
from harness.data.scans import locate_scan
from harness.run.record_inputs import evaluated, method_code, scored_elsewhere
from methods.catalog import METHODS

HULL = "methods.hull"
#: Modules of methods that hand out a mesh alone.
WITHOUT_BODY = (
    HULL,
    "methods.gt",
    "methods.foreign.recipes",
    "methods.from_points.oracle8",
)
INFO = MethodInfo(
    "hull8", "Hull", parts=(Part("p", "n", "l", "1"),), parameters={"hull": {"voxel_m": 0.1}}
)
PROTOCOL = MetricProtocol("mexecon", 1, 2000, "independent", "sample-to-sample")
CAPTURE = Capture("toy", "t1", "tiny", "photos", Path("nowhere"), ())
SCAN = Scan(
    "toy", "t1", Path("t1.obj"), "metres", "+z", np.eye(4), {"t1.obj": "1"},
    truth_sha256={"body.npz": "2", "labels.npz": "3"},
    reader={"code": {"harness.data.scans": "4"}, "packages": {"numpy": "1"}},
)  # fmt: skip


@pytest.mark.parametrize("name", list(METHODS))
def test_a_methods_code_has_no_command_line_and_no_reports(name: str) -> None:
    found = method_code(METHODS.module(name), tuple(Privilege)).modules

    assert METHODS.module(name) in found
    assert {"harness.run.cell", "metrics.score", "metrics.regions"} < set(found)
    strangers = ("harness.cli", "reports", "renderers", "harness.run.plan",
                 "harness.run.evaluate", "harness.core.process.source_digest")  # fmt: skip
    assert [module for module in found if module.startswith(strangers)] == []


@pytest.mark.parametrize("name", list(METHODS))
def test_scoring_of_bodies_and_normals_counts_where_it_is_used(name: str) -> None:
    found = set(method_code(METHODS.module(name), ()).modules)
    module = METHODS.module(name)

    assert ("harness.run.body_scores" in found) == (module not in WITHOUT_BODY)
    clothed = module in ("methods.mexecon", "methods.mexecon", "methods.nview.method")
    assert ("harness.run.normal_scores" in found) == clothed
    assert "harness.run.oracle_normals" not in found


def test_lending_the_scans_normals_counts_under_its_privilege() -> None:
    found = method_code("methods.mexecon", (Privilege.ORACLE_NORMALS,)).modules
    assert "harness.run.oracle_normals" in found


def test_the_visual_hull_depends_on_no_network() -> None:
    found = method_code(HULL, ())

    others = ("methods.body", "methods.normals", "methods.surface", "renderers.blender")
    assert [module for module in found.modules if module.startswith(others)] == []
    assert {"numpy", "scipy", "scikit-image", "open3d"} <= set(found.packages)
    assert not {"torch", "mediapipe", "anny", "onnxruntime", "bpy"} & set(found.packages)
    econ = method_code("methods.mexecon", ()).packages
    assert {"torch", "mediapipe", "anny", "onnxruntime"} <= set(econ)


def test_all_closures_together_take_less_than_a_second_of_work() -> None:
    module_source._known.cache_clear()
    begin = time.process_time()
    for name in METHODS:
        method_code(METHODS.module(name), ())
    assert time.process_time() - begin < 2.0, "half a second on an idle machine"
    begin = time.process_time()
    for name in METHODS:
        method_code(METHODS.module(name), ())
    assert time.process_time() - begin < 0.5


def test_the_scan_says_what_reads_it(tmp_path: Path) -> None:
    folder = tmp_path / "model" / "t1"
    folder.mkdir(parents=True)
    (folder / "t1.obj").write_text("v 0 0 0\n")
    (folder / "body.npz").write_bytes(b"body")
    dataset = Dataset(title="t", kind="thuman", licence="x", root=".", scale="metres", facing="+z",
                      subjects=["t1"])  # fmt: skip
    scan = locate_scan("toy", dataset, tmp_path, "t1")

    assert {"harness.data.scans", "harness.files.obj"} < set(scan.reader["code"])
    assert "harness.data.manifest" not in scan.reader["code"], "it is read to rules, which count"
    assert set(scan.truth_sha256) == {"body.npz"}
    (folder / "body.npz").write_bytes(b"another")
    other = locate_scan("toy", dataset, tmp_path, "t1")
    assert other.identity() == scan.identity(), "photos do not depend on it"
    assert other.truth_identity() != scan.truth_identity()


CHANGES = [
    (
        "method parameters hull voxel_m 0.1 -> 0.2",
        {"info": replace(INFO, parameters={"hull": {"voxel_m": 0.2}})},
    ),
    ("method privileges", {"info": replace(INFO, privileges=(Privilege.KNOWN_CAMERAS,))}),
    ("method parts", {"info": replace(INFO, parts=(Part("p", "n", "l", "2"),))}),
    ("photos photos -> others", {"capture": replace(CAPTURE, key="others")}),
    ("file body.npz", {"scan": replace(SCAN, truth_sha256={**SCAN.truth_sha256, "body.npz": "9"})}),
    ("file labels.npz", {"scan": replace(SCAN, truth_sha256={"body.npz": "2", "labels.npz": "9"})}),
    ("file t1.obj", {"scan": replace(SCAN, sha256={"t1.obj": "9"})}),
    ("truth scale_rule metres -> fit", {"scan": replace(SCAN, scale_rule="fit")}),
    ("code of harness.data.scans",
     {"scan": replace(SCAN, reader={**SCAN.reader, "code": {"harness.data.scans": "9"}})}),
    ("protocol samples 2000 -> 3000", {"protocol": replace(PROTOCOL, samples=3000)}),
    ("seed 0 -> 1", {"seed": 1}),
]  # fmt: skip


@pytest.mark.parametrize(("told", "change"), CHANGES, ids=[told for told, _ in CHANGES])
def test_every_input_changes_the_key_and_is_told(told: str, change: dict) -> None:
    def inputs(info=INFO, capture=CAPTURE, scan=SCAN, protocol=PROTOCOL, seed=0):
        return evaluated(info, method_code(HULL, info.privileges), capture, scan, protocol, seed)

    before, now = inputs(), inputs(**change)

    assert before.key == inputs().key
    assert before.key != now.key
    (found,) = differences(before.to_dict(), now.to_dict())
    assert found.startswith(told)


def test_words_for_readers_do_not_change_the_key() -> None:
    other = replace(INFO, title="Another title")
    code = method_code(HULL, INFO.privileges)
    keys = {evaluated(info, code, CAPTURE, SCAN, PROTOCOL, 0).key for info in (INFO, other)}
    assert len(keys) == 1


def test_a_package_that_computes_is_in_the_key_and_another_is_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def inputs():
        source_digest._distributions.cache_clear()
        return evaluated(INFO, method_code(HULL, INFO.privileges), CAPTURE, SCAN, PROTOCOL, 0)

    version = metadata.version
    before = inputs()
    monkeypatch.setattr(metadata, "version", lambda n: "0.1" if n == "torch" else version(n))
    assert inputs().key == before.key
    monkeypatch.setattr(metadata, "version", lambda n: "0.1" if n == "scipy" else version(n))
    now = inputs()
    monkeypatch.undo()
    source_digest._distributions.cache_clear()
    assert differences(before.to_dict(), now.to_dict()) == [
        f"package scipy {version('scipy')} -> 0.1"
    ]


def test_meshes_made_elsewhere_depend_on_mesh_truth_and_metrics() -> None:
    before = scored_elsewhere(INFO, "mesh", SCAN, PROTOCOL)

    assert "metrics.score" in before.code
    assert HULL not in before.code
    body = replace(SCAN, truth_sha256={})
    others = [
        scored_elsewhere(INFO, "other", SCAN, PROTOCOL),
        scored_elsewhere(INFO, "mesh", body, PROTOCOL),
        scored_elsewhere(INFO, "mesh", SCAN, replace(PROTOCOL, seed=1)),
    ]
    assert len({inputs.key for inputs in [before, *others]}) == 4

"""A cell from its plan to its worker: what is resolved, what travels, what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from harness.core.artifacts import Body, Reconstruction, StageCost
from harness.core.errors import HarnessError, MethodError
from harness.core.mesh import Mesh
from harness.core.records import Environment, MetricValue, Scores
from harness.core.typed_json import from_json, to_json
from harness.data.manifest import load_manifest
from harness.run import cell_worker
from harness.run.cell_job import CellJob, CellResult
from harness.run.method_choice import ChosenMethod, catalogued_methods, chosen_methods
from harness.run.plan import EvalRequest, plan
from harness.run.record_inputs import Inputs, method_code
from harness.run.sources import Source
from harness.run.store import RunStore
from harness.run.workspace import Workspace
from methods.catalog import METHODS

CORNERS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
FACES = np.array([[0, 1, 2]])


def inputs_of(module: str) -> Inputs:
    code = method_code(module, ())
    return Inputs({"name": "m"}, code.modules, code.packages, "photos", {}, {}, 0)


@pytest.fixture
def source(tmp_path: Path) -> Source:
    return Source.select(load_manifest(), Workspace(tmp_path), "avatars-tiny", (), "quick8")


def test_a_job_is_the_same_on_the_other_side(source: Source, tmp_path: Path) -> None:
    (method,) = chosen_methods(["hull8"], {"hull.voxel_m": "0.02"})
    protocol = source.manifest.protocol("mexecon")
    alone = source.only(source.subjects[1])
    job = CellJob(
        alone, method.ref, protocol.name, 3, inputs_of("methods.hull"), tmp_path, keep=True
    )

    found = from_json(CellJob, json.loads(json.dumps(to_json(job))), "the job", "one")

    assert found.subject == source.subjects[1]
    assert found == job
    assert found.inputs.key == job.inputs.key
    assert found.method.found(source.workspace).info == method.info


def test_a_result_is_the_same_on_the_other_side() -> None:
    result = CellResult(
        "ok",
        scores=Scores(metrics={"chamfer": MetricValue(1.5, "mm", 10, 0.1)}),
        stages=(StageCost("carve", 0.25, 100.0),),
        details={"note": "a word"},
        files={"mesh.ply": "0"},
        environment=Environment(cpus=2),
    )
    written = json.loads(json.dumps(to_json(result)))
    assert from_json(CellResult, written, "the answer", "one") == result


def test_a_plan_waits_for_photos_and_knows_its_methods(source: Source, tmp_path: Path) -> None:
    methods = chosen_methods(["gt", "hull8"], {})
    protocol = source.manifest.protocol("mexecon")
    cells = plan(EvalRequest(source, methods, protocol, RunStore(tmp_path / "runs" / "main")))

    assert [(cell.subject, cell.method.name) for cell in cells] == [
        (subject, name) for subject in source.subjects for name in ("gt", "hull8")
    ]
    for cell in cells:
        assert (cell.state, cell.key, cell.files, cell.record) == ("run", "", None, None)
        assert cell.why == "photos missing: avatar has to be made"
        assert cell.info == cell.method.info
        assert cell.folder.directory == tmp_path / "runs/main" / cell.method.name / cell.subject


def test_names_and_settings_are_checked_when_a_method_is_chosen() -> None:
    with pytest.raises(HarnessError, match="unknown method 'hul8'.*hull8"):
        ChosenMethod.of("hul8", {})
    with pytest.raises(HarnessError, match="method 'gt' has no settings"):
        ChosenMethod.of("gt", {"hull.voxel_m": "1"})
    assert {method.name for method in catalogued_methods().usable} <= set(METHODS)


@pytest.mark.parametrize(
    ("module", "refused"), [("methods.body_fit", False), ("methods.hull", True)]
)
def test_a_body_is_refused_only_where_the_key_does_not_count_its_scoring(
    source: Source, tmp_path: Path, module: str, refused: bool
) -> None:
    (method,) = chosen_methods(["hull8"], {})
    protocol = source.manifest.protocol("mexecon")
    job = CellJob(source, method.ref, protocol.name, 0, inputs_of(module), tmp_path, keep=False)
    body = Body("toy", CORNERS, CORNERS, FACES.astype(np.int32), {})
    result = Reconstruction(Mesh(CORNERS, FACES), body=body)
    task = cell_worker._Task(job, method, protocol)
    if refused:
        with pytest.raises(MethodError, match="returned a body, which its code does not name"):
            task._require_planned_scoring(result)
    else:
        task._require_planned_scoring(result)

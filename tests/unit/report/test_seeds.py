"""Several seeds: which methods run with each, where their records lie, how they are tabulated."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from statistics import stdev

import pytest
from typer.testing import CliRunner

from harness.cli.main import app
from harness.core.errors import HarnessError, ProtocolMismatch
from harness.core.protocols import MethodInfo
from harness.core.records import CaptureStamp, MetricValue, ProtocolStamp, Record
from harness.data.manifest import load_manifest
from harness.report import seeds as seeding
from harness.report.seeds import (
    evaluate_seeds,
    is_deterministic,
    parsed_seeds,
    seed_requests,
    seed_runs,
    table_of_seeds,
)
from harness.run.evaluate import EvalSummary
from harness.run.method_choice import ChosenMethod, chosen_methods
from harness.run.plan import EvalRequest
from harness.run.sources import Source
from harness.run.store import RunStore
from harness.run.workspace import Workspace
from reports.tables.geometry import GEOMETRY_METRICS
from reports.tables.seeds import seeds_table

PROTOCOL = load_manifest().protocol("exact")


def record(method: str, subject: str, seed: int, value: float, status: str = "ok") -> Record:
    metrics = {
        name: MetricValue(value, "deg" if name == "normal_error" else "mm", 10, 0.1)
        for name in GEOMETRY_METRICS
    }
    return Record(
        key=f"{method}{seed}",
        method=MethodInfo(method, method.upper()),
        dataset="d",
        subject=subject,
        recipe="r",
        protocol=ProtocolStamp.of(PROTOCOL),
        capture=CaptureStamp("photos", 8),
        seed=seed,
        status=status,
        metrics=metrics if status == "ok" else {},
    )


@pytest.mark.parametrize(
    ("text", "seeds"), [("0..4", (0, 1, 2, 3, 4)), ("3", (3,)), ("0, 7..8", (0, 7, 8))]
)
def test_seeds_are_read(text, seeds):
    assert parsed_seeds(text) == seeds


@pytest.mark.parametrize("text", ["", "a", "1,1", "4..0", "-1", "0..99999"])
def test_what_is_no_list_of_seeds_is_refused(text):
    with pytest.raises(HarnessError, match="--seeds"):
        parsed_seeds(text)


@pytest.mark.parametrize(
    ("name", "deterministic"),
    [("gt", True), ("hull8", True), ("stereo8", False), ("jmbo8", False), ("mexecon+", False)],
)
def test_a_method_without_a_seed_in_its_code_is_deterministic(name, deterministic):
    assert is_deterministic(ChosenMethod.of(name, {})) is deterministic


class Told:
    """Keeps what it is told."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def expect(self, task: str, steps: int) -> None: ...
    def done(self, task: str, steps: int = 1) -> None: ...
    def say(self, line: str) -> None:
        self.lines.append(line)


def test_each_seed_is_a_run_of_the_methods_that_it_can_change(tmp_path, monkeypatch):
    asked: list[tuple[int, str, tuple[str, ...]]] = []

    def evaluated(request: EvalRequest, progress: object) -> EvalSummary:
        names = tuple(method.row for method in request.methods)
        asked.append((request.seed, request.store.directory.name, names))
        request.store.begin()
        return EvalSummary(())

    monkeypatch.setattr(seeding, "evaluate", evaluated)
    source = Source.select(load_manifest(), Workspace(tmp_path), "avatars-tiny", (), "quick8")
    store = RunStore(tmp_path / "runs" / "main")
    methods = chosen_methods(["hull8", "jmbo8"], {})
    request = EvalRequest(source, methods, PROTOCOL, store)
    told = Told()

    done = evaluate_seeds(request, (0, 1, 12), told)

    assert asked == [
        (0, "main", ("hull8", "jmbo8")),
        (1, "main.seed1", ("jmbo8",)),
        (12, "main.seed12", ("jmbo8",)),
    ]
    assert told.lines == ["a seed changes nothing for hull8: run once"]
    assert [each.store for each in done] == list(seed_runs(store))
    assert RunStore.existing(Workspace(tmp_path), None) == store

    assert [(each.seed, len(each.methods)) for each in seed_requests(request, (0, 1, 12))] == [
        (0, 2),
        (1, 1),
        (12, 1),
    ]
    with pytest.raises(HarnessError, match="--seed and --seeds exclude each other"):
        seed_requests(replace(request, seed=3), (0, 1))

    asked.clear()
    once = evaluate_seeds(replace(request, methods=methods[:1]), (0, 1), told)
    assert [each.summary is None for each in once] == [False, True]
    assert len(asked) == 1


def test_the_spread_over_seeds_and_over_subjects_is_worked_out_by_hand():
    values = {("a", 0): 10.0, ("b", 0): 20.0, ("a", 1): 12.0, ("b", 1): 24.0}
    runs = [
        [
            *(record("x", subject, seed, values[subject, seed]) for subject in "ab"),
            *([record("y", subject, 0, 5.0) for subject in "ab"] if not seed else []),
        ]
        for seed in (0, 1)
    ]
    table = seeds_table(runs)
    x, y = table.rows
    # Means 15 and 18; subjects 11 and 22.
    assert x.cells["chamfer"].value == 16.5
    assert x.cells["chamfer_sd_seeds"].value == pytest.approx(stdev([15, 18]))
    assert x.cells["chamfer_sd_subjects"].value == pytest.approx(stdev([11, 22]))
    assert x.cells["seeds"].value == 2
    assert (y.cells["chamfer"].value, y.cells["seeds"].value) == (5.0, 1)
    assert "chamfer_sd_seeds" not in y.cells
    assert y.cells["chamfer_sd_subjects"].value == 0.0
    # A row that was asked for by name is the same.
    assert seeds_table(runs, methods=["y", "x"]).rows == (y, x)


@pytest.mark.parametrize(
    ("other", "named"),
    [
        ({"dataset": "e"}, "their dataset differs"),
        ({"recipe": "s"}, "their recipe differs"),
        ({"capture": CaptureStamp("other photos", 8)}, "their capture of a differs"),
        (
            {"method": MethodInfo("x", "X", parameters={"hull": {"voxel_m": 0.01}})},
            "two states of the method",
        ),
    ],
)
def test_runs_of_other_requests_do_not_meet(other, named):
    runs = [[record("x", "a", 0, 10.0)], [replace(record("x", "a", 1, 11.0), **other)]]
    with pytest.raises(ProtocolMismatch, match=named):
        seeds_table(runs)


def test_a_subject_that_failed_under_one_seed_counts_under_none():
    runs = [
        [record("x", "a", 0, 10.0), record("x", "b", 0, 99.0)],
        [record("x", "a", 1, 11.0), record("x", "b", 1, 0.0, "failed")],
    ]
    (row,) = seeds_table(runs).rows
    assert (row.n, row.of) == (1, 2)
    assert row.cells["chamfer"].value == 10.5
    assert "chamfer_sd_subjects" not in row.cells


def test_a_run_of_one_seed_has_no_such_table(tmp_path: Path):
    with pytest.raises(HarnessError, match="run 'main' has one seed.*--seeds"):
        table_of_seeds(RunStore(tmp_path / "runs" / "main"), None, None)


def test_a_plan_shows_every_seed(tmp_path: Path):
    words = ["eval", "--dataset", "avatars-tiny", "--method", "hull8,jmbo8", "--dry-run",
             "--workspace", f"{tmp_path}", "--seeds", "0..1"]  # fmt: skip
    shown = CliRunner().invoke(app, words).stdout.splitlines()
    assert shown[-1] == "6 of 6 cells would run"
    assert [line.split()[:4] for line in shown[:-3]] == [
        ["seed", f"{seed}", method, subject]
        for seed, methods in ((0, ("hull8", "jmbo8")), (1, ("jmbo8",)))
        for subject in ("a01", "a02")
        for method in methods
    ]
    cells = json.loads(CliRunner().invoke(app, [*words, "--json"]).stdout)
    assert [cell["seed"] for cell in cells] == [0, 0, 0, 0, 1, 1]
    refused = CliRunner().invoke(app, [*words, "--seed", "3"])
    assert "--seed and --seeds exclude each other" in str(refused.exception)

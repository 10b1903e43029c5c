"""Photos, scan or code that change between plan and work, and failures that no method caused."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from harness.core.errors import DataError, Killed, WriteError
from harness.core.process.threads import silent
from harness.core.process.workers import run_worker
from harness.data.manifest import load_manifest
from harness.run import captures, cell_worker, evaluate, plan
from harness.run.cell_job import CellJob
from harness.run.method_choice import chosen_methods
from harness.run.progress import Silent
from harness.run.sources import Source
from harness.run.store import RunStore
from harness.run.workspace import Workspace
from methods.hull import VisualHull

pytestmark = pytest.mark.nightly

CELL_WORKER = "harness.run.cell_worker"


class Told(Silent):
    """Remembers what was said."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def say(self, text: str) -> None:
        self.lines.append(text)


def request(world: Path, method: str = "hull8", **more: object) -> plan.EvalRequest:
    manifest = load_manifest(world / "data_manifest.yaml")
    place = Workspace(world)
    settings = {"hull.voxel_m": "0.02"} if method == "hull8" else {}
    return plan.EvalRequest(
        source=Source.select(manifest, place, "toy", ("t1",), "tiny"),
        methods=chosen_methods((method,), settings),
        protocol=manifest.protocol("mexecon"),
        store=RunStore(place.run("main")),
        **more,
    )


def run(world: Path, method: str = "hull8", **more: object):
    """The only outcome of a run on t1, and what was said."""
    told = Told()
    (outcome,) = evaluate.evaluate(request(world, method, **more), told).outcomes
    return outcome, told.lines


@pytest.fixture
def other(world: Path, figure, write_subject) -> Path:
    """A second workspace with another scan of t1, and the same folder of photos."""
    place = world.with_name(f"{world.name}-other")
    place.mkdir()
    shutil.copy(world / "data_manifest.yaml", place)
    for subject, height in (("t1", 1.9), ("t2", 1.7), ("t3", 1.8)):
        write_subject(place / "scans" / "model" / subject, figure(height))
    (world / "captures").mkdir()
    (place / "captures").symlink_to(world / "captures", target_is_directory=True)
    return place


def between_plan_and_work(monkeypatch: pytest.MonkeyPatch, act, *, times: int = 1) -> None:
    """Let something happen just before the first cells are worked on."""
    waiting = [act] * times

    def later(module: str, *arguments: object, **more: object):
        if module == CELL_WORKER and waiting:
            waiting.pop()()
        return run_worker(module, *arguments, **more)

    monkeypatch.setattr(evaluate, "run_worker", later)


def test_another_workspace_renders_between_plan_and_work(world, other, monkeypatch):
    calm, _ = run(world)
    shutil.rmtree(world / "runs")
    theirs = request(other).source
    between_plan_and_work(monkeypatch, lambda: captures.render_all(theirs, 1, Silent()))

    outcome, told = run(world)

    assert outcome.status == "ok"
    assert "planned again: changed since it was planned: photos" in told[0]
    assert (outcome.record.key, outcome.record.metrics) == (calm.record.key, calm.record.metrics)
    capture = json.loads((world / "captures/toy/t1/tiny/capture.json").read_text())
    assert outcome.record.capture.key == capture["key"] == outcome.record.inputs["photos"]


def test_two_workspaces_that_never_agree_give_no_record_under_a_wrong_key(
    world, other, monkeypatch
):
    theirs = request(other).source
    between_plan_and_work(monkeypatch, lambda: captures.render_all(theirs, 1, Silent()), times=9)

    outcome, told = run(world)

    assert outcome.status == "failed"
    assert "after 3 attempts, changed since it was planned: photos" in outcome.record.reason
    assert len([line for line in told if "planned again" in line]) == 3
    assert not outcome.record.metrics


@pytest.mark.usefixtures("photographed")
def test_a_scan_that_changes_between_plan_and_work(world, figure, monkeypatch):
    body = world / "scans/model/t1/body.npz"
    between_plan_and_work(monkeypatch, lambda: body.write_bytes(b"not a body"))

    outcome, told = run(world)

    assert "planned again: changed since it was planned: file body.npz (new)" in told[0]
    assert outcome.status == "failed"
    assert "body.npz is no true body" in outcome.record.reason
    assert "body.npz" in outcome.record.inputs["truth"]["sha256"]


def job_of(world: Path, folder: Path) -> CellJob:
    """A planned cell, as its worker is told of it."""
    asked = request(world)
    captures.render_all(asked.source, 1, Silent())
    (cell,) = plan.plan(asked)
    method, protocol = cell.method.ref, asked.protocol.name
    return CellJob(asked.source, method, protocol, 0, cell.inputs, folder, keep=False)


def touch_capture(world: Path) -> None:
    path = world / "captures/toy/t1/tiny/capture.json"
    text = path.read_text()
    path.unlink()
    path.write_text(text)


def damage_photo(world: Path) -> None:
    (world / "captures/toy/t1/tiny/rgb/03.png").write_bytes(b"")


def other_scan(world: Path) -> None:
    path = world / "scans/model/t1/t1.obj"
    path.write_text(f"{path.read_text()}\n")


@pytest.mark.usefixtures("photographed")
@pytest.mark.parametrize(
    ("act", "told"),
    [
        (lambda _: None, ""),
        (touch_capture, "the photos were made anew"),
        (damage_photo, "03.png is damaged"),
        (other_scan, "file t1.obj"),
    ],
)
def test_what_changes_while_a_method_works_is_noticed_at_its_end(
    world, tmp_path, monkeypatch, act, told
):
    job = job_of(world, tmp_path / "results")
    original = VisualHull.reconstruct

    def meddled(self, capture, context):
        result = original(self, capture, context)
        act(world)
        return result

    monkeypatch.setattr(VisualHull, "reconstruct", meddled)
    found = cell_worker.handle(job, lambda *_: None)

    assert found.status == ("changed" if told else "ok")
    assert told in found.reason
    if not told:
        assert set(found.files) == {"mesh.ply"}
        assert found.environment.commit, "the worker's own"


@pytest.mark.usefixtures("photographed")
def test_code_that_changes_meanwhile_is_noticed(world, tmp_path):
    job = job_of(world, tmp_path / "results")
    job.inputs.code["methods.hull"] = "0"

    found = cell_worker.handle(job, lambda *_: None)

    assert found.status == "changed"
    assert found.reason == "changed since it was planned: code of methods.hull"
    assert not list((tmp_path).glob("results/*"))


def spoil_texture(world: Path) -> None:
    (world / "scans/model/t1/material0.jpeg").unlink()


def delete_scan(world: Path) -> None:
    shutil.rmtree(world / "scans/model/t1")


def break_body(world: Path) -> None:
    (world / "scans/model/t1/body.npz").write_bytes(b"not a body")


@pytest.mark.usefixtures("photographed")
@pytest.mark.parametrize(
    ("spoil", "told"),
    [
        (spoil_texture, "texture"),
        (delete_scan, "no scan of subject 't1'"),
        (break_body, "body.npz is no true body"),
    ],
)
def test_a_good_record_stays_when_something_else_fails(world, spoil, told):
    good, _ = run(world)
    cell = world / "runs/main/hull8/t1"
    before = {path.name: path.read_bytes() for path in cell.glob("[mr]*.*")}
    spoil(world)

    kept, lines = run(world)

    assert (kept.status, kept.record) == ("stale", good.record)
    assert told in kept.kept
    assert "keeps its good record" in lines[-1]
    assert {path.name: path.read_bytes() for path in cell.glob("[mr]*.*")} == before
    assert RunStore(world / "runs/main").result(kept.record, "mesh.ply").is_file()
    shutil.rmtree(world / "runs")
    fresh, _ = run(world)
    assert fresh.status == "failed"
    assert told in fresh.record.reason


@pytest.mark.usefixtures("photographed")
def test_a_failure_of_the_methods_own_replaces_a_stale_record(world):
    run(world)
    cell = world / "runs/main/hull8/t1"

    late, lines = run(world, seed=1, timeout_s=0.01)

    assert late.status == "failed"
    assert "had no result after 0.01 seconds and was stopped" in lines[-1]
    assert json.loads((cell / "record.json").read_text())["status"] == "failed"
    assert not (cell / "mesh.ply").exists(), "a mesh without its record"
    assert run(world)[0].status == "ok"


@pytest.mark.usefixtures("photographed")
def test_a_killed_worker_leaves_a_good_record(world, monkeypatch):
    good, _ = run(world)

    def dies(module: str, *arguments: object, **more: object):
        error = evaluate.WorkerDied("worker ended with signal SIGKILL")
        error.by_signal = evaluate.signal.SIGKILL
        raise error

    monkeypatch.setattr(evaluate, "run_worker", dies)
    kept, _ = run(world, seed=1)
    assert (kept.status, kept.record) == ("stale", good.record)


@pytest.mark.usefixtures("photographed")
@pytest.mark.parametrize(
    ("error", "by_method"),
    [(Killed("out of memory"), False), (WriteError("disk full"), False), (DataError("no"), True)],
)
def test_what_happens_to_a_method_from_outside_is_not_its_own(world, monkeypatch, error, by_method):
    def fails(*_):
        raise error

    monkeypatch.setattr(VisualHull, "reconstruct", fails)
    found = cell_worker.handle(job_of(world, world / "made"), silent)
    assert (found.status, found.reason) == ("failed", str(error))
    assert found.by_method is by_method


@pytest.mark.usefixtures("measured")
def test_a_missing_scan_is_one_failed_subject_of_many(world, eval_toy, harness):
    assert eval_toy("gt").returncode == 0
    shutil.rmtree(world / "scans/model/t2")
    dry = eval_toy("gt", "--dry-run")
    assert dry.returncode == 0
    assert "no scan of subject 't2'" in dry.stdout
    again = eval_toy("gt")
    assert again.returncode == 1
    assert "2 ok, 1 stale" in again.stdout.replace("1 stale, 2 ok", "2 ok, 1 stale")
    assert "keeps its good record" in again.stderr
    rendered = harness("render", "--dataset", "toy", "--recipe", "tiny", "--json")
    assert rendered.returncode == 1
    states = {one["subject"]: one["state"] for one in json.loads(rendered.stdout)}
    assert states == {"t1": "cached", "t2": "failed", "t3": "cached"}


@pytest.mark.usefixtures("measured")
def test_folder_scores_know_their_truth(world, harness, eval_toy):
    assert eval_toy("gt", "--subjects", "t1").returncode == 0
    folder = world / "mine"
    folder.mkdir()
    shutil.copy(world / "runs/main/gt/t1/mesh.ply", folder / "t1.ply")
    score = ("score", "mine", "--dataset", "toy", "--subjects", "t1", "--name", "mine")
    path = world / "runs/main/mine/t1/record.json"
    assert harness(*score).returncode == 0
    first = json.loads(path.read_text())
    assert "metrics.score" in first["inputs"]["code"]
    assert set(first["inputs"]["truth"]["sha256"]) >= {"t1.obj"}
    assert first["inputs"]["mesh"]
    other_scan(world)
    assert harness(*score).returncode == 0
    assert json.loads(path.read_text())["key"] != first["key"]
    good = path.read_bytes()
    delete_scan(world)
    kept = harness(*score)
    assert kept.returncode == 1
    assert "keeps its good record" in kept.stderr
    assert path.read_bytes() == good


@pytest.mark.usefixtures("photographed")
def test_figures_refuse_a_mesh_that_is_not_the_records(world, eval_toy, harness):
    assert eval_toy("hull8", "--subjects", "t1", "--set", "hull.voxel_m=0.02").returncode == 0
    with (world / "runs/main/hull8/t1/mesh.ply").open("ab") as stream:
        stream.write(b" ")
    drawn = harness("report", "--figure", "overlay", "--subjects", "t1", "-o", "figure.png")
    assert drawn.returncode == DataError.exit_code
    assert "mesh.ply is not what its record measured" in drawn.stderr
    assert not (world / "figure.png").exists()

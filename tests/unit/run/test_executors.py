"""Tasks, what they are granted, and who carries them out; no cluster is needed here."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import platform
import subprocess
import sys
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from harness.cli.options import ExecutorName, Where
from harness.core.errors import DataError, HarnessError, MissingPart, error_values, found_error
from harness.core.typed_json import from_json, to_json
from harness.data.manifest import load_manifest
from harness.run import slurm
from harness.run import task as machine
from harness.run import task as tasks
from harness.run.captures import render_all
from harness.run.evaluate import RunOfTasks, evaluate
from harness.run.method_choice import chosen_methods
from harness.run.plan import EvalRequest, RequestJob, plan
from harness.run.progress import Progress, Silent
from harness.run.ray_cluster import RayCluster
from harness.run.slurm import Element, Slurm, carry_out_element
from harness.run.sources import Source
from harness.run.store import RunStore
from harness.run.task import (
    Answer,
    Errand,
    Grant,
    Local,
    Task,
    carry_out_here,
    granted,
    groups,
    machine_facts,
)
from harness.run.workspace import Workspace

ROOT = Path(__file__).parents[3]
CORES = len(os.sched_getaffinity(0))


def handler(name: str) -> str:
    return f"{__name__}:{name}"


def add(
    values: Mapping[str, Any], before: Mapping[str, Any] | None, progress: Progress
) -> dict[str, object]:
    progress.say(f"adds {values['number']}")
    return {"sum": values["number"] + (before["sum"] if before else 0)}


def refuse(values: object, before: object, progress: object) -> dict[str, object]:
    raise DataError("no such file here", hint="Copy it")


def environment(values: object, before: object, progress: object) -> dict[str, object]:
    program = "import json, os; print(json.dumps([len(os.sched_getaffinity(0)), dict(os.environ)]))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, check=True)
    cores, variables = json.loads(done.stdout)
    return {"cores": cores, "variables": variables}


@pytest.fixture(autouse=True)
def no_other_work(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Tasks of others on this machine, which hold cores, are not seen."""
    monkeypatch.setattr(tasks.tempfile, "tempdir", str(tmp_path))


@pytest.fixture(autouse=True)
def importable(monkeypatch: pytest.MonkeyPatch) -> None:
    """Handlers are found by name, and this module has one only while tests run."""
    monkeypatch.setitem(sys.modules, __name__, sys.modules.get(__name__) or _this_module())


def _this_module() -> Any:
    module = type(sys)(__name__)
    module.__dict__.update(globals())
    return module


def task(name: str, number: int = 0, group: str = "g", after: str = "") -> Task:
    return Task(name, handler("add"), {"number": number}, group, after)


def test_tasks_of_a_group_follow_each_other_and_see_what_came_before() -> None:
    tasks = [task("a", 1), task("b", 20, after="a"), task("c", 300, "other"), task("d", 4)]
    answers: dict[str, Answer] = {}

    Local(jobs=2).carry_out(tasks, Silent(), lambda each: answers.update({each.task: each}))

    assert [[each.name for each in group] for group in groups(tasks)] == [["a", "b", "d"], ["c"]]
    assert {name: each.value["sum"] for name, each in answers.items()} == {
        "a": 1, "b": 21, "c": 300, "d": 4,
    }  # fmt: skip
    assert {each.machine for each in answers.values()} == {platform.node()}


def test_an_error_on_this_machine_ends_a_local_run() -> None:
    with pytest.raises(DataError, match="no such file here"):
        Local().carry_out([Task("a", handler("refuse"), {}, "g")], Silent(), lambda each: None)


def test_an_error_on_another_machine_is_an_answer() -> None:
    answer = carry_out_here(Errand.of(Task("a", handler("refuse"), {}, "g"), 1))

    assert answer.lost == "no such file here. Copy it"
    assert not answer.value


def test_an_answer_says_where_it_comes_from_and_what_was_said() -> None:
    answer = carry_out_here(Errand.of(task("b", 5), 1), {"sum": 2}, "node (1)")

    assert (answer.task, answer.value, answer.said) == ("b", {"sum": 7}, ("adds 5",))
    assert (answer.machine, answer.lost) == ("node (1)", "")
    assert 0 <= answer.wall_s < 60


def test_a_task_has_the_threads_that_it_is_granted_and_our_variables(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("HARNESS_DEVICE", "cpu")
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    travels = Errand.of(Task("a", handler("environment"), {}, "g"), 1)
    # There, another user's choice must not count.
    monkeypatch.setenv("HARNESS_DEVICE", "cuda")
    monkeypatch.setenv("HARNESS_STRAY", "1")

    answer = carry_out_here(travels)

    value: Any = answer.value
    assert value["cores"] == 1
    assert value["variables"]["OMP_NUM_THREADS"] == "1"
    assert value["variables"]["HARNESS_DEVICE"] == "cpu"
    assert "HARNESS_STRAY" not in value["variables"]
    assert len(os.sched_getaffinity(0)) == CORES
    assert os.environ["OMP_NUM_THREADS"] == "7"


@pytest.mark.skipif(CORES < 2, reason="one core cannot be shared out")
def test_two_tasks_on_one_machine_have_cores_of_their_own() -> None:
    with granted(1):
        first = os.sched_getaffinity(0)
        # As another process would: the locks are those of open files.
        os.sched_setaffinity(0, range(CORES))
        with granted(1):
            second = os.sched_getaffinity(0)
    assert len(first) == len(second) == 1
    assert first != second


@pytest.mark.skipif(CORES < 2, reason="one core cannot be shared out")
def test_a_task_keeps_to_its_cores_where_more_is_granted_than_there_is(tmp_path: Path) -> None:
    taken = tmp_path / f"harness-cores-{os.getuid()}"
    taken.mkdir()
    with contextlib.ExitStack() as held:
        for core in os.sched_getaffinity(0):
            stream = held.enter_context((taken / str(core)).open("a"))
            fcntl.flock(stream, fcntl.LOCK_EX)
        with granted(1):
            assert len(os.sched_getaffinity(0)) == 1


def test_more_cores_than_there_are_is_all_of_them() -> None:
    with granted(CORES + 5):
        assert len(os.sched_getaffinity(0)) == CORES


@pytest.mark.parametrize("values", [(0,), (1, -1.0), (1, 0.0, -2.0)])
def test_a_grant_is_of_something(values: Sequence[float]) -> None:
    with pytest.raises(HarnessError, match="one core at least"):
        Grant(*values)


@pytest.mark.parametrize(
    ("executor", "package", "extra"),
    [(RayCluster(), "ray", "ray"), (Slurm(Path("jobs")), "submitit", "slurm")],
    ids=["ray", "slurm"],
)
def test_a_missing_package_is_one_sentence_with_the_command(
    monkeypatch: pytest.MonkeyPatch, executor: RayCluster | Slurm, package: str, extra: str
) -> None:
    monkeypatch.setattr(tasks.importlib.util, "find_spec", lambda name: None)

    with pytest.raises(MissingPart) as raised:
        executor.carry_out([task("a")], Silent(), lambda each: None)

    assert raised.value.exit_code == 4
    assert f"needs {package}, which is not installed. Run: pip install " in str(raised.value)
    assert str(raised.value).endswith(f"[{extra}]'")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    (pinned,) = project["optional-dependencies"][extra]
    assert pinned.partition("==")[0] == package
    assert f"\n{pinned}\n" in (ROOT / "constraints.txt").read_text()


def test_a_machine_without_slurm_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(slurm, "extra_package", lambda *names: None)
    monkeypatch.setattr(slurm.shutil, "which", lambda name: None)

    with pytest.raises(MissingPart, match="'sbatch', which is not on this machine.*cluster=local"):
        Slurm(Path("jobs")).require_usable()
    Slurm(Path("jobs"), cluster="local").require_usable()


def test_an_element_files_each_of_its_answers(tmp_path: Path) -> None:
    errands = tuple(Errand.of(task(name, number), 1) for name, number in (("a", 1), ("b", 2)))
    element = tmp_path / "cells-0.json"
    element.write_text(json.dumps(to_json(Element(errands, tmp_path / "answers"))))

    assert carry_out_element(str(element)) == 2

    found = [json.loads(path.read_text()) for path in (tmp_path / "answers").glob("*.json")]
    assert {each["task"]: each["value"]["sum"] for each in found} == {"a": 1, "b": 2}


@pytest.mark.parametrize(
    ("where", "jobs", "complaint"),
    [
        (Where(ExecutorName.LOCAL, ray_address="auto"), 1, "--ray-address is for --executor ray"),
        (Where(ExecutorName.RAY, slurm=["partition=x"]), 1, "--slurm is for --executor slurm"),
        (Where(ExecutorName.LOCAL, ["cpus=2"]), 1, "--cell is for clusters"),
        (Where(ExecutorName.RAY), 3, "--jobs is for this machine alone"),
        (Where(ExecutorName.RAY, ["cores=2"]), 1, "--cell has no 'cores'"),
        (Where(ExecutorName.RAY, ["cpus=two"]), 1, "--cell has a value that is no number"),
        (Where(ExecutorName.SLURM, slurm=["gpu"]), 1, "--slurm gpu .expected NAME=VALUE"),
    ],
    ids=lambda value: "",
)
def test_options_that_do_not_go_together(
    tmp_path: Path, where: Where, jobs: int, complaint: str
) -> None:
    with pytest.raises(HarnessError, match=complaint):
        where.executor(Workspace(tmp_path), jobs)


def test_this_machine_is_the_default_and_named_in_records(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert Where(ExecutorName.LOCAL).executor(Workspace(tmp_path), 4) is None
    smi = tmp_path / "nvidia-smi"
    smi.write_text("#!/bin/sh\necho 'NVIDIA H200, 570.1'\necho 'NVIDIA H200, 570.1'\n")
    smi.chmod(0o755)
    monkeypatch.setattr(machine.shutil, "which", lambda name: str(smi))
    machine_facts.cache_clear()
    try:
        found = machine_facts().to_dict()
    finally:
        machine_facts.cache_clear()
    assert found == {"host": platform.node(), "gpus": ["NVIDIA H200"] * 2, "driver": "570.1"}


class Told(Silent):
    """Remembers what was said."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def say(self, text: str) -> None:
        self.lines.append(text)


@pytest.fixture
def request_of_two(tmp_path: Path) -> EvalRequest:
    source = Source.select(load_manifest(), Workspace(tmp_path), "avatars-tiny", (), "quick8")
    methods = chosen_methods(["hull8"], {"hull.voxel_m": "0.02"}, "coarser")
    protocol = source.manifest.protocol("mexecon")
    return EvalRequest(source, methods, protocol, RunStore(tmp_path / "runs/main"), 3, keep=True)


def test_a_request_is_the_same_on_the_other_side(request_of_two: EvalRequest) -> None:
    job = request_of_two.job(request_of_two.methods)
    found = from_json(RequestJob, json.loads(json.dumps(to_json(job))), "the job", "one").found()

    assert found.job(found.methods) == job
    assert found.source == request_of_two.source
    assert found.methods[0].info == request_of_two.methods[0].info
    assert (found.seed, found.keep, found.protocol) == (3, True, request_of_two.protocol)


def test_a_task_names_its_own_method_alone(request_of_two: EvalRequest) -> None:
    both = replace(
        request_of_two,
        methods=(*request_of_two.methods, *chosen_methods(["gt"], {})),
    )

    tasks = RunOfTasks(both, Silent(), lambda *cell: {}).tasks_for(plan(both))

    named = {each.name: each.job.request.methods for each in tasks}
    first = both.source.subjects[0]
    assert named[f"photos of {first}"] == ()
    assert [each.row for each in named[f"coarser on {first}"]] == ["coarser"]
    assert [each.name for each in named[f"gt on {first}"]] == ["gt"]
    assert len({each.job.run for each in tasks}) == 1
    # Tasks of a row share their request, of which there may be many.
    assert len({id(each.job.request) for each in tasks}) == 3


class Nowhere:
    """An executor that has lost everything."""

    def carry_out(self, tasks: Sequence[Task], progress: Progress, done: Any) -> None:
        for each in tasks:
            done(Answer(each.name, lost="the cluster is gone"))


def test_generated_subjects_are_made_before_others_photograph_them(
    request_of_two: EvalRequest,
) -> None:
    source = request_of_two.source
    sentence = "2 of 2 subjects of 'avatars' are not made .got a01, a02.*harness data make"
    with pytest.raises(HarnessError, match=sentence):
        evaluate(replace(request_of_two, executor=Nowhere()), Silent())
    with pytest.raises(HarnessError, match=sentence):
        render_all(source, 1, Silent(), executor=Nowhere())
    assert not request_of_two.store.directory.exists()


def test_what_a_cluster_lost_is_a_record_with_the_reason(
    request_of_two: EvalRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Source, "avatar_is_current", lambda own, subject: True)
    told = Told()

    summary = evaluate(replace(request_of_two, executor=Nowhere()), told)

    assert summary.counts == {"failed": 2}
    assert {record.reason for record in summary.records} == {"the cluster is gone"}
    assert {record.status for record in request_of_two.store.records()} == {"failed"}
    assert len(told.lines) == 2
    photos = render_all(request_of_two.source, 1, Silent(), executor=Nowhere())
    assert [each.failure for each in photos] == ["the cluster is gone"] * 2


def test_an_error_is_the_same_on_the_other_side() -> None:
    error = MissingPart("no body", expected="a body", got="none", hint="Import it")

    found = found_error(json.loads(json.dumps(error_values(error))))

    assert (type(found), str(found)) == (MissingPart, str(error))


def test_cells_wait_for_photos_and_a_lost_one_is_given_up(request_of_two: EvalRequest) -> None:
    given_up: list[tuple[str, str, str]] = []
    first, second = request_of_two.source.subjects

    def give_up(row: str, subject: str, reason: str) -> dict[str, object]:
        given_up.append((row, subject, reason))
        return {"cached": False, "kept": "", "line": f"{row} on {subject} failed: {reason}"}

    told = Told()
    run = RunOfTasks(request_of_two, told, give_up)

    tasks = run.tasks_for(plan(request_of_two))
    run.answered(Answer(tasks[0].name, {"warnings": ["cut"]}, machine="n1", wall_s=2.0))
    run.answered(Answer(tasks[1].name, lost="its worker was lost", machine="n1", wall_s=3.0))

    assert [(each.name, each.after, each.group, each.renders) for each in tasks] == [
        (f"photos of {first}", "", first, True),
        (f"coarser on {first}", f"photos of {first}", first, False),
        (f"photos of {second}", "", second, True),
        (f"coarser on {second}", f"photos of {second}", second, False),
    ]
    assert tasks[1].job.row == "coarser"
    assert given_up == [("coarser", first, "its worker was lost")]
    assert told.lines == [f"{first}: cut", f"coarser on {first} failed: its worker was lost"]
    (share,) = run.machines()
    assert (share.machine, share.photos, share.cells, share.busy_s) == ("n1", 1, 1, 5.0)

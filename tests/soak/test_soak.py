"""The short forms of the soak and of stopped runs: whatever is lost, the records are equal."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

pytestmark = pytest.mark.nightly

HERE = Path(__file__).parent


def script(name: str) -> ModuleType:
    """A script of this folder, which imports its neighbours by name."""
    sys.path.insert(0, str(HERE))
    try:
        spec = importlib.util.spec_from_file_location(f"soak_script_{name}", HERE / f"{name}.py")
        assert spec is not None
        assert spec.loader is not None
        module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    finally:
        sys.path.remove(str(HERE))
    return module


@pytest.fixture(scope="module")
def soaking() -> ModuleType:
    """The soak's script."""
    return script("soak")


def require_soak() -> None:
    """Skip where Ray is not installed, or minutes were not asked for."""
    pytest.importorskip("ray", reason="Ray is not installed: pip install -c constraints.txt ray")
    if not os.environ.get("HARNESS_SOAK"):
        pytest.skip("it takes some minutes, most of them for Ray's nodes to start: HARNESS_SOAK=1")


def test_records_are_those_of_a_quiet_run_whatever_is_lost(
    soaking: ModuleType, tmp_path: Path
) -> None:
    require_soak()
    plan = soaking.Plan(cells=16, drivers=2, removal_s=8.0, kill_s=3.0, limit_s=400.0)

    report = soaking.soak(plan, tmp_path / "soak")

    assert report.is_good, report
    assert report.records == 16
    # A driver that begins after the other has ended has no tasks, and tells of no machine.
    lines = [line for told in report.machines for line in told]
    assert sum(int(line.split(": ")[1].split()[0]) for line in lines) >= 16


def test_a_stopped_run_ends_at_once_and_continues(tmp_path: Path) -> None:
    require_soak()
    interrupted = script("interrupted")

    report = interrupted.interrupt(
        interrupted.Plan(cells=12, times=3, most_s=6.0), tmp_path / "place"
    )

    assert report.is_good, report
    assert [stop.own_cluster for stop in report.stops] == [False, False, True]
    assert report.records == 12


def test_the_comparison_bites(soaking: ModuleType, tmp_path: Path) -> None:
    def put(run: str, subject: str, chamfer: float, wall_s: float) -> Path:
        cell = tmp_path / run / "m" / subject
        (cell / "results-1").mkdir(parents=True)
        record = {
            "created_utc": f"{wall_s}",
            "details": {"machine": {"host": run}},
            "stages": [{"wall_s": wall_s, "peak_rss_mib": 1.0, "peak_gpu_mib": None}],
            "metrics": {"chamfer": chamfer},
        }
        (cell / "record.json").write_text(json.dumps(record))
        return cell

    for subject, chamfer in (("a", 1.0), ("b", 2.0), ("c", 3.0)):
        put("quiet", subject, chamfer, 0.1)
    put("soak", "a", 1.0, 0.7)
    (put("soak", "b", 2.5, 0.7) / ".attempt-1").mkdir()
    report = soaking.Report(3)

    soaking._compare(tmp_path, report)

    assert report.records == 2
    assert report.unequal == ["m/b", "m/c"]
    assert report.left_over == ["soak/m/b/.attempt-1"]
    assert not report.is_good


def test_the_numbers_of_records_are_compared(tmp_path: Path) -> None:
    losses = script("quickstart_losses")
    one = {"files": {"mesh.ply": "x"}, "metrics": {"chamfer": {"value": 2.0, "unit": "mm"}},
           "regions": {"head": {"accuracy_mm": None, "n": 3}}, "status": "ok"}  # fmt: skip
    other = {"files": {"mesh.ply": "x"}, "metrics": {"chamfer": {"value": 2.5, "unit": "mm"}},
             "regions": {"head": {"accuracy_mm": None, "n": 3}}, "status": "ok"}  # fmt: skip
    report = losses.Report(2)

    losses.compare({"m/a": one, "m/b": one}, {"m/a": one, "m/b": other}, report)

    assert report.unequal == {"m/b": pytest.approx(0.2)}
    assert report.largest == {"metrics.chamfer.value": pytest.approx(0.2)}
    assert (report.records, report.numbers, report.meshes) == (2, 4, 2)
    assert report.otherwise == {"metrics": 1}
    assert not report.is_good


def test_slurm_array_jobs_give_the_records_of_this_machine(
    soaking: ModuleType, tmp_path: Path
) -> None:
    pytest.importorskip("submitit", reason="submitit is not installed: pip install submitit")
    place = soaking.Place.make(tmp_path / "place", 4)
    runs, told = place.world / "runs", ""
    for run, more in (
        ("slurm", ("--executor", "slurm", "--slurm", "cluster=local")),
        ("quiet", ()),
    ):
        done = subprocess.run(
            place.command(run, *more), cwd=place.world, env=place.environment,
            capture_output=True, text=True, timeout=300, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        assert "4 ok (0 cached)" in done.stdout
        told = done.stdout if run == "slurm" else told

    assert len(soaking.timeless(runs / "slurm")) == 4
    assert soaking.timeless(runs / "slurm") == soaking.timeless(runs / "quiet")
    assert ": 4 reconstructions, photos of 2 subjects" in told
    # Jobs, answers and logs are gone with the run.
    assert list((runs / ".slurm").iterdir()) == []

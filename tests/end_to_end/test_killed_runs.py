"""SIGKILL, Ctrl-C and SIGTERM at many moments, two runs at once: records as of a calm run."""

from __future__ import annotations

import json
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

pytestmark = pytest.mark.slow

COMMAND = [sys.executable, "-m", "harness.cli.main", "eval", "--dataset", "toy", "--recipe", "tiny",
           "--method", "hull8,gt", "--jobs", "2"]  # fmt: skip
KILLS = 10


def timeless(world: Path) -> dict[str, object]:
    """Records without what differs between any two runs: times, memory, dates."""
    found = {}
    for path in sorted((world / "runs").rglob("record.json")):
        record = json.loads(path.read_text())
        record.pop("created_utc")
        for stage in record["stages"]:
            for name in ("wall_s", "peak_rss_mib", "peak_gpu_mib"):
                stage.pop(name)
        found[str(path.relative_to(world))] = record
    return found


def reference(world: Path) -> dict[str, object]:
    """The records of an undisturbed run in a copy of the world."""
    calm = world.with_name(f"{world.name}-calm")
    shutil.copytree(world, calm)
    subprocess.run(COMMAND, cwd=calm, check=True, capture_output=True, timeout=300)
    return timeless(calm)


def test_killed_at_ten_random_moments(world):
    dice = random.Random(7)
    for _ in range(KILLS):
        run = subprocess.Popen(
            COMMAND, cwd=world, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL
        )
        time.sleep(dice.uniform(0.3, 6.0))
        run.kill()
        run.wait()
    subprocess.run(COMMAND, cwd=world, check=True, capture_output=True, timeout=300)
    assert timeless(world) == reference(world)
    leftovers = [path for path in world.rglob("*.part*") if path.name.startswith(".")]
    assert not leftovers


def test_two_runs_at_once(world):
    runs = [
        subprocess.Popen(
            COMMAND, cwd=world, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        for _ in range(2)
    ]
    for run in runs:
        _, errors = run.communicate(timeout=300)
        assert run.returncode == 0, errors
    assert timeless(world) == reference(world)


SHORT = [*COMMAND, "--subjects", "t1,t2"]
MOMENTS = 10


def shell_code(status: int) -> int:
    """What a shell says of a process's end."""
    return 128 - status if status < 0 else status


def interrupted(world: Path, number: signal.Signals, seconds: float) -> tuple[int, str]:
    """Exit code and errors of a run that gets a signal; its children are gone with it."""
    run = subprocess.Popen(
        SHORT, cwd=world, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True
    )
    time.sleep(seconds)
    children = psutil.Process(run.pid).children(recursive=True)
    run.send_signal(number)
    _, errors = run.communicate(timeout=60)
    _, alive = psutil.wait_procs(children, timeout=10)
    assert not alive
    return shell_code(run.returncode), errors


def test_ctrl_c_at_ten_moments(world):
    calm = world.with_name(f"{world.name}-calm")
    shutil.copytree(world, calm)
    begin = time.monotonic()
    subprocess.run(SHORT, cwd=calm, check=True, capture_output=True, timeout=300)
    seconds = time.monotonic() - begin
    codes, unfinished = [], 0
    for moment in range(MOMENTS):
        place = world.with_name(f"{world.name}-{moment}")
        shutil.copytree(world, place)
        code, errors = interrupted(place, signal.SIGINT, seconds * (moment + 0.5) / MOMENTS)
        codes.append(code)
        found = timeless(place)
        unfinished += len(found) < 4
        assert {record["status"] for record in found.values()} <= {"ok"}, errors
        if code == 130 and "harness:" in errors:
            assert errors.rstrip().splitlines()[-1] == (
                "harness: stopped by SIGINT; what is finished is kept, and the same command "
                "continues"
            )
            assert "Traceback" not in errors
        subprocess.run(SHORT, cwd=place, check=True, capture_output=True, timeout=300)
        assert timeless(place) == timeless(calm)
        leftovers = [path for path in place.rglob("*.part*") if path.name.startswith(".")]
        assert not [*leftovers, *place.rglob(".attempt")]
        shutil.rmtree(place)
    # The last moments may come after the end, on a machine that has become faster.
    assert set(codes) <= {0, 130}
    assert codes.count(130) >= MOMENTS - 3
    assert unfinished >= MOMENTS - 4


def test_sigterm_says_143(world):
    (world / "runs").mkdir()
    code, errors = 143, ""
    for seconds in (4.0, 2.0, 1.0):
        shutil.rmtree(world / "runs")
        code, errors = interrupted(world, signal.SIGTERM, seconds)
        if code:
            break
    assert code == 143
    assert all(record["status"] == "ok" for record in timeless(world).values()), errors

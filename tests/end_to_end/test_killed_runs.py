"""SIGKILL, Ctrl-C and SIGTERM at many moments, two runs at once: records as of a calm run."""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import psutil
import pytest

COMMAND = [sys.executable, "-m", "harness.cli.main", "eval", "--dataset", "toy", "--recipe", "tiny",
           "--method", "coarse", "--jobs", "2", "--subjects", "t1,t2"]  # fmt: skip
CELLS = 2
KILLS = 10

#: Ten moments at which runs are stopped, in shares of the time that an undisturbed one takes. Each
#: run goes on from what the one before it left, and the last of a row is followed by a whole one.
ROWS = ((0.03, 0.2, 0.5, 0.5), (0.1, 0.38, 0.42), (0.3, 0.65, 0.3))
MOMENTS = sum(map(len, ROWS))


@dataclass(frozen=True)
class Calm:
    """What an undisturbed run gave, and how many seconds it took."""

    records: dict[str, object]
    whole_s: float


@pytest.fixture(scope="module")
def calm(
    make_world: Callable[[Path], Path],
    coarse_package: Path,
    tmp_path_factory: pytest.TempPathFactory,
) -> Calm:
    """An undisturbed run of two subjects, whose photos and cells are worked on side by side."""
    place = make_world(tmp_path_factory.mktemp("calm"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(coarse_package), prepend=os.pathsep)
        begin = time.monotonic()
        subprocess.run(COMMAND, cwd=place, check=True, capture_output=True, timeout=300)
        whole_s = time.monotonic() - begin
    records = timeless(place)
    assert len(records) == CELLS
    return Calm(records, whole_s)


def timeless(world: Path) -> dict[str, object]:
    """Records without what differs between any two runs: times, memory, dates."""
    found = {}
    for path in sorted((world / "runs").rglob("record.json")):
        record = json.loads(path.read_text())
        for name in ("created_utc", "digest"):  # the digest is over the date, too
            record.pop(name)
        for stage in record["stages"]:
            for name in ("wall_s", "peak_rss_mib", "peak_gpu_mib"):
                stage.pop(name)
        found[str(path.relative_to(world))] = record
    return found


def half_written(world: Path) -> list[Path]:
    """Files and folders that were begun and never finished."""
    return [path for path in world.rglob("*.part*") if path.name.startswith(".")]


@pytest.mark.slow
def test_a_killed_run_is_continued_by_the_same_command(world, calm):
    run = subprocess.Popen(COMMAND, cwd=world, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    while not any(world.rglob("capture.json")):
        assert run.poll() is None
        time.sleep(0.02)
    run.kill()
    run.wait()
    assert len(timeless(world)) < CELLS
    subprocess.run(COMMAND, cwd=world, check=True, capture_output=True, timeout=300)
    assert timeless(world) == calm.records
    assert not half_written(world)


@pytest.mark.nightly
def test_killed_at_ten_random_moments(world, calm):
    dice = random.Random(7)
    for _ in range(KILLS):
        run = subprocess.Popen(
            COMMAND, cwd=world, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL
        )
        time.sleep(dice.uniform(0.02, 0.4) * calm.whole_s)
        run.kill()
        run.wait()
    subprocess.run(COMMAND, cwd=world, check=True, capture_output=True, timeout=300)
    assert timeless(world) == calm.records
    assert not half_written(world)


@pytest.mark.nightly
def test_two_runs_at_once(world, calm):
    runs = [
        subprocess.Popen(
            COMMAND, cwd=world, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        for _ in range(2)
    ]
    for run in runs:
        _, errors = run.communicate(timeout=300)
        assert run.returncode == 0, errors
    assert timeless(world) == calm.records


def shell_code(status: int) -> int:
    """What a shell says of a process's end."""
    return 128 - status if status < 0 else status


def interrupted(world: Path, number: signal.Signals, seconds: float) -> tuple[int, str]:
    """Exit code and errors of a run that gets a signal; its children are gone with it."""
    run = subprocess.Popen(
        COMMAND, cwd=world, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True
    )
    time.sleep(seconds)
    children = psutil.Process(run.pid).children(recursive=True)
    run.send_signal(number)
    _, errors = run.communicate(timeout=60)
    _, alive = psutil.wait_procs(children, timeout=10)
    assert not alive
    return shell_code(run.returncode), errors


@pytest.mark.nightly
def test_ctrl_c_at_ten_moments(tmp_path, make_world, calm):
    codes, unfinished = [], 0
    for number, row in enumerate(ROWS):
        place = make_world(made(tmp_path / f"row-{number}"))
        for share in row:
            code, errors = interrupted(place, signal.SIGINT, share * calm.whole_s)
            codes.append(code)
            found = timeless(place)
            unfinished += len(found) < CELLS
            assert {record["status"] for record in found.values()} <= {"ok"}, errors
            if code == 130 and "harness:" in errors:
                assert errors.rstrip().splitlines()[-1] == (
                    "harness: stopped by SIGINT; what is finished is kept, and the same command "
                    "continues"
                )
                assert "Traceback" not in errors
            if code == 0:
                # It came to its end before the moment: the next one has all its work to do.
                assert found == calm.records
                place = make_world(made(tmp_path / f"row-{number}-after-{share}"))
        subprocess.run(COMMAND, cwd=place, check=True, capture_output=True, timeout=300)
        assert timeless(place) == calm.records
        assert not [*half_written(place), *place.rglob(".attempt*")]
    assert len(codes) == 10
    # Runs may come to their end before the moment, on a machine that has become faster.
    assert set(codes) <= {0, 130}
    assert codes.count(130) >= MOMENTS - 3
    assert unfinished >= MOMENTS - 4


def made(folder: Path) -> Path:
    """The folder, which was not there before."""
    folder.mkdir()
    return folder


@pytest.mark.nightly
def test_sigterm_says_143(world, calm):
    (world / "runs").mkdir()
    code, errors = 143, ""
    for share in (0.5, 0.25, 0.12):
        shutil.rmtree(world / "runs")
        code, errors = interrupted(world, signal.SIGTERM, share * calm.whole_s)
        if code:
            break
    assert code == 143
    assert all(record["status"] == "ok" for record in timeless(world).values()), errors

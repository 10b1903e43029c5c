"""SIGKILL at random moments, and two runs at once: the records are those of an undisturbed run."""

from __future__ import annotations

import json
import random
import shutil
import subprocess
import sys
import time
from pathlib import Path

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

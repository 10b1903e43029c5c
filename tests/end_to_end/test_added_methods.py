"""A method with an interpreter of its own, through eval, resume, kill, change and report."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

pytestmark = pytest.mark.nightly

EXAMPLE = Path(__file__).parents[2] / "examples" / "voxel_carving"

#: The example's code on the very same photos, as a method of this interpreter.
HERE = """\
import importlib.util
import sys
from pathlib import Path

from harness.core.artifacts import Reconstruction
from harness.core.mesh import Mesh
from harness.core.protocols import MethodInfo
from methods.foreign.method_file import read_method
from methods.foreign.command_method import write_photos

FOLDER = Path({folder!r})


class Here:
    info = MethodInfo(name="carved-here", title="In this process",
                      privileges=read_method(FOLDER).privileges)

    def reconstruct(self, capture, context):
        write_photos(context.workdir / "photos", read_method(FOLDER), self.info, capture, context)
        spec = importlib.util.spec_from_file_location("carving", FOLDER / "run.py")
        module = importlib.util.module_from_spec(spec)
        sys.modules["carving"] = module
        spec.loader.exec_module(module)
        return Reconstruction(Mesh(*module.reconstructed(context.workdir / "photos", 0.04)))


here = Here()
"""
SLOW = """\
import os, pathlib, time
pathlib.Path("{mark}").write_text(str(os.getpid()))
time.sleep(60)
"""


@pytest.fixture
def method(world, tmp_path_factory, monkeypatch) -> Path:
    """The example with another interpreter, added to the world, and the plug-in beside it."""
    place = tmp_path_factory.mktemp("added")
    folder = place / "voxel_carving"
    shutil.copytree(EXAMPLE, folder, ignore=shutil.ignore_patterns("__pycache__"))
    # Another path to this interpreter is another one for all that the harness knows.
    program = place / "python"
    program.write_text(f'#!/bin/sh\nexec {sys.executable} "$@"\n')
    program.chmod(0o755)
    described = (folder / "method.toml").read_text().replace("voxel_m = 0.02", "voxel_m = 0.04")
    (folder / "method.toml").write_text(f'python = "{program}"\n{described}')
    (place / "carved_here.py").write_text(HERE.format(folder=str(folder)))
    about = place / "carved_here-1.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: carved-here\nVersion: 1\n")
    points = "[harness.methods]\ncarved-here = carved_here:here\n"
    (about / "entry_points.txt").write_text(points)
    monkeypatch.setenv("PYTHONPATH", str(place), prepend=os.pathsep)
    return folder


def record(world: Path, method: str, subject: str = "t1") -> dict:
    return json.loads((world / f"runs/main/{method}/{subject}/record.json").read_text())


def test_it_is_a_method_like_any_other(world, photographed, method, harness, eval_toy):
    added = harness("methods", "add", str(method / "method.toml"))
    assert added.returncode == 0, added.stderr
    assert "Next: harness eval --method voxel-carving" in added.stdout
    assert json.loads(harness("methods", "list", "--json").stdout)["methods"]["voxel-carving"]
    assert "Voxel carving" in harness("methods", "show", "voxel-carving").stdout

    one = ("--subjects", "t1", "--protocol", "exact")
    done = eval_toy("voxel-carving,carved-here", *one)
    assert done.returncode == 0, done.stderr
    theirs, ours = record(world, "voxel-carving"), record(world, "carved-here")
    assert theirs["metrics"] == ours["metrics"]
    assert theirs["files"]["mesh.ply"] == ours["files"]["mesh.ply"]
    assert [part["role"] for part in theirs["method"]["parts"]] == ["program", "environment"]
    assert [stage["name"] for stage in theirs["stages"]] == ["photos", "command", "mesh"]

    again = eval_toy("voxel-carving", *one)
    assert "1 ok (1 cached)" in again.stdout
    table = harness("report", "--table", "geometry")
    assert "Voxel carving, one file" in table.stdout

    # Another code is another method.
    code = (method / "run.py").read_text()
    (method / "run.py").write_text(code.replace("level: float = 0.5", "level: float = 0.6"))
    plan = eval_toy("voxel-carving", *one, "--dry-run").stdout
    assert "changed: " in plan
    assert "1 of 1 cells would run" in plan
    assert eval_toy("voxel-carving", *one).returncode == 0
    assert record(world, "voxel-carving")["metrics"] != ours["metrics"]

    assert harness("methods", "remove", "voxel-carving").returncode == 0
    gone = eval_toy("voxel-carving", *one)
    assert gone.returncode == 2
    assert "unknown method 'voxel-carving'" in gone.stderr


def test_a_killed_run_leaves_nothing_and_goes_on(world, photographed, method, harness, eval_toy):
    assert harness("methods", "add", str(method)).returncode == 0
    code, mark = (method / "run.py").read_text(), world / "mark"
    (method / "run.py").write_text(SLOW.format(mark=mark))
    command = [sys.executable, "-m", "harness.cli.main", "eval", "--dataset", "toy", "--recipe",
               "tiny", "--method", "voxel-carving", "--subjects", "t1"]  # fmt: skip
    run = subprocess.Popen(command, cwd=world, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    end = time.monotonic() + 120
    while not (mark.exists() and mark.read_text()):
        assert time.monotonic() < end
        time.sleep(0.05)
    foreign = psutil.Process(int(mark.read_text()))
    run.kill()
    run.wait()
    foreign.wait(timeout=20)

    (method / "run.py").write_text(code)
    done = eval_toy("voxel-carving", "--subjects", "t1")
    assert done.returncode == 0, done.stderr
    assert not list((world / "runs").rglob(".attempt*"))

    # A command that fails is a record with its last words.
    (method / "run.py").write_text("raise SystemExit('no such network')")
    failed = eval_toy("voxel-carving", "--subjects", "t1")
    assert failed.returncode == 1
    assert "no such network" in record(world, "voxel-carving")["reason"]

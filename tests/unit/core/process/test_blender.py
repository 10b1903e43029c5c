"""Blender elsewhere: another interpreter, or a program that stands in for the user's own."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from harness.core.errors import MissingPart
from harness.core.process import blender
from harness.core.process.blender import find_blender
from harness.core.process.workers import WorkerDied, run_worker

#: Answers as the program does, and runs a script with nothing that is installed for this Python.
PROGRAM = """\
#!{python} -SE
import runpy, sys
if sys.argv[1:] == ["--version"]:
    print("Blender {version} LTS\\n\\tbuild date: 2026-01-01")
    raise SystemExit
assert sys.argv[1:3] == ["--background", "--factory-startup"], sys.argv
print("Blender quits")
runpy.run_path(sys.argv[sys.argv.index("--python") + 1], run_name="__main__")
"""
WORKER = """\
import sys

from harness.core.errors import DataError
from harness.core.process.workers import worker_main


def handle(job, report):
    report(1, 2)
    if job["bad"]:
        raise DataError("it cannot be drawn", expected="a square", got="a circle", hint="Mend it")
    site = [path for path in sys.path if "site-packages" in path]
    return {"site": site, "flag": sys.flags.no_site}


if __name__ == "__main__":
    worker_main(handle)
"""


@pytest.fixture
def no_blender(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is named, installed or on the path."""
    for variable in (blender.PYTHON_VARIABLE, blender.PROGRAM_VARIABLE):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setattr(blender, "installed_version", lambda name: "")
    monkeypatch.setenv("PATH", "")


@pytest.fixture
def worker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The name of a module that draws in Blender."""
    package = tmp_path / "code" / "drawing"
    package.mkdir(parents=True)
    (package / "__init__.py").touch()
    (package / "draw_worker.py").write_text(WORKER)
    monkeypatch.syspath_prepend(package.parent)
    return "drawing.draw_worker"


def program(folder: Path, version: str = "4.5.3", name: str = "blender") -> Path:
    path = folder / name
    path.write_text(PROGRAM.format(python=sys.executable, version=version))
    path.chmod(0o755)
    return path


def test_a_worker_runs_in_the_users_program_without_what_is_installed_here(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, no_blender: None, worker: str
) -> None:
    monkeypatch.setenv(blender.PROGRAM_VARIABLE, str(program(tmp_path)))
    found = find_blender()
    heard: list[tuple[int, int]] = []
    answer = run_worker(
        found.worker(worker), {"bad": False}, progress=lambda *counts: heard.append(counts)
    )
    assert (found.version, answer["flag"], answer["site"]) == ("4.5.3", 1, [])
    assert heard == [(1, 2)]
    with pytest.raises(Exception, match=r"cannot be drawn \(expected a square; got a circle\)"):
        run_worker(found.worker(worker), {"bad": True})


def test_a_program_that_dies_is_told_with_its_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, no_blender: None, worker: str
) -> None:
    monkeypatch.setenv(blender.PROGRAM_VARIABLE, str(program(tmp_path)))
    with pytest.raises(WorkerDied, match=r"drawing\.draw_worker ended(.|\n)*KeyError: .bad"):
        run_worker(find_blender().worker(worker), {})


def test_the_program_is_found_on_the_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, no_blender: None
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(MissingPart, match="Blender is not installed.*HARNESS_BLENDER_PYTHON"):
        find_blender()
    place = str(program(tmp_path, "5.1.0"))
    assert (find_blender().version, find_blender().place) == ("5.1.0", place)


def test_an_old_program_and_one_that_does_not_answer_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, no_blender: None
) -> None:
    monkeypatch.setenv(blender.PROGRAM_VARIABLE, str(program(tmp_path, "4.1.1")))
    with pytest.raises(MissingPart, match=r"Blender 4\.1\.1 .* too old \(expected 4\.2 or newer"):
        find_blender()
    monkeypatch.setenv(blender.PROGRAM_VARIABLE, str(tmp_path / "none"))
    with pytest.raises(MissingPart, match="no Blender behind.*HARNESS_BLENDER"):
        find_blender()


def test_another_python_is_asked_for_its_module(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, no_blender: None
) -> None:
    bare = tmp_path / "python"
    bare.write_text(f'#!/bin/sh\nexec "{sys.executable}" -S "$@"\n')
    bare.chmod(0o755)
    monkeypatch.setenv(blender.PYTHON_VARIABLE, str(bare))
    with pytest.raises(MissingPart, match=r"no Blender behind .*python .*bpy"):
        find_blender()


def test_workers_of_blender_import_numpy_and_nothing_else_of_others(tmp_path: Path) -> None:
    """What a bare interpreter has to have: a stand-in for bpy beside it shows what is imported."""
    (tmp_path / "bpy.py").write_text("class types:\n    Object = None\n")
    listing = (
        "import sys, json; sys.path.insert(0, sys.argv[1]); "
        "import renderers.blender.worker, clothed_avatars.clothes.drape_worker; "
        "tops = {name.partition('.')[0] for name in sys.modules}; "
        "print(json.dumps(sorted(tops - set(sys.stdlib_module_names))))"
    )
    done = subprocess.run(
        [sys.executable, "-c", listing, str(tmp_path)], capture_output=True, text=True, check=True
    )
    ours = {name for name in json.loads(done.stdout) if not name.startswith(("_", "sitecustom"))}
    assert ours - {"cython_runtime"} == {"bpy", "clothed_avatars", "harness", "numpy", "renderers"}

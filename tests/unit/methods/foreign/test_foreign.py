"""Interpreters of methods: what they have, and what they are given."""

from __future__ import annotations

import stat
import sys
from pathlib import Path

import pytest

from harness.core.errors import MissingPart
from methods.foreign.interpreter import Interpreter, environment_of

WANTED = ("toy", ("json", "toy_network.model"), "harness recipes install toy")


@pytest.fixture
def packages(tmp_path) -> Path:
    """What the foreign interpreter has: a namespace package, as some networks are."""
    place = tmp_path / "site"
    (place / "toy_network").mkdir(parents=True)
    (place / "toy_network" / "model.py").write_text("factor = 2.0\n")
    return place


@pytest.fixture
def foreign(tmp_path, packages) -> Interpreter:
    program = tmp_path / "python"
    program.write_text(f'#!/bin/sh\nPYTHONPATH={packages} exec {sys.executable} "$@"\n')
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    return Interpreter(program)


def test_what_an_interpreter_has_is_found_without_importing_it(foreign, packages):
    (packages / "toy_network" / "model.py").write_text("raise SystemExit('imported')\n")
    found = foreign.packages(*WANTED)
    assert found.python == sys.version.split()[0]
    assert Path(found.place) == packages / "toy_network"
    assert len(found.sha256) == 64


def test_another_package_has_another_digest(packages):
    digests = []
    for content in ("factor = 2.0\n", "factor = 3.0\n"):
        (packages / "toy_network" / "model.py").write_text(content)
        # A path of its own, because an interpreter is asked once a process.
        other = packages.parent / f"site{len(digests)}"
        packages.rename(other)
        digests.append(Interpreter(None, (other,)).packages(*WANTED).sha256)
        other.rename(packages)
    assert digests[0] != digests[1]


def test_what_is_missing_is_named_with_the_command():
    with pytest.raises(MissingPart, match="no toy_network.model.*Run: harness recipes install toy"):
        Interpreter(None).packages(*WANTED)


@pytest.mark.parametrize("program", ["gone", "broken"])
def test_an_interpreter_that_does_not_run_is_said(program, tmp_path):
    path = tmp_path / program
    if program == "broken":
        path.write_text("#!/bin/sh\necho no such library >&2\nexit 3\n")
        path.chmod(0o755)
    with pytest.raises(MissingPart, match="does not run.*Run: harness recipes install toy"):
        Interpreter(path).packages(*WANTED)


def test_a_foreign_interpreter_does_not_get_our_packages():
    base = {"PYTHONPATH": "/ours", "PYTHONHOME": "/other", "VIRTUAL_ENV": "/venv", "LANG": "C"}
    foreign = environment_of(Interpreter(Path("/there/python"), (Path("/there/vggt"),)), base)
    assert foreign == {"PYTHONPATH": "/there/vggt", "PYTHONSAFEPATH": "1", "LANG": "C"}
    own = environment_of(Interpreter(), base)
    assert own["PYTHONPATH"] == "/ours"
    assert "PYTHONPATH" not in environment_of(Interpreter(Path("/there/python")), base)

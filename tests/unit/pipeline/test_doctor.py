"""The doctor names what is missing and the line that installs it."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

from harness.pipeline import doctor

ROOT = Path(__file__).resolve().parents[3]


@pytest.mark.skipif(sys.platform != "linux", reason="shared libraries of Linux")
def test_all_missing_libraries_are_named_in_one_line(monkeypatch):
    monkeypatch.setitem(doctor._DEBIAN_PACKAGES, "libnowhere.so.1", "libnowhere1")
    monkeypatch.setitem(doctor._DEBIAN_PACKAGES, "libnothing.so.2", "libnothing2")
    found = doctor._system_libraries(("libc.so.6", "libnowhere.so.1", "libnothing.so.2"))
    assert not found.usable
    assert found.next_step == "sudo apt-get install -y libnowhere1 libnothing2"
    assert doctor._system_libraries(("libc.so.6",)).usable


def test_a_package_that_is_not_there(tmp_path):
    found = doctor._module("no_such_module_here", "no-such-package", "nothing")
    assert not found.usable
    assert "No module named" in found.note
    assert found.next_step == "pip install -c constraints.txt no-such-package"


def test_a_module_that_kills_its_process_does_not_kill_the_doctor(tmp_path, monkeypatch):
    (tmp_path / "deadly.py").write_text("import os; os.abort()")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    found = doctor._module("deadly", "deadly", "testing")
    assert not found.usable
    assert "exit status" in found.note


def test_the_readme_installs_every_library_that_the_doctor_knows():
    readme = (ROOT / "README.md").read_text()
    for package in doctor._DEBIAN_PACKAGES.values():
        assert re.search(rf"\b{re.escape(package)}\b", readme), package

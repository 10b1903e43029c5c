"""The doctor names what is missing and the line that installs it."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

from harness.cli import doctor
from harness.core.files.atomic import write_json
from harness.core.files.hashing import file_sha256
from methods.mexecon import econ
from methods.normals import installed
from methods.normals.installed import OPEN_NETWORK

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


def test_the_open_network_is_named_with_what_to_do_without_it(tmp_path, monkeypatch):
    place = installed.Place("shipped", tmp_path)
    monkeypatch.setattr(installed, "shipped_places", lambda: (place,))
    found = doctor._open_network()
    assert (found.kind, found.name, found.usable) == ("network", OPEN_NETWORK, False)
    assert found.needed == (econ.settings.normals == "open")
    assert "harness train normals" in found.next_step

    (tmp_path / "n.onnx").write_bytes(b"network")
    entry = {
        "file": "n.onnx",
        "sha256": file_sha256(tmp_path / "n.onnx"),
        "licence": "CC0-1.0",
        "training_set": "avatars-train t00001..t00020, version 8",
        "bytes": 3 * 2**20,
    }
    write_json(place.index, {OPEN_NETWORK: entry})
    found = doctor._open_network()
    assert found.usable
    for text in ("3.0 MiB", "CC0-1.0", "t00001..t00020, version 8", entry["sha256"][:12]):
        assert text in found.note

    (tmp_path / "n.onnx").write_bytes(b"another")
    found = doctor._open_network()
    assert not found.usable
    assert "not the one that was shipped" in found.note


def test_a_method_whose_network_is_not_there_is_not_usable(tmp_path, monkeypatch):
    monkeypatch.setattr(installed, "shipped_places", tuple)
    monkeypatch.setattr("methods.mexecon.econ", econ.configured({"surface.normals": "open"}))
    found = {finding.name: finding for finding in doctor._catalogued()}
    assert not found["econ"].usable
    assert f"no network '{OPEN_NETWORK}'" in found["econ"].note
    assert found["hull8"].usable


def test_a_part_that_was_not_imported_is_named_with_its_source_and_command(tmp_path, monkeypatch):
    monkeypatch.setenv("HARNESS_WEIGHTS", str(tmp_path / "weights"))
    found = doctor._part("normals-onnx")
    assert (found.kind, found.usable, found.needed) == ("part", False, False)
    assert "harness parts import normals-onnx" in found.next_step
    entry = {"file": "n.onnx", "sha256": "0", "licence": "MIT", "training_set": "", "bytes": 1}
    (tmp_path / "weights").mkdir()
    write_json(tmp_path / "weights" / "weights.json", {"mine": entry})
    assert "mine" in doctor._part("normals-onnx").note
    write_json(tmp_path / "weights" / "weights.json", {"mine": {}})
    assert "the entry 'mine' is not right" in doctor._part("normals-onnx").note

"""What is kept of a parsed file: used for the same content only, and never needed."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

import pytest

from harness.core.process import source_digest as own
from harness.core.process.source_digest import ModuleSource, module_source

TEXT = '''"""Its docstring."""
from . import beside
from .parts import deep


def run():
    """Its docstring."""
    return beside.first, deep, "methods.job.worker"
'''


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    monkeypatch.setattr(sys, "pycache_prefix", None)
    path = tmp_path / "one.py"
    path.write_text(TEXT)
    return path


def read_anew(path: Path, name: str = "methods.one") -> ModuleSource:
    """As another process reads it, which remembers nothing."""
    own._known.cache_clear()
    return module_source(path, name)


def kept(path: Path) -> Path:
    """Where the answer is kept."""
    (found,) = path.parent.joinpath("__pycache__").glob("*.json")
    return found


def no_parser(*_: object) -> None:
    raise AssertionError


def test_what_a_file_says(file: Path) -> None:
    found = read_anew(file)
    assert found.imports == ("methods.beside", "methods.parts.deep")
    assert found.texts == ("methods.job.worker",)
    assert {"beside", "first", "deep"} <= found.identifiers


def test_another_process_does_not_parse_it_again(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = read_anew(file)
    monkeypatch.setattr(own.ast, "parse", no_parser)
    assert read_anew(file) == first


def test_another_content_of_the_same_age_and_size_is_parsed(file: Path) -> None:
    first, stamp = read_anew(file), file.stat().st_mtime_ns
    file.write_text(TEXT.replace("first", "third"))
    os.utime(file, ns=(stamp, stamp))
    assert "third" in read_anew(file).identifiers
    assert read_anew(file).digest != first.digest


def test_the_same_file_in_another_package_imports_others(file: Path) -> None:
    read_anew(file)
    assert read_anew(file, "metrics.one").imports == ("metrics.beside", "metrics.parts.deep")


def test_what_another_version_found_is_not_used(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read_anew(file)
    before = kept(file).read_text()
    monkeypatch.setattr(own, "_maker", lambda: b"another version")
    read_anew(file)
    assert kept(file).read_text() != before


@pytest.mark.parametrize("damage", ["", "{", "[]", "null"])
def test_a_damaged_answer_is_worked_out_again(file: Path, damage: str) -> None:
    first = read_anew(file)
    kept(file).write_text(damage)
    assert read_anew(file) == first
    assert json.loads(kept(file).read_text())["digest"] == first.digest


def test_where_nothing_can_be_written_files_are_parsed(file: Path) -> None:
    # A file in the folder's place: permissions mean nothing to root.
    file.parent.joinpath("__pycache__").write_text("")
    first = read_anew(file)
    assert read_anew(file) == first


def test_where_python_may_not_write_the_answer_is_kept_in_the_users_folder(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    monkeypatch.setenv("XDG_CACHE_HOME", str(file.parent / "caches"))
    first = read_anew(file)
    assert not file.parent.joinpath("__pycache__").exists()
    assert len(list(file.parent.joinpath("caches").glob("mexecon-harness/sources/*.json"))) == 1
    monkeypatch.setattr(own.ast, "parse", no_parser)
    assert read_anew(file) == first

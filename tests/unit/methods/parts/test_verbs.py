"""``harness parts`` as a person runs it, with the catalogue's kinds and one of the tests' own."""

from __future__ import annotations

import json
import sys

import pytest

from harness.cli.main import main
from methods.parts.kind import KINDS, all_kinds


@pytest.fixture
def harness(monkeypatch, capsys):
    """``harness("list", "--json")``: exit code, standard output, standard error."""

    def run(*arguments: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["harness", "parts", *arguments])
        with pytest.raises(SystemExit) as ended:
            main()
        return (int(ended.value.code or 0), *capsys.readouterr())

    return run


def test_list_import_verify(harness, toy, toy_file):
    code, told, _ = harness("list")
    assert code == 0
    for text in ("toy: plaything, letters in capitals", "CC0-1.0", "Write it yourself",
                 "toy.txt, toy.text", "missing  harness parts import toy toy.txt"):  # fmt: skip
        assert text in told
    assert harness("verify")[1] == "no part to verify\n"
    code, told, _ = harness("import", "toy", str(toy_file))
    assert code == 0
    assert "toy: toy of 9 letters, CC0-1.0, sha256" in told
    assert "Next: harness eval --toy toy" in told
    assert "present  toy, 0.0 MiB, sha256" in harness("list")[1]
    (kind,) = json.loads(harness("list", "--json")[1])
    assert (kind["name"], kind["state"], kind["files"]) == (
        "toy",
        "present",
        ["toy.txt", "toy.text"],
    )
    code, told, _ = harness("verify", "toy")
    assert (code, told.split()[:3]) == (0, ["ok", "toy", "imported"])
    (toy.find().file("upper.txt")).unlink()
    assert harness("verify")[0] == 1


def test_mistakes_are_one_sentence(harness, toy, toy_file, tmp_path):
    code, _, told = harness("import", "toi", str(toy_file))
    assert (code, "unknown kind of part 'toi'" in told, "Did you mean 'toy'" in told) == (2, 1, 1)
    code, _, told = harness("import", "toy", str(tmp_path / "none"))
    assert (code, told.count("\n")) == (3, 1)
    assert harness("import", "toy", str(toy_file), "--recipe", "david")[0] == 2
    assert harness("verify", "toy")[0] == 2


def test_every_kind_says_what_a_person_needs(parts):
    assert [kind.about.name for kind in all_kinds()] == list(KINDS)
    for kind in all_kinds():
        about = kind.about
        assert all((about.role, about.purpose, about.licence, about.source, about.files))
        assert not about.purpose.endswith(".")
        assert not about.source.endswith(".")
        assert about.command.startswith(f"harness parts import {about.name} ")

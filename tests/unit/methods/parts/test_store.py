"""A converted part is kept whole with its sums and licence, or not at all."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from harness.core.errors import DataError, HarnessError, MissingPart
from harness.core.files.hashing import file_sha256
from harness.core.protocols import Part
from methods.parts.kind import ImportOptions, State
from methods.parts.store import parts_folder

SILENT = ImportOptions()


def test_what_was_imported_is_found_with_what_was_noted(toy, toy_file, parts):
    assert toy.installed() == []
    part = toy.add(toy_file, SILENT)
    assert list(toy.installed()) == [part] == [toy.find().installed] == [toy.find("toy").installed]
    assert toy.find().file("upper.txt").read_text() == "TOY TRAIN"
    assert (part.title, part.licence, part.bytes) == ("toy of 9 letters", "CC0-1.0", 10)
    assert part.part("plaything") == Part("plaything", "toy of 9 letters", "CC0-1.0", part.sha256)
    note = json.loads((parts / "toy" / "toy" / "part.json").read_text())
    assert note["licence"] == "CC0-1.0"
    assert note["source"] == {"name": "toy.txt", "bytes": 9, "sha256": file_sha256(toy_file)}
    assert [file["name"] for file in note["files"]] == ["length.txt", "upper.txt"]
    assert toy.check(part).state == State.OK
    assert {path.name for path in (parts / "toy").iterdir()} == {".lock", "toy"}


def test_the_sum_covers_every_file_and_what_was_noted(toy, toy_file, tmp_path):
    plain = toy.add(toy_file, SILENT).sha256
    assert toy.add(toy_file, ImportOptions(name="again")).sha256 == plain
    noted = toy.add(toy_file, ImportOptions(name="other", python=Path("/usr/bin/python3")))
    assert noted.sha256 != plain
    assert toy.find("other").details == {"python": "/usr/bin/python3"}
    (tmp_path / "toy2.txt").write_text("toy brain")  # as long, so one converted file is the same
    assert toy.add(tmp_path / "toy2.txt", ImportOptions(name="2")).sha256 != plain


def test_another_file_needs_permission(toy, toy_file, tmp_path):
    first = toy.add(toy_file, SILENT)
    assert toy.add(toy_file, SILENT) == first
    other = tmp_path / "other.txt"
    other.write_text("toy horse and cart")
    with pytest.raises(HarnessError, match="'toy' was imported from another file.*--replace"):
        toy.add(other, SILENT)
    assert toy.find().installed == first
    assert toy.add(other, ImportOptions(replace=True)) == toy.find().installed != first


def test_several_parts_of_a_kind_are_told_apart(toy, toy_file):
    with pytest.raises(MissingPart, match=r"no part 'toy'.*toy.txt or toy.text.*Write it yourself"):
        toy.find()
    a = toy.add(toy_file, ImportOptions(name="a"))
    assert toy.find().installed == a, "the only one needs no name"
    b = toy.add(toy_file, ImportOptions(name="b"))
    assert (toy.find("a").installed, toy.find("b").installed) == (a, b)
    assert (a.label, toy.add(toy_file, SILENT).label) == ("toy/a", "toy")
    assert toy.find().installed.name == "toy"
    with pytest.raises(MissingPart, match="no part 'toy'.*only a, b, toy"):
        toy.find("c")
    toy.find().file("part.json").unlink()
    with pytest.raises(MissingPart, match="several parts 'toy'.*a, b"):
        toy.find()


@pytest.mark.parametrize("name", ["../x", "a/b", ".a", "a b"])
def test_names_that_cannot_be(toy, toy_file, name, parts):
    with pytest.raises(HarnessError, match="a part cannot be called"):
        toy.add(toy_file, ImportOptions(name=name))
    assert not parts.exists()


def test_options_that_a_kind_does_not_take(toy, toy_file):
    with pytest.raises(HarnessError, match="'toy' does not take --recipe.*--name, --python"):
        toy.add(toy_file, ImportOptions(recipe="david"))


def test_a_bad_file_leaves_nothing(toy, tmp_path, parts):
    (tmp_path / "empty.txt").touch()
    (tmp_path / "bad.txt").write_text("lorry")
    for name, message in (
        ("none.txt", "no file at"),
        ("empty.txt", "is empty"),
        ("bad.txt", "is no toy"),
    ):
        with pytest.raises(DataError, match=message):
            toy.add(tmp_path / name, SILENT)
    assert not parts.exists()


def test_a_conversion_that_fails_leaves_what_was_there(toy, toy_file, monkeypatch, parts):
    first = toy.add(toy_file, SILENT)
    monkeypatch.setattr(Path, "write_text", lambda *_: (_ for _ in ()).throw(RuntimeError))
    with pytest.raises(RuntimeError):
        toy.add(toy_file, SILENT)
    monkeypatch.undo()
    monkeypatch.setenv("HARNESS_PARTS", str(parts))
    assert toy.find().installed == first
    assert {path.name for path in (parts / "toy").iterdir()} == {".lock", "toy"}


def test_files_that_are_not_the_ones_are_not_used(toy, toy_file):
    part = toy.add(toy_file, SILENT)
    path = part.path / "upper.txt"
    path.write_text("TOY DRAIN")
    with pytest.raises(DataError, match="'toy' is not the one.*upper.txt: sha256.*--replace"):
        toy.find()
    assert toy.check(part).state == State.CORRUPT
    path.write_text("TOY")
    assert toy.check(part).note == "upper.txt: 3 bytes, expected 9"
    path.unlink()
    assert toy.check(part).state == State.MISSING
    with pytest.raises(MissingPart, match="no file at.*import toy toy.txt --replace"):
        toy.find()


def test_a_conversion_that_cannot_be_loaded_is_a_missing_part(toy, toy_file):
    with pytest.raises(MissingPart, match="what imports 'toy' could not be loaded.*nowhere"):
        replace(toy, examiner="nowhere:examine").add(toy_file, SILENT)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"name": "other"}, "not the note of what is beside it"),
        ({"files": [{"name": "../x", "bytes": 1, "sha256": "0"}]}, "not the note of what"),
        ({"licence": 3}, "not a note of an imported part.*text at 'licence'"),
    ],
)
def test_a_note_that_is_not_right(toy, toy_file, change, message):
    path = toy.add(toy_file, SILENT).path / "part.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **change}))
    with pytest.raises(DataError, match=message):
        toy.installed()


def test_where_parts_are(monkeypatch, tmp_path):
    monkeypatch.setenv("HARNESS_PARTS", str(tmp_path / "p"))
    assert parts_folder() == tmp_path / "p"
    monkeypatch.delenv("HARNESS_PARTS")
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    assert parts_folder() == tmp_path / "mexecon-harness" / "parts"


def test_what_an_import_has_not_finished_is_no_part(toy, toy_file, parts):
    part = toy.add(toy_file, SILENT)
    half = parts / "toy" / ".toy.0123456789ab.part"
    shutil.copytree(parts / "toy" / "toy", half)
    assert list(toy.installed()) == [part]
    assert toy.find("toy").installed == part
    # What a killed import left goes with the next one.
    assert toy.add(toy_file, SILENT) == part
    assert not half.exists()

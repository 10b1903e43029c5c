"""Networks by name: what is imported is what is found, and nothing else is."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from harness.core.errors import DataError, HarnessError, MissingPart
from harness.core.files.hashing import file_sha256
from methods.normals import installed
from methods.normals.estimators import NormalChoice
from methods.normals.onnx_estimator import OnnxNormals
from methods.parts.onnx_networks import read_network


@pytest.fixture
def own(places) -> installed.Place:
    return installed.imported_place()


@pytest.fixture
def file(tmp_path, save_network) -> Path:
    return save_network(tmp_path / "net.onnx")


def test_an_imported_network_is_found_with_what_it_says(own, file):
    assert installed.listed(own) == []
    imported = installed.import_file(file, "mine", own)
    assert installed.listed(own) == [imported] == [installed.find("mine", own)]
    assert imported.path.read_bytes() == file.read_bytes()
    assert json.loads(own.index.read_text()) == {
        "mine": {
            "file": "mine.onnx",
            "sha256": file_sha256(file),
            "licence": "Apache-2.0",
            "training_set": "avatars-train t00001",
            "bytes": file.stat().st_size,
        }
    }
    assert (imported.part.name, imported.part.sha256) == ("mine", file_sha256(file))


def test_a_training_set_tells_whom_a_network_has_seen():
    """As it is written by ``harness train``, and as others write it."""

    def seen(text):
        place = installed.Place("imported", Path())
        return installed.Network("mine", Path(), "", "", text, 1, place).trained_on

    written = "avatars-train3 v00001, v00004..v00192; thuman21 0001, version 9"
    assert seen(written) == (
        "avatars-train3/v00001", "avatars-train3/v00004..v00192", "thuman21/0001",
    )  # fmt: skip
    assert seen("THuman2.0") == ("THuman2.0",)
    assert seen("") == ()
    shipped = installed.shipped().trained_on
    assert {each.partition("/")[0] for each in shipped} == {
        f"avatars-train{number}" for number in ("", 2, 3)
    }
    assert NormalChoice("open").trained_on == shipped
    assert NormalChoice("body").trained_on == ()


def test_other_content_needs_another_name_or_permission(own, file, tmp_path, save_network):
    first = installed.import_file(file, "mine", own)
    assert installed.import_file(file, "mine", own) == first
    other = save_network(tmp_path / "other.onnx", training_set="more")
    with pytest.raises(HarnessError, match="'mine' is another network already.*--replace"):
        installed.import_file(other, "mine", own)
    assert installed.find("mine", own) == first
    assert installed.import_file(other, "mine", own, replace=True) == installed.find("mine", own)
    assert installed.find("mine", own).sha256 == file_sha256(other)
    installed.import_file(file, "another", own)
    assert [network.name for network in installed.listed(own)] == ["another", "mine"]


def test_a_loaded_network_follows_its_file(own, file, tmp_path, save_network):
    path = installed.import_file(file, "mine", own).path
    first = installed.loaded(path)
    assert installed.loaded(path) is first
    other = save_network(tmp_path / "other.onnx", training_set="other")
    installed.import_file(other, "mine", own, replace=True)
    assert installed.loaded(path).training_set == "other"


@pytest.mark.parametrize("name", ["", "net.onnx", "../net", "a b", ".net", "a/b"])
def test_names_that_cannot_be(own, file, name):
    with pytest.raises(HarnessError, match="cannot be called"):
        installed.import_file(file, name, own)


def test_a_bad_file_changes_nothing(own, tmp_path, save_network):
    (tmp_path / "text.onnx").write_text("no")
    for path, message in (
        (tmp_path / "text.onnx", "not a network that can be run"),
        (tmp_path / "none.onnx", "no file at"),
        (save_network(tmp_path / "who.onnx", licence=""), "does not say what it is"),
        (save_network(tmp_path / "f.onnx", side=512, window="mask"), "cannot work on"),
    ):
        with pytest.raises(DataError, match=message):
            installed.import_file(path, "mine", own)
    assert not own.folder.exists()


def test_weights_beside_a_file_of_ones_own_are_in_its_sum(tmp_path, save_network):
    onnx = pytest.importorskip("onnx")
    plain = save_network(tmp_path / "n.onnx")
    assert installed.loaded(plain).part.sha256 == file_sha256(plain)
    model = onnx.load(plain)
    rows = np.zeros((1, 3, 1, 1), np.float32)
    model.graph.initializer.append(onnx.numpy_helper.from_array(rows, "offset"))
    model.graph.node[0].op_type = "Add"
    model.graph.node[0].input.append("offset")
    path = tmp_path / "split.onnx"
    onnx.save(model, path, save_as_external_data=True, location="split.data", size_threshold=0)
    before = installed.loaded(path).part.sha256
    unchanged = file_sha256(path)
    assert before != unchanged
    (tmp_path / "split.data").write_bytes(rows.tobytes()[:-4] + np.float32(1).tobytes())
    assert installed.loaded(path).part.sha256 != before
    assert file_sha256(path) == unchanged, "the file itself tells nothing of it"
    (tmp_path / "split.data").unlink()
    with pytest.raises(DataError, match="not whole.*split.data"):
        installed.loaded(path)


@pytest.mark.parametrize("place", ["../else/split.data", "{root}/else/split.data", "link.data"])
def test_weights_that_lie_elsewhere_are_refused_before_they_are_read(tmp_path, save_network, place):
    onnx = pytest.importorskip("onnx")
    for folder in ("here", "else"):
        (tmp_path / folder).mkdir()
    (tmp_path / "here" / "link.data").symlink_to("../else/split.data")
    model = onnx.load(save_network(tmp_path / "n.onnx"))
    rows = onnx.numpy_helper.from_array(np.zeros((1, 3, 1, 1), np.float32), "offset")
    model.graph.initializer.append(rows)
    onnx.save(model, tmp_path / "else" / "n.onnx", save_as_external_data=True,
              location="split.data", size_threshold=0)  # fmt: skip
    model = onnx.load(tmp_path / "else" / "n.onnx", load_external_data=False)
    entries = model.graph.initializer[-1].external_data
    next(e for e in entries if e.key == "location").value = place.format(root=tmp_path)
    path = tmp_path / "here" / "n.onnx"
    path.write_bytes(model.SerializeToString())
    for read in (installed.loaded, OnnxNormals, read_network):
        with pytest.raises(DataError, match="outside the folders that were given"):
            read(path)


def test_weights_beside_the_file_are_refused(own, tmp_path, save_network):
    onnx = pytest.importorskip("onnx")
    model = onnx.load(save_network(tmp_path / "n.onnx"))
    rows = np.zeros((1, 3, 1, 1), np.float32)
    model.graph.initializer.append(onnx.numpy_helper.from_array(rows, "offset"))
    model.graph.node[0].CopyFrom(
        onnx.helper.make_node("Add", ["body_front", "offset"], ["front"], name="add")
    )
    path = tmp_path / "split.onnx"
    onnx.save(model, path, save_as_external_data=True, location="split.data", size_threshold=0)
    with pytest.raises(DataError, match="split.onnx cannot be used without other files"):
        installed.import_file(path, "mine", own)
    assert installed.listed(own) == []
    assert list(own.folder.glob("*.onnx")) == []


def test_a_file_that_is_not_the_one_is_not_used(own, file):
    network = installed.import_file(file, "mine", own)
    installed.import_file(file, "whole", own)
    network.path.write_bytes(b"other")
    with pytest.raises(DataError, match="not the one that was imported.*Import it again"):
        installed.find("mine", own)
    assert [check.state for check in installed.check()] == ["corrupt", "ok"]
    network.path.unlink()
    with pytest.raises(MissingPart, match="no network at.*parts import normals-onnx"):
        installed.find("mine", own)
    (found,) = installed.check(["mine"])
    assert found.state == "missing"
    with pytest.raises(HarnessError, match="unknown network 'min'.*Did you mean 'mine'"):
        installed.check(["min"])


def test_a_network_is_hashed_once_a_process_and_anew_when_verified(own, file, monkeypatch):
    installed.import_file(file, "mine", own)
    read = []
    monkeypatch.setattr(installed, "file_sha256", lambda path: read.append(path) or "0")
    installed._sum.cache_clear()
    for _ in range(3):
        with pytest.raises(DataError):
            installed.find("mine", own)
    assert len(read) == 1
    installed.check()
    installed.check()
    assert len(read) == 3
    installed._sum.cache_clear()


@pytest.mark.parametrize(
    "entry",
    [
        [],
        {"file": "a.onnx"},
        {"file": "../a.onnx", "sha256": "0", "licence": "x", "training_set": "", "bytes": 1},
        {"file": "a.onnx", "sha256": 0, "licence": "x", "training_set": "", "bytes": 1},
    ],
)
def test_an_index_that_is_not_right(own, entry):
    own.folder.mkdir()
    own.index.write_text(json.dumps({"a": entry}))
    with pytest.raises(DataError, match="the entry 'a' is not right"):
        installed.listed(own)


def test_where_imported_networks_are(monkeypatch, tmp_path):
    monkeypatch.setenv("HARNESS_WEIGHTS", str(tmp_path / "w"))
    assert installed.imported_place().folder == tmp_path / "w"
    monkeypatch.delenv("HARNESS_WEIGHTS")
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    assert installed.imported_place().folder == tmp_path / "mexecon-harness" / "weights"
    for unusable in ("", "relative/path"):
        monkeypatch.setenv("XDG_DATA_HOME", unusable)
        monkeypatch.setenv("HOME", str(tmp_path / "ada"))
        below = Path(".local/share/mexecon-harness/weights")
        assert installed.imported_place().folder == tmp_path / "ada" / below

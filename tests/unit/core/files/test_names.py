"""One rule for every name that becomes a folder."""

from __future__ import annotations

from pathlib import Path, PurePath

import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.cli.options import split_names
from harness.core.errors import HarnessError
from harness.core.files.names import checked_name, is_name, named_from
from harness.run.store import RunStore
from harness.run.workspace import Workspace

BAD = [
    "", ".", "..", "../../victim", "a/b", "/etc", "a\\b", ".hidden", "-rf", "+1", "a..b", "a b",
    "a\n", "a\0", "ü", "=1+1", "a" * 65, "~", "$HOME", "a*", "a:b",
]  # fmt: skip


@pytest.mark.parametrize(
    "name", ["avatars-tiny", "a01", "0021", "jmbo8+", "mexecon+", "v1.1", "_x", "A" * 64]
)
def test_usual_names_are_names(name):
    assert checked_name("run", name) == name


@pytest.mark.parametrize("name", BAD)
def test_what_could_lead_elsewhere_is_no_name(name):
    with pytest.raises(HarnessError, match="cannot be the name of a run .*letters"):
        checked_name("run", name)


@given(st.text(max_size=80))
def test_a_name_is_one_plain_part_of_a_path(text):
    if is_name(text):
        assert PurePath("folder", text).parts == ("folder", text)
        assert text.isascii()
        assert text.isprintable()
        assert text not in (".", "..")


@pytest.mark.parametrize("name", BAD)
def test_no_folder_is_made_of_another_name(name):
    place = Workspace(Path("/workspace"))
    store = RunStore(place.run("main"))
    for make in (
        lambda: place.run(name),
        lambda: place.capture(name, "a01", "paper8"),
        lambda: place.capture("avatars", name, "paper8"),
        lambda: place.capture("avatars", "a01", name),
        lambda: store.cell(name, "a01"),
        lambda: store.cell("gt", name),
    ):
        with pytest.raises(HarnessError, match="cannot be the name of"):
            make()


def test_a_name_in_a_list_counts_once():
    assert split_names("t2, t1..t3, t1") == ("t2", "t1", "t3")


def test_lists_on_the_command_line_are_names():
    assert split_names("a01, jmbo8+,t00001..t00003") == (
        "a01", "jmbo8+", "t00001", "t00002", "t00003",
    )  # fmt: skip
    for text in ("../a", "a01,../../b", "../a1..../a2", "t0000001..t9999999"):
        with pytest.raises(HarnessError, match="cannot be the name of a method or subject"):
            split_names(text)


@pytest.mark.parametrize(
    ("message", "told"),
    [
        ("mesh is twice {root}/data/toy/a.obj", "mesh is twice data/toy/a.obj"),
        ("{root}/a.ply and {root}/b.ply", "a.ply and b.ply"),
        ("/scans/a.obj has no faces", "/scans/a.obj has no faces"),
        ("{root}s/a.obj has no faces", "{root}s/a.obj has no faces"),
        ("/copy{root}/a.obj has no faces", "/copy{root}/a.obj has no faces"),
        ('"{root}/a.obj" has no faces', '"a.obj" has no faces'),
    ],
)
def test_files_below_a_folder_are_named_from_there(message, told, tmp_path):
    assert named_from(message.format(root=tmp_path), tmp_path) == told.format(root=tmp_path)


@pytest.mark.parametrize("folder", ["/", ".", "mine"])
def test_neither_the_whole_disk_nor_a_relative_folder_changes_a_message(folder):
    assert named_from("./a.obj, mine/a.obj and /a.obj", Path(folder)) == (
        "./a.obj, mine/a.obj and /a.obj"
    )

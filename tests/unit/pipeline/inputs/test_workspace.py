"""Folders of a workspace, and how messages name what is in them."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.pipeline.inputs.workspace import Workspace


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
def test_files_of_the_workspace_are_named_from_there(message, told, tmp_path):
    place = Workspace(tmp_path)
    assert place.within(message.format(root=tmp_path)) == told.format(root=tmp_path)


def test_a_workspace_that_is_the_whole_disk_changes_no_message():
    assert Workspace(Path("/")).within("/scans/a.obj") == "/scans/a.obj"

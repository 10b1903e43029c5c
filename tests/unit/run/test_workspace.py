"""Folders of a workspace, and how messages name what is in them."""

from __future__ import annotations

from harness.run.workspace import Workspace


def test_files_of_the_workspace_are_named_from_there(tmp_path):
    told = Workspace(tmp_path).within(f"mesh is twice {tmp_path}/data/toy/a.obj")
    assert told == "mesh is twice data/toy/a.obj"

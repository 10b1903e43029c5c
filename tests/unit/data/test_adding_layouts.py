"""Which layout a folder has: one is found, several or none are refused in words."""

from __future__ import annotations

import pytest

from harness.core.errors import DataError, HarnessError
from harness.data.layouts import Layout, find_layout


def put(root, *names):
    for name in names:
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("")


@pytest.mark.parametrize(
    ("names", "layout", "subjects"),
    [
        (("model/0001/0001.obj", "smplx/0001/mesh_smplx.obj"), Layout.tree, ["0001"]),
        (("b/b.obj", "a/a.obj", "a/a.ply"), Layout.tree, ["a", "b"]),
        (("a.obj", "b.glb", "c.PLY", "a.mtl", "a.jpg"), Layout.files, ["a", "b", "c"]),
        (("a/mesh.glb", "b/scan.obj", "b/scan.mtl"), Layout.folders, ["a", "b"]),
        (("a/capture.json", "b/paper8/capture.json"), Layout.captures, ["a", "b"]),
    ],
)
def test_each_layout_is_found(tmp_path, names, layout, subjects):
    put(tmp_path, *names)
    found = find_layout(tmp_path)
    assert found.layout is layout
    assert list(found.subjects) == subjects
    assert list(found.only(subjects[-1:]).subjects) == subjects[-1:]
    with pytest.raises(HarnessError, match="no subject 'zz'"):
        found.only(["zz"])


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ((), "none of the layouts.*an empty folder"),
        (("a.obj", "b/b.obj"), "more than one layout.*THuman.*: b; .*side by side.*: a"),
        (("a/a.obj", "b/scan.glb"), "more than one layout"),
        (("a/one.glb", "a/two.glb"), "subject 'a' .* several mesh files.*one.glb"),
        (("a.obj", "a.ply"), "subject 'a' .* several mesh files"),
        (("a/paper8/capture.json", "a/quick8/capture.json"), "'a' .* several captures"),
        (("Person one.obj",), "cannot be ids: 'Person one'.*Rename"),
        (("capture.json",), "one capture: name the folder above"),
        (("1.jpg", "2.jpg"), "harness capture import"),
        (("0001/mesh_smplx.obj", "0001/smplx_param.pkl"), "holds fits"),
        (("a/b/c/d.obj",), "none of the layouts"),
        (("a/meshes.abc",), "none of the layouts.*Alembic .* is not read: export one frame"),
    ],
)
def test_other_folders_are_refused_in_words(tmp_path, names, message):
    put(tmp_path, *names)
    with pytest.raises(DataError, match=message):
        find_layout(tmp_path)


def test_circles_of_links_have_an_end(tmp_path):
    (tmp_path / "loop").symlink_to(tmp_path)
    (tmp_path / "self").symlink_to("self")
    with pytest.raises(DataError, match="none of the layouts"):
        find_layout(tmp_path)
    with pytest.raises(DataError, match="no folder"):
        find_layout(tmp_path / "self")
    put(tmp_path, "a/scan.glb")
    assert list(find_layout(tmp_path).subjects) == ["a"]


@pytest.mark.parametrize("link", ["0001", "0001/0001.obj", "0002.glb", "0003/scan.ply"])
def test_links_out_of_the_folder_are_refused(tmp_path, link):
    put(tmp_path / "else", "0001.obj", "0001/0001.obj", "scan.ply", "0002.glb")
    path = tmp_path / "given" / link
    path.parent.mkdir(parents=True)
    path.symlink_to(tmp_path / "else" / path.name)
    with pytest.raises(DataError, match="outside the folders that were given"):
        find_layout(tmp_path / "given")
    (tmp_path / "mine").symlink_to("else/0001")
    assert list(find_layout(tmp_path / "mine").subjects) == ["0001"]

"""Mesh files by extension, checked against trimesh, and against bytes that were damaged."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from harness.core.errors import DataError
from harness.core.mesh import Mesh
from harness.files.mesh_files import MESH_SUFFIXES, MOST_MESH_BYTES, load_mesh, save_mesh

trimesh = pytest.importorskip("trimesh")

#: (file extension, trimesh's name of the form, its options)
FORMS = [
    ("obj", "obj", {}),
    ("ply", "ply", {"encoding": "binary"}),
    ("ply", "ply", {"encoding": "ascii"}),
    ("glb", "glb", {}),
    ("off", "off", {}),
    ("stl", "stl", {}),
    ("stl", "stl_ascii", {}),
]
IDS = ["obj", "ply", "ply ascii", "glb", "off", "stl", "stl ascii"]


def exported(form: str, options: dict) -> bytes:
    sphere = trimesh.creation.icosphere(subdivisions=1)
    content = sphere.export(file_type=form, **options)
    return content if isinstance(content, bytes) else content.encode()


@pytest.mark.parametrize(("suffix", "form", "options"), FORMS, ids=IDS)
def test_reads_what_trimesh_reads(tmp_path: Path, suffix: str, form: str, options: dict) -> None:
    path = tmp_path / f"sphere.{suffix}"
    path.write_bytes(exported(form, options))

    ours = load_mesh(path)
    theirs = trimesh.load(path, process=False, force="mesh")

    # Corner by corner: STL has no shared vertices, so the tables themselves may differ.
    expected = theirs.vertices[theirs.faces]
    np.testing.assert_allclose(ours.vertices[ours.faces], expected, atol=1e-7)
    assert ours.signed_volume == pytest.approx(theirs.volume, abs=1e-6)
    assert ours.signed_volume > 3


@pytest.mark.parametrize("suffix", ["ply", "obj"])
def test_trimesh_reads_what_we_write(tmp_path: Path, suffix: str) -> None:
    source = trimesh.creation.icosphere(subdivisions=1)
    path = tmp_path / f"sphere.{suffix}"

    save_mesh(path, Mesh(source.vertices, source.faces))
    back = trimesh.load(path, process=False)

    np.testing.assert_allclose(back.vertices[back.faces], source.vertices[source.faces], atol=1e-6)


@pytest.mark.parametrize(("suffix", "form", "options"), FORMS, ids=IDS)
@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_damaged_bytes_are_a_mesh_or_a_data_error(
    tmp_path: Path, suffix: str, form: str, options: dict, data: st.DataObject
) -> None:
    content = bytearray(exported(form, options))
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(content) - 1))
        match data.draw(st.sampled_from(["change", "cut", "remove"])):
            case "change":
                content[at] = data.draw(st.integers(0, 255))
            case "cut" if at:
                del content[at:]
            case _ if len(content) > 9:
                del content[at : at + 8]
    path = tmp_path / f"damaged.{suffix}"
    path.write_bytes(content)

    try:
        mesh = load_mesh(path)
    except DataError as error:
        assert str(path) in str(error)
    else:
        assert np.isfinite(mesh.vertices).all()
        assert mesh.area > 0


@pytest.mark.parametrize(("suffix", "form", "options"), FORMS, ids=IDS)
def test_a_truncated_file_is_always_an_error(
    tmp_path: Path, suffix: str, form: str, options: dict
) -> None:
    content = exported(form, options)
    path = tmp_path / f"short.{suffix}"
    # The last number of a text file may be cut without a trace; its line may not.
    for length in (0, 1, len(content) // 3, len(content) // 2, len(content) - 30):
        path.write_bytes(content[:length])
        if suffix == "obj" and content[:length].count(b"\nf ") > 1:
            continue  # an OBJ does not say how many faces it should have
        with pytest.raises(DataError, match=f"short.{suffix}"):
            load_mesh(path)


@pytest.mark.parametrize(
    ("name", "content", "hint"),
    [
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3 # belly\n", "Export it again"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n", "A point cloud has to be meshed"),
        ("a.off", "off\n", "Export it again"),
    ],
)
def test_a_refusal_says_what_to_do(tmp_path: Path, name: str, content: str, hint: str) -> None:
    (tmp_path / name).write_text(content)
    with pytest.raises(DataError, match=rf"{name} .*\. {hint}"):
        load_mesh(tmp_path / name)


@pytest.mark.parametrize("suffix", MESH_SUFFIXES)
def test_a_file_that_is_not_there(tmp_path: Path, suffix: str) -> None:
    with pytest.raises(DataError, match="no mesh at .*absent"):
        load_mesh(tmp_path / f"absent{suffix}")
    (tmp_path / f"folder{suffix}").mkdir()
    with pytest.raises(DataError, match="no mesh at .*folder"):
        load_mesh(tmp_path / f"folder{suffix}")


@pytest.mark.parametrize("suffix", MESH_SUFFIXES)
def test_a_file_that_may_not_be_read(
    tmp_path: Path, suffix: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / f"locked{suffix}"
    path.write_bytes(b"")

    def refuse(self: Path, *_: object, **__: object) -> bytes:
        raise PermissionError(13, "Permission denied", str(self))

    monkeypatch.setattr(Path, "read_bytes", refuse)
    monkeypatch.setattr(Path, "read_text", refuse)
    with pytest.raises(DataError, match="could not read .*locked.*Permission denied"):
        load_mesh(path)


def test_unknown_formats_are_named_with_the_known_ones(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"unknown mesh format .*\.ply, \.obj.*got \.fbx"):
        load_mesh(tmp_path / "body.fbx")
    with pytest.raises(DataError, match="got no extension"):
        load_mesh(tmp_path / "body")
    with pytest.raises(DataError, match=r"cannot write .*\.ply or \.obj; got \.stl"):
        save_mesh(tmp_path / "body.stl", Mesh(np.eye(3), np.array([[0, 1, 2]])))


def test_extensions_may_be_in_capitals(tmp_path: Path) -> None:
    path = tmp_path / "BODY.STL"
    path.write_bytes(exported("stl", {}))

    assert len(load_mesh(path).faces) == 80


def test_only_obj_has_a_texture_here(tmp_path: Path) -> None:
    path = tmp_path / "body.ply"
    path.write_bytes(exported("ply", {}))

    with pytest.raises(DataError, match="cannot be read with its texture .*an OBJ file"):
        load_mesh(path, texture=True)


@pytest.mark.parametrize("suffix", MESH_SUFFIXES)
def test_files_beyond_the_stated_size_are_refused_unread(tmp_path, suffix):
    path = tmp_path / f"huge{suffix}"
    with path.open("wb") as stream:
        stream.truncate(MOST_MESH_BYTES + 1)
    with pytest.raises(DataError, match=r"larger than any scan.*at most 536870912 bytes"):
        load_mesh(path)

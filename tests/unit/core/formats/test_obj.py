"""OBJ: every way to write a face, textures with seams, and one error per defect."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from harness.core.errors import DataError
from harness.core.mesh import Mesh
from harness.files.obj import read_obj, read_obj_colours, write_obj

V = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
VT = "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
VN = "vn 0 0 1\n"
SQUARE = [[0, 1, 2], [0, 2, 3]]


def read(folder: Path, text: str, *, texture: bool = False) -> Mesh:
    path = folder / "mesh.obj"
    path.write_bytes(text.encode())
    return read_obj(path, texture=texture)


@pytest.mark.parametrize(
    "faces",
    [
        "f 1 2 3\nf 1 3 4\n",
        "f 1 2 3 4\n",
        "f 1/1 2/2 3/3 4/4\n",
        "f 1//1 2//1 3//1 4//1\n",
        "f 1/1/1 2/2/1 3/3/1 4/4/1\n",
        "f -4 -3 -2 -1\n",
        "f -4/-4 -3/-3 -2/-2 -1/-1\n",
        "f 1 -3 3\nf -4 3 -1\n",
        "f  1\t2   3 4  \n",
        "f 1 2 \\\n3 4\n",
        "f 1 2 3 4",
    ],
)
def test_every_way_to_write_a_square(tmp_path: Path, faces: str) -> None:
    mesh = read(tmp_path, V + VT + VN + faces)

    np.testing.assert_array_equal(mesh.vertices, [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    assert mesh.faces.tolist() == SQUARE


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_comments_groups_and_line_ends(tmp_path: Path, end: str) -> None:
    text = "# f 9 9 9\no thing\ns off\n" + V + "g part\nusemtl a\nl 1 2\nf 1 2 3\n\nf 1 3 4\n"

    assert read(tmp_path, text.replace("\n", end)).faces.tolist() == SQUARE


def test_triangles_quads_and_pentagons_together(tmp_path: Path) -> None:
    mesh = read(tmp_path, V + "v 2 2 0\nf 1 2 3\nf 1 2 3 4\nf 1 2 5 3 4\n")

    assert mesh.faces.tolist() == [
        [0, 1, 2],
        [0, 1, 2], [0, 2, 3],
        [0, 1, 4], [0, 4, 2], [0, 2, 3],
    ]  # fmt: skip


@pytest.mark.parametrize("extra", [" 1", " 0.1 0.2 0.3", " 0.1 0.2 0.3 1"])
def test_weights_and_vertex_colours_are_not_positions(tmp_path: Path, extra: str) -> None:
    mesh = read(tmp_path, V.replace("\n", extra + "\n") + "f 1 2 3\n")

    assert mesh.vertices[2].tolist() == [1, 1, 0]


@pytest.mark.parametrize("number", ["1e-3", "+.001", "0.0010", "1.0E-03"])
def test_ways_to_write_a_number(tmp_path: Path, number: str) -> None:
    assert read(tmp_path, V.replace("v 1 1 0", f"v 1 1 {number}") + "f 1 2 3\n").vertices[2, 2] == (
        pytest.approx(0.001)
    )


def test_negative_indices_count_from_where_they_stand(tmp_path: Path) -> None:
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 0 0 5\nv 1 0 5\nv 0 1 5\nf -3 -2 -1\n"

    assert read(tmp_path, text).faces.tolist() == [[0, 1, 2], [3, 4, 5]]


def textured(folder: Path, *, mtl: str = "newmtl a\nmap_Kd skin.png\n", image: bool = True) -> str:
    (folder / "mesh.mtl").write_text(mtl)
    if image:
        (folder / "skin.png").write_bytes(b"")
    return "mtllib mesh.mtl\n" + V + VT + "usemtl a\nf 1/1 2/2 3/3\nf 1/4 3/1 4/2\n"


def test_a_texture_seam_does_not_split_vertices(tmp_path: Path) -> None:
    mesh = read(tmp_path, textured(tmp_path), texture=True)

    assert len(mesh.vertices) == 4
    assert mesh.faces.tolist() == SQUARE
    assert mesh.face_uv is not None
    assert mesh.face_uv.tolist() == [[0, 1, 2], [3, 0, 1]]
    assert mesh.uv is not None
    assert mesh.uv.tolist() == [[0, 0], [1, 0], [1, 1], [0, 1]]
    assert mesh.texture == tmp_path / "skin.png"


def test_seams_are_read_without_an_image(tmp_path: Path) -> None:
    path = tmp_path / "seams.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0.5\nf 1/1 2/2 3/1\n")
    mesh = read_obj(path, texture=False, seams=True)
    assert mesh.uv is not None
    assert mesh.uv.tolist() == [[0, 0], [1, 0.5]]
    assert mesh.face_uv is not None
    assert mesh.face_uv.tolist() == [[0, 1, 0]]
    assert mesh.texture is None
    assert read_obj(path, texture=False).uv is None


def test_a_file_without_texture_coordinates_has_no_seams(tmp_path: Path) -> None:
    path = tmp_path / "plain.obj"
    for faces in ("f 1 2 3", "f 1//1 2//1 3//1"):
        path.write_text(f"v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\n{faces}\n")
        assert read_obj(path, texture=False, seams=True).uv is None


def test_a_textured_file_is_also_plain_geometry(tmp_path: Path) -> None:
    mesh = read(tmp_path, textured(tmp_path, image=False))

    assert mesh.uv is None
    assert mesh.texture is None


@pytest.mark.parametrize(
    "mtl",
    [
        "newmtl a\nKd 1 1 1\nmap_Kd skin.png\nmap_Bump bump.png\n",
        "newmtl a\n\tmap_kd skin.png \r\n",
        "newmtl a\nmap_Kd -clamp off -s 1 1 1 skin.png\n",
        "newmtl a\nmap_Kd skin.png\nnewmtl b\nmap_Kd skin.png\n",
    ],
)
def test_ways_to_name_the_image(tmp_path: Path, mtl: str) -> None:
    assert read(tmp_path, textured(tmp_path, mtl=mtl), texture=True).texture is not None


def test_a_name_with_a_space(tmp_path: Path) -> None:
    text = textured(tmp_path, mtl="newmtl a\nmap_Kd my skin.png\n", image=False)
    (tmp_path / "my skin.png").write_bytes(b"")

    assert read(tmp_path, text, texture=True).texture == tmp_path / "my skin.png"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (V + VT + "f 1 2 3\n", "no texture coordinates .*form v$|no texture coordinates"),
        (V + VT + VN + "f 1//1 2//1 3//1\n", "no texture coordinates"),
        (V + "f 1/1 2/2 3/3\n", "no texture coordinates"),
        (V + VT + "f 1/1 2/2 3/3\n", "cannot be textured .*got none"),
        ("mtllib none.mtl\n" + V + VT + "f 1/1 2/2 3/3\n", "material file .*none.mtl"),
        (V + VT + "f 1/1 2/2 3/9\n", "cannot be textured|texture index out of range"),
    ],
)
def test_what_a_texture_needs(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(DataError, match=message):
        read(tmp_path, text, texture=True)


def test_a_texture_image_that_is_missing_is_named(tmp_path: Path) -> None:
    text = textured(tmp_path, image=False)

    with pytest.raises(DataError, match=r"texture of .*mesh.obj is missing .*skin.png"):
        read(tmp_path, text, texture=True)


def test_two_images_are_one_too_many(tmp_path: Path) -> None:
    text = textured(tmp_path, mtl="newmtl a\nmap_Kd skin.png\nnewmtl b\nmap_Kd hair.png\n")
    text += "usemtl b\nf 1/1 2/2 3/3\n"
    (tmp_path / "hair.png").write_bytes(b"")

    with pytest.raises(DataError, match=r"cannot be textured .*hair.png, skin.png"):
        read(tmp_path, text, texture=True)


def test_a_texture_index_out_of_range(tmp_path: Path) -> None:
    text = textured(tmp_path).replace("4/2", "4/5")

    with pytest.raises(DataError, match="texture index out of range .*0 to 3; got 4"):
        read(tmp_path, text, texture=True)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "has no faces"),
        (V, "has no faces .*4 vertices"),
        ("f 1 2 3\n", "no usable vertices|out of range"),
        (V + "f 1 2 5\n", "vertex index out of range .*0 to 3; got 4"),
        (V + "f 1 2 -5\n", "vertex index out of range .*got -1"),
        (V + "f 0 1 2\n", "face index 0; OBJ counts from 1"),
        (V + "f 1 2\n", "a face that cannot be read"),
        (V + "f 1 2 3\nf 1/1 2/2 3/3\n", "a face that cannot be read"),
        (V + VT + "f 1/1 2/2 3/3\nf 1 2 3\n", "a face that cannot be read"),
        (V + VT + "f 1/1 2 3/3\n", "a face that cannot be read"),
        (V + VN + VT + "f 1//1 2/1 3//1\n", "a face that cannot be read"),
        (V + "f 1 2 three\n", "a face that cannot be read"),
        (V + "f 1 2 3.5\n", "a face that cannot be read"),
        (V + "f 1/ 2/ 3/\n", "a face that cannot be read"),
        (V + "f 1/1/1/1 2/2/2/2 3/3/3/3\n", "a face that cannot be read"),
        (V + "v 1 2\nf 1 2 3\n", "'v' line that is not numbers .*'1 2'"),
        (V + "v 1 2 three\nf 1 2 3\n", "'v' line that is not numbers .*'1 2 three'"),
        ("v 1 2\nv 3 4\nv 5 6\nf 1 2 3\n", "'v' line that is not numbers"),
        (V + "v 1 nan 3\nf 1 2 3\n", "1 non-finite vertices .*vertex 4"),
        (V + "v inf 0 3\nf 1 2 3\n", "1 non-finite vertices"),
        (V + "f 1 1 2\n", "no measurable surface"),
        (V + "f 1 2 3\nf 1 3", "a face that cannot be read"),
        ("v 0 0 0\nv 1 0", "'v' line that is not numbers"),
        ("v ", "'v' line that is not numbers"),
    ],
)
def test_each_defect_has_its_own_error(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(DataError, match=message):
        read(tmp_path, text)


def test_what_is_written_is_read_back_to_a_micrometre(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    (tmp_path / "material0.mtl").write_text("newmtl material0\nmap_Kd skin.png\n")
    (tmp_path / "skin.png").write_bytes(b"")
    mesh = Mesh(
        rng.normal(size=(20, 3)),
        rng.permutation(20)[:18].reshape(6, 3),
        uv=rng.random((9, 2)),
        face_uv=rng.permutation(18).reshape(6, 3) % 9,
    )

    write_obj(tmp_path / "mesh.obj", mesh)
    back = read_obj(tmp_path / "mesh.obj", texture=True)

    np.testing.assert_allclose(back.vertices, mesh.vertices, atol=5.1e-7)
    np.testing.assert_array_equal(back.faces, mesh.faces)
    np.testing.assert_allclose(back.uv, mesh.uv, atol=5.1e-7)
    np.testing.assert_array_equal(back.face_uv, mesh.face_uv)


def test_plain_geometry_is_written_without_a_material(tmp_path: Path) -> None:
    write_obj(tmp_path / "mesh.obj", Mesh(np.eye(3), np.array([[0, 1, 2]])))

    lines = (tmp_path / "mesh.obj").read_text().splitlines()
    assert {line.split()[0] for line in lines} == {"v", "f"}
    assert [file.name for file in tmp_path.iterdir()] == ["mesh.obj"]


@pytest.mark.parametrize("mark", ["\ufeff", "\ufeff# first\n", "\ufeff\n  ", "\ufeff\t"])
def test_a_byte_order_mark_hides_no_vertex(tmp_path: Path, mark: str) -> None:
    mesh = read(tmp_path, mark + V + "f 1 2 3 4\n")

    assert len(mesh.vertices) == 4
    assert mesh.faces.tolist() == SQUARE


@pytest.mark.parametrize("indent", [" ", "\t", "   ", " \t "])
@pytest.mark.parametrize("keyword", ["v", "f", "vt", "usemtl", "mtllib"])
def test_indented_lines_are_read(tmp_path: Path, indent: str, keyword: str) -> None:
    text = textured(tmp_path).replace(f"\n{keyword} ", f"\n{indent}{keyword} ")
    mesh = read(tmp_path, text.removesuffix("\n"), texture=True)

    assert mesh.faces.tolist() == SQUARE
    assert mesh.uv is not None
    assert len(mesh.uv) == 4


@pytest.mark.parametrize("end", ["\r", "\r\r\n", "\n\r"])
def test_every_end_of_a_line(tmp_path: Path, end: str) -> None:
    assert read(tmp_path, (V + "f 1 2 3\nf 1 3 4\n").replace("\n", end)).faces.tolist() == SQUARE


def test_a_defect_of_a_long_line_is_one_short_line(tmp_path: Path) -> None:
    with pytest.raises(DataError) as caught:
        read(tmp_path, V + "f 1 2 " + "x " * 50_000)
    assert len(str(caught.value)) < 400


@pytest.mark.parametrize("record", ["surf 0 1 0 1 1 2 3", "call more.obj", "fo 1 2 3", "F 1 2 3"])
def test_faces_that_would_be_left_out_are_refused(tmp_path: Path, record: str) -> None:
    with pytest.raises(DataError, match=f"'{record.split()[0]}' records, which are not read"):
        read(tmp_path, V + f"f 1 2 3\n{record}\n")


def colours(folder: Path, *ends: str) -> list[list[int]] | None:
    rows = "".join(f"v {k} {k * k} 0 {end}\n" for k, end in enumerate(ends))
    (folder / "mesh.obj").write_text(rows + "f 1 2 3\n")
    found = read_obj_colours(folder / "mesh.obj").vertices
    return None if found is None else found.tolist()


@pytest.mark.parametrize(
    ("ends", "wanted"),
    [
        (("1 0 0", "0.5 0.2 0", "0 0 0"), [[255, 0, 0], [128, 51, 0], [0, 0, 0]]),
        (("255 0 0", "1 51 0", "0 0 0"), [[255, 0, 0], [1, 51, 0], [0, 0, 0]]),
        (("200.0 30.0 30.0", "1 1 1", "0 0 0"), [[200, 30, 30], [1, 1, 1], [0, 0, 0]]),
        (("1 0 0", "1 1 1", "0 0 1"), [[255, 0, 0], [255, 255, 255], [0, 0, 255]]),
        # A weight before, an opacity after.
        (("1 1 0 0", "1 0 0.2 0", "1 0 0 0"), [[255, 0, 0], [0, 51, 0], [0, 0, 0]]),
        (("1 200 0 0", "1 0 2 0", "1 0 0 0"), [[200, 0, 0], [0, 2, 0], [0, 0, 0]]),
        (("1 0 0 1", "0 0.2 0 1", "0 0 0 1"), [[255, 0, 0], [0, 51, 0], [0, 0, 0]]),
        (("200 0 0 255", "9 2 0 255", "0 0 0 255"), [[200, 0, 0], [9, 2, 0], [0, 0, 0]]),
        (("", "", ""), None),
        (("1", "0.5", "1"), None),
    ],
)
def test_colours_of_vertices(tmp_path: Path, ends: tuple[str, ...], wanted) -> None:
    assert colours(tmp_path, *ends) == wanted


@pytest.mark.parametrize(
    "ends",
    [
        ("256 0 0", "0 0 0", "0 0 0"),
        ("65535 0 0", "0 0 0", "0 0 0"),
        ("200.5 0 0", "0 0 0", "0 0 0"),
        ("-1 0 0", "0 0 0", "0 0 0"),
        ("-0.1 0 0", "0 0 0", "0 0 0"),
        ("1 0 0 1", "1 0.2 0 1", "1 0 0 1"),
        ("0.5 0.5", "0 0", "0 0"),
        ("0 0 0 0 0 0", "0 0 0 0 0 0", "0 0 0 0 0 0"),
    ],
)
def test_numbers_that_are_no_colours_are_refused(tmp_path: Path, ends: tuple[str, ...]) -> None:
    with pytest.raises(DataError, match="numbers after x, y, z that are no colours"):
        colours(tmp_path, *ends)

"""Material files: what faces show, by which name, and how a picture is placed."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.core.errors import DataError
from harness.files.mtl import Materials, Picture, materials_of, texture_image


def put(folder: Path, mtl: bytes, obj: bytes = b"mtllib a.mtl\nusemtl skin\n") -> Path:
    (folder / "a.mtl").write_bytes(mtl)
    (folder / "skin.png").write_bytes(b"")
    (folder / "textures").mkdir(exist_ok=True)
    (folder / "textures" / "skin.png").write_bytes(b"")
    (folder / "a.obj").write_bytes(obj)
    return folder / "a.obj"


def picture(path: Path) -> Picture | None:
    material = materials_of(path).of("skin")
    assert material is not None
    return material.picture(path)


@pytest.mark.parametrize(
    ("line", "scale", "offset"),
    [
        ("-o 0 0.5 0 skin.png", (1, 1), (0, 0.5)),
        ("-s 1 2 1 skin.png", (1, 2), (0, 0)),
        ("-s 2 -o .25 skin.png", (2, 1), (0.25, 0)),
        ("skin.png -s 2 3", (2, 3), (0, 0)),
        ("-blendu off -S -1 1e0 1 -texres 512 -O -0.5 1 skin.png", (-1, 1), (-0.5, 1)),
        ("-clamp off -boost 2 skin.png -cc off", (1, 1), (0, 0)),
    ],
)
def test_options_are_applied_wherever_they_stand(tmp_path, line, scale, offset):
    path = put(tmp_path, f"newmtl skin\nmap_Kd {line}\n".encode())
    assert picture(path) == Picture(tmp_path / "skin.png", scale, offset)


@pytest.mark.parametrize(
    "option", ["-t 1 1 1", "-mm 0.2 0.5", "-clamp on", "-imfchan r", "-bm 2", "-type sphere"]
)
@pytest.mark.parametrize("line", ["{} skin.png", "skin.png {}", "-o 0 0 {} skin.png"])
def test_other_options_are_refused_by_name(tmp_path, option, line):
    path = put(tmp_path, f"newmtl skin\nmap_Kd {line.format(option)}\n".encode())
    with pytest.raises(DataError, match=f"changes its picture by '{option.split()[0]}'"):
        picture(path)


@pytest.mark.parametrize(
    "mtl",
    [
        b"\xef\xbb\xbfnewmtl skin\r\nmap_Kd skin.png\r\n",
        b"newmtl skin\rmap_Kd skin.png\r",
        b"\tnewmtl\tskin \n  MAP_KD\tskin.png \n",
        b'newmtl skin\nmap_Kd "skin.png"\n',
        b"newmtl skin\nmap_Kd Skin.PNG\n",
        b"newmtl skin\nmap_Kd .\\skin.png\n",
    ],
)
def test_material_files_of_other_systems_are_read(tmp_path, mtl):
    assert picture(put(tmp_path, mtl)) == Picture(tmp_path / "skin.png")


def test_backslashes_are_folders(tmp_path):
    path = put(tmp_path, b"newmtl skin\nmap_Kd textures\\SKIN.png\n")
    assert picture(path) == Picture(tmp_path / "textures" / "skin.png")


@pytest.mark.parametrize(
    "obj",
    [
        b"\xef\xbb\xbfmtllib a.mtl\nusemtl skin\n",
        b"# mtllib none.mtl\r\n\tmtllib a.mtl\r\n  usemtl  skin \r\n",
        b"v 0 0 0\rmtllib ./a.mtl\rusemtl skin\r",
        b"mtllib other.mtl a.mtl\nusemtl skin\n",
        b"mtllib A.MTL\nusemtl skin\n",
    ],
)
def test_lines_of_an_obj_are_found_however_it_is_written(tmp_path, obj):
    (tmp_path / "other.mtl").write_text("newmtl never\nKd 0 0 1\n")
    assert texture_image(put(tmp_path, b"newmtl skin\nmap_Kd skin.png\n", obj)).is_file()


def test_a_material_file_may_have_a_space_in_its_name(tmp_path):
    path = put(tmp_path, b"", b"mtllib my scan.mtl\nusemtl skin\n")
    (tmp_path / "my scan.mtl").write_text("newmtl skin\nmap_Kd skin.png\n")
    assert texture_image(path) == tmp_path / "skin.png"


@pytest.mark.parametrize("name", ["../out.png", "/etc/hostname", "..\\out.png", "link.png"])
def test_a_picture_elsewhere_is_refused(tmp_path, name):
    (tmp_path / "in").mkdir()
    (tmp_path / "out.png").write_bytes(b"")
    (tmp_path / "in" / "link.png").symlink_to(tmp_path / "out.png")
    path = put(tmp_path / "in", f"newmtl skin\nmap_Kd {name}\n".encode())
    with pytest.raises(DataError, match="outside the folders"):
        picture(path)
    material = materials_of(path).of("skin")
    assert material is not None
    # The folder that the user named holds both.
    if name == "../out.png":
        assert material.picture(path, tmp_path)


@pytest.mark.parametrize(
    ("mtl", "obj", "got"),
    [
        (b"newmtl skin\nmap_Kd skin.png\nnewmtl hat\n", b"usemtl hat", "the plain colour of hat"),
        (b"newmtl skin\nmap_Kd skin.png\n", b"usemtl ghost", "ghost, which is not defined"),
        (b"newmtl skin\nmap_Kd -s 2 2 skin.png\n", b"", "skin.png by -s or -o"),
        (b"newmtl skin\nKd 1 0 0\n", b"", "the plain colour of skin"),
        (b"", b"", "skin, which is not defined"),
    ],
)  # fmt: skip
def test_what_is_not_one_picture_all_over_names_what_to_do(tmp_path, mtl, obj, got):
    path = put(tmp_path, mtl, b"mtllib a.mtl\nusemtl skin\n" + obj + b"\n")
    with pytest.raises(DataError, match=f"cannot be textured as it is.*{got}.*harness data add"):
        texture_image(path)


def test_materials_that_no_face_uses_do_not_matter(tmp_path):
    mtl = b"newmtl skin\nmap_Kd skin.png\nnewmtl never\nmap_Kd -t 1 1 1 never.png\n"
    assert texture_image(put(tmp_path, mtl)) == tmp_path / "skin.png"


@pytest.mark.parametrize("names", [b"", b"usemtl ghost\n"])
def test_the_only_material_is_taken_where_no_other_is_named(tmp_path, names):
    path = put(tmp_path, b"newmtl skin\nmap_Kd skin.png\n", b"mtllib a.mtl\n" + names)
    found: Materials = materials_of(path)
    assert texture_image(path) == tmp_path / "skin.png"
    assert found.undefined == (("ghost",) if names else ())


@pytest.mark.parametrize(
    ("text", "colour"),
    [("0.05 0.1 0.7", (0.05, 0.1, 0.7)), ("0.5", (0.5, 0.5, 0.5)), ("204 100 50", None),
     ("0.5 -1 0", None), ("nan 0 0", None),
     ("spectral file.rfl", None), ("", None)],
)  # fmt: skip
def test_plain_colours(tmp_path, text, colour):
    material = materials_of(put(tmp_path, f"newmtl skin\nKd {text}\n".encode())).of("skin")
    assert material is not None
    assert material.colour == colour

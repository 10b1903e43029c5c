"""Colours of users' scans: what a photo of the converted scan shows is what the file says."""

from __future__ import annotations

import json
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from harness.core.errors import DataError
from harness.core.mesh import Mesh
from harness.data.converted_scans import (
    UPS,
    Conversion,
    convert_scan,
    is_converted,
    read_painted,
)
from harness.data.texture_atlas import Paint, joined, paint_of_corners
from harness.files.mesh_files import load_mesh
from harness.geometry.images import linear_from_srgb, load_rgb
from tests.box_person import (
    box_person,
    corner_colours,
    front_camera,
    photo,
    photo_of_corners,
    put_glb,
    put_obj,
    put_ply,
    ramp,
)  # fmt: skip

PERSON = box_person()
CAMERA = front_camera(PERSON)


def converted(source: Path, folder: Path, conversion: Conversion | None = None):
    """The mesh and the picture that are written for a scan."""
    convert_scan(source, conversion or Conversion("+y"), folder)
    mesh = load_mesh(folder / f"{folder.name}.obj", texture=True)
    assert mesh.texture is not None
    return mesh, load_rgb(mesh.texture)


def difference(one, other) -> float:
    """The largest difference of two photos in linear light, but at the outline."""
    inside = one.any(axis=2) & other.any(axis=2)
    assert inside.sum() > 500
    assert (one.any(axis=2) != other.any(axis=2)).sum() < 20
    # Along edges, rays may meet either of two faces.
    return float(np.quantile(np.abs(one - other)[inside].max(axis=1), 0.99))


@pytest.mark.parametrize(("suffix", "put"), [(".ply", put_ply), (".glb", put_glb)])
def test_vertex_colours_are_those_of_the_source(tmp_path, suffix, put):
    put(tmp_path / f"p{suffix}", PERSON)
    mesh, pixels = converted(tmp_path / f"p{suffix}", tmp_path / "p1")
    wanted = photo_of_corners(PERSON, corner_colours(PERSON), CAMERA)
    assert difference(photo(mesh, pixels, CAMERA), wanted) < 0.012
    # The texels of a face do not split its vertices.
    assert len(mesh.vertices) == len(PERSON.vertices)


def test_the_texture_of_a_glb_is_that_of_the_source(tmp_path):
    material = PBRMaterial(baseColorTexture=Image.fromarray(ramp()))
    visual = TextureVisuals(uv=PERSON.uv, material=material)
    trimesh.Trimesh(PERSON.vertices, PERSON.faces, visual=visual, process=False).export(
        tmp_path / "p.glb"
    )
    mesh, pixels = converted(tmp_path / "p.glb", tmp_path / "p1")
    np.testing.assert_array_equal(pixels, ramp())
    assert difference(photo(mesh, pixels, CAMERA), photo(PERSON, ramp(), CAMERA)) < 1e-3


def test_an_obj_with_one_material_is_read_as_it_is(tmp_path):
    put_obj(tmp_path / "in" / "scan.obj", PERSON, "skin.png")
    mesh, pixels = converted(tmp_path / "in" / "scan.obj", tmp_path / "p1")
    np.testing.assert_array_equal(mesh.faces, PERSON.faces)
    assert difference(photo(mesh, pixels, CAMERA), photo(PERSON, ramp(), CAMERA)) < 1e-3


def two_materials(folder: Path) -> Path:
    """The person with its upper boxes red to the right, its legs in another picture."""
    put_obj(folder / "scan.obj", PERSON, "upper.png")
    Image.fromarray(ramp(20)[::-1].copy()).save(folder / "lower.png")
    text = "newmtl upper\nmap_Kd upper.png\nnewmtl lower\nKd 1 1 1\nmap_Kd lower.png\n"
    (folder / "material0.mtl").write_text(text)
    lines = (folder / "scan.obj").read_text().replace("usemtl material0", "usemtl upper")
    rows = lines.splitlines()
    first = next(k for k, row in enumerate(rows) if row.startswith("f "))
    legs = first + 4 * len(PERSON.faces) // 6
    text = "\n".join([*rows[:legs], "usemtl lower", *rows[legs:]])
    (folder / "scan.obj").write_text(text + "\n")
    return folder / "scan.obj"


def test_several_materials_become_one_picture(tmp_path):
    mesh, pixels = converted(two_materials(tmp_path / "in"), tmp_path / "p1")
    seen = photo(mesh, pixels, CAMERA)
    upper, lower = (photo(PERSON, picture, CAMERA) for picture in (ramp(), ramp(20)[::-1]))
    nearest = np.minimum(np.abs(seen - upper).max(axis=2), np.abs(seen - lower).max(axis=2))
    inside = seen.any(axis=2) & upper.any(axis=2)
    assert np.quantile(nearest[inside], 0.99) < 5e-3
    # Each has its own: the two pictures differ where the two are seen.
    is_upper = np.abs(seen - upper).max(axis=2) < 5e-3
    rows = np.nonzero(inside & is_upper & (np.abs(upper - lower).max(axis=2) > 0.05))[0]
    others = np.nonzero(inside & ~is_upper)[0]
    assert len(rows) > 100
    assert len(others) > 100
    assert np.median(rows) < np.median(others)


def test_face_colours_are_kept(tmp_path):
    colours = np.random.default_rng(1).integers(0, 256, (len(PERSON.faces), 4)).astype(np.uint8)
    scan = trimesh.Trimesh(PERSON.vertices, PERSON.faces, face_colors=colours, process=False)
    scan.export(tmp_path / "p.ply")
    painted = read_painted(tmp_path / "p.ply")
    assert painted.colours == "face colours"
    np.testing.assert_array_equal(painted.pixels[:2, :2], np.tile(colours[0, :3], (2, 2, 1)))


@pytest.mark.parametrize("up", UPS)
def test_each_axis_is_turned_up_without_a_mirror(tmp_path, up):
    turned = Mesh(PERSON.vertices @ UPS[up], PERSON.faces)
    assert np.linalg.det(UPS[up]) == pytest.approx(1.0)
    assert np.abs(UPS[up] @ ("xyz".index(up[1]) == np.arange(3)))[1] == 1.0
    axis, sign = "xyz".index(up[1]), 1.0 if up[0] == "+" else -1.0
    # The head is far along that axis.
    assert sign * turned.vertices[:8, axis].mean() > 0.8 * 1.7
    put_ply(tmp_path / "p.ply", turned)
    mesh, _ = converted(tmp_path / "p.ply", tmp_path / "p1", Conversion(up))
    np.testing.assert_allclose(mesh.bounds, PERSON.bounds, atol=1e-5)
    assert mesh.signed_volume == pytest.approx(PERSON.signed_volume, rel=1e-4)


def test_blenders_front_becomes_ours(tmp_path):
    # Whoever faces -Y with +Z up faces +Z with +Y up.
    np.testing.assert_array_equal(UPS["+z"] @ (0.0, -1.0, 0.0), (0.0, 0.0, 1.0))


def test_units_and_height_are_applied(tmp_path):
    put_ply(tmp_path / "p.ply", box_person(1700.0))
    mesh, _ = converted(tmp_path / "p.ply", tmp_path / "p1", Conversion("+y", factor=0.001))
    assert mesh.extent[1] == pytest.approx(1.7, abs=1e-5)
    mesh, _ = converted(tmp_path / "p.ply", tmp_path / "p1", Conversion("+y", height_m=1.6))
    assert mesh.extent[1] == pytest.approx(1.6, abs=1e-5)


def test_a_scan_is_converted_again_when_it_or_the_rules_change(tmp_path):
    source, folder = tmp_path / "in" / "scan.obj", tmp_path / "p1"
    put_obj(source, PERSON)
    assert not is_converted(source, Conversion("+y"), folder)
    convert_scan(source, Conversion("+y"), folder)
    assert is_converted(source, Conversion("+y"), folder)
    assert not is_converted(source, Conversion("+z"), folder)
    Image.fromarray(ramp()[::-1].copy()).save(source.with_name("material0.png"))
    assert not is_converted(source, Conversion("+y"), folder)
    (folder / "added.json").unlink()
    with pytest.raises(DataError, match="was not made by 'harness data add'"):
        is_converted(source, Conversion("+y"), folder)


@pytest.mark.parametrize(
    ("colour", "wanted"),
    [
        ("0.784314 0.117647 0.117647", (200, 30, 30)),
        ("200 30 30", (200, 30, 30)),
        ("1 0 0", (255, 0, 0)),
    ],
)
def test_vertex_colours_of_an_obj_are_of_either_range(tmp_path, colour, wanted):
    text = plain_obj(tmp_path / "p.obj").read_text()
    rows = [f"{row} {colour}" if row.startswith("v ") else row for row in text.splitlines()]
    (tmp_path / "p.obj").write_text("\n".join(rows))
    painted = read_painted(tmp_path / "p.obj")
    assert painted.colours == "vertex colours"
    assert painted.pixels[:2, :2].tolist() == np.full((2, 2, 3), wanted).tolist()
    (tmp_path / "p.obj").write_text("\n".join(rows).replace(colour, "300 0 0"))
    with pytest.raises(DataError, match="no colours .*expected red, green and blue"):
        read_painted(tmp_path / "p.obj")


def plain_obj(path: Path, materials: str = "") -> Path:
    """A person without picture."""
    names = "mtllib plain.mtl\nusemtl one\n" if materials else ""
    rows = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in PERSON.vertices]
    rows += [f"f {a} {b} {c}" for a, b, c in PERSON.faces + 1]
    path.write_text(names + "\n".join(rows) + "\n")
    (path.parent / "plain.mtl").write_text(materials)
    return path


@pytest.mark.parametrize("materials", ["", "newmtl one\nKd 0.8 0.8 0.8\n"])
def test_a_scan_without_colours_is_refused_unless_grey_is_wanted(tmp_path, materials):
    path = plain_obj(tmp_path / "p.obj", materials)
    with pytest.raises(DataError, match="no colours.*--grey"):
        read_painted(path)
    grey = read_painted(path, grey=True)
    assert (grey.pixels == grey.pixels[0, 0, 0]).all()
    assert grey.mesh.face_uv is not None


def test_a_picture_that_is_missing_or_damaged_is_named(tmp_path):
    path = two_materials(tmp_path)
    picture = tmp_path / "lower.png"
    whole = picture.read_bytes()
    picture.write_bytes(b"no picture")
    with pytest.raises(DataError, match="lower.png is not a complete image"):
        read_painted(path)
    picture.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(DataError):
        read_painted(path)
    picture.unlink()
    with pytest.raises(DataError, match="missing.*lower.png"):
        read_painted(path)
    picture.write_bytes(whole)
    materials = tmp_path / "material0.mtl"
    materials.write_text(materials.read_text().replace("Kd lower", "Kd -t 2 2 1 lower"))
    with pytest.raises(DataError, match="by '-t'.*map_Kd -t 2 2 1 lower.png"):
        read_painted(path)
    (tmp_path / "material0.mtl").unlink()
    with pytest.raises(DataError, match="names a material file that is not there"):
        read_painted(path)


def test_damaged_meshes_are_refused(tmp_path):
    for put, name in ((put_ply, "p.ply"), (put_glb, "p.glb")):
        put(tmp_path / name, PERSON)
        content = (tmp_path / name).read_bytes()
        (tmp_path / name).write_bytes(content[: len(content) * 2 // 3])
        with pytest.raises(DataError):
            read_painted(tmp_path / name)


def put_ascii_ply(path: Path, head: str, ends: list[str], faces: list[str]) -> Path:
    """The person with more properties: of vertices in ``head``, and what follows in ``faces``."""
    rows = [f"{x} {y} {z} {end}" for (x, y, z), end in zip(PERSON.vertices, ends, strict=True)]
    rows += [f"3 {a} {b} {c} {end}" for (a, b, c), end in zip(PERSON.faces, faces, strict=True)]
    of_vertices, _, of_faces = head.partition("|")
    path.write_text(
        f"ply\nformat ascii 1.0\nelement vertex {len(ends)}\nproperty float x\n"
        f"property float y\nproperty float z\n{of_vertices}element face {len(faces)}\n"
        f"property list uchar int vertex_indices\n{of_faces}end_header\n" + "\n".join(rows) + "\n"
    )
    return path


@pytest.mark.parametrize(
    ("kind", "end", "wanted"),
    [
        ("ushort", "65535 0 9000", (255, 0, 35)),
        ("uint8", "255 0 35", (255, 0, 35)),
        ("double", "1 0 0.1373", (255, 0, 35)),
        ("float", "1.5 0 0", None),
        ("int", "255 0 35", None),
        ("uchar", "256 0 35", None),
    ],
)
def test_colours_in_a_ply_are_read_by_their_type(tmp_path, kind, end, wanted):
    head = "".join(f"property {kind} {name}\n" for name in ("red", "green", "blue"))
    path = put_ascii_ply(tmp_path / "p.ply", head, [end] * len(PERSON.vertices),
                         [""] * len(PERSON.faces))  # fmt: skip
    if wanted is None:
        with pytest.raises(DataError, match="colours of another type"):
            read_painted(path)
    else:
        painted = read_painted(path)
        assert set(map(tuple, painted.pixels[:2, :2].reshape(-1, 3).tolist())) == {wanted}


def of_faces(painted) -> np.ndarray:
    """(F, 3) colour at the middle of each face."""
    rows, columns = painted.pixels.shape[:2]
    u, v = np.moveaxis(painted.mesh.uv[painted.mesh.face_uv].mean(axis=1) % 1.0, 1, 0)
    return painted.pixels[((1 - v) * rows).astype(int), (u * columns).astype(int)]


HEAD = np.arange(len(PERSON.faces)) < len(PERSON.faces) // 6
RED, BLUE = (200, 30, 30), (40, 60, 210)


def put_plain(path: Path, colour) -> None:
    Image.new("RGB", (4, 4), colour).save(path)


@pytest.mark.parametrize("number", ["texnumber", "vertex"])
@pytest.mark.parametrize("order", [(RED, BLUE), (BLUE, RED)])
def test_a_ply_shows_all_of_its_pictures(tmp_path, number, order):
    for name, colour in zip("ab", order, strict=True):
        put_plain(tmp_path / f"{name}.png", colour)
    head = "property float s\nproperty float t\n|property int texnumber\n"
    corners = ["0.5 0.5"] * len(PERSON.vertices)
    ends = [str(int(each)) for each in HEAD]
    if number == "texnumber":
        head = "|property list uchar float texcoord\nproperty int texnumber\n"
        corners, ends = [""] * len(corners), [f"6 .5 .5 .4 .5 .5 .6 {end}" for end in ends]
    path = put_ascii_ply(tmp_path / "p.ply", head, corners, ends)
    path.write_text(path.read_text().replace(
        "1.0\n", "1.0\ncomment TextureFile a.png\ncomment TextureFile B.PNG\n", 1))  # fmt: skip
    painted = read_painted(path)
    np.testing.assert_array_equal(of_faces(painted), np.where(HEAD[:, None], order[1], order[0]))
    assert painted.told == ()
    # A number without a picture, and pictures without numbers, are told.
    path.write_text(path.read_text().replace("comment TextureFile B.PNG\n", ""))
    painted = read_painted(path)
    np.testing.assert_array_equal(of_faces(painted), np.where(HEAD[:, None], 160, order[0]))
    assert painted.told == ("some faces show none of its 1 pictures", "faces of no colour are grey")


def test_pictures_of_a_ply_without_numbers_are_told(tmp_path):
    put_plain(tmp_path / "a.png", RED)
    ends = ["0.5 0.5"] * len(PERSON.vertices)
    path = put_ascii_ply(tmp_path / "p.ply", "property float u\nproperty float v\n", ends,
                         [""] * len(PERSON.faces))  # fmt: skip
    lines = "1.0\ncomment TextureFile a.png\ncomment TextureFile b.png\n"
    path.write_text(path.read_text().replace("1.0\n", lines, 1))
    painted = read_painted(path)
    assert set(map(tuple, of_faces(painted).tolist())) == {RED}
    assert painted.told == (
        "all faces show the first of its 2 pictures: no 'texnumber' names others",
    )


def put_materials(folder: Path, mtl: str, *names: str) -> Path:
    """The person of red and blue pictures; its head and its rest are of the materials named."""
    put_obj(folder / "scan.obj", PERSON)
    for name, colour in (("red.png", RED), ("blue.png", BLUE)):
        put_plain(folder / name, colour)
    (folder / "material0.mtl").write_text(mtl)
    rows = (folder / "scan.obj").read_text().replace("usemtl material0\n", "").splitlines()
    first = next(k for k, row in enumerate(rows) if row.startswith("f "))
    last = first + int(HEAD.sum())
    head, rest = [f"usemtl {name}" if name else "" for name in names]
    lines = [*rows[:first], head, *rows[first:last], rest, *rows[last:]]
    (folder / "scan.obj").write_text("\n".join(lines) + "\n")
    return folder / "scan.obj"


@pytest.mark.parametrize(
    ("mtl", "names", "head", "rest", "told"),
    [
        ("newmtl a\nmap_Kd red.png\nnewmtl b\nKd 0 0 1\n", "ab", RED, (0, 0, 255), ()),
        ("newmtl a\nKd 1 0 0\nnewmtl b\nKd 0 0 1\n", "ba", (0, 0, 255), (255, 0, 0), ()),
        ("newmtl a\nmap_Kd red.png\nnewmtl b\nmap_Kd blue.png\n", "ba", BLUE, RED, ()),
        ("newmtl a\nmap_Kd red.png\n", ("a", "ghost"), RED, (160, 160, 160),
         ("no material file defines 'ghost'", "faces of no colour are grey")),
        ("newmtl a\nmap_Kd red.png\nnewmtl b\nmap_Kd blue.png\n", ("", "b"), (160, 160, 160), BLUE,
         ("no material file defines faces before any usemtl", "faces of no colour are grey")),
        ("newmtl a\nmap_Kd red.png\n", ("ghost", "other"), RED, RED,
         ("no material file defines 'ghost', 'other'",)),
        ("newmtl a\nmap_Kd red.png\n", ("", ""), RED, RED, ()),
    ],
)  # fmt: skip
def test_each_face_shows_its_material(tmp_path, mtl, names, head, rest, told):
    painted = read_painted(put_materials(tmp_path, mtl, *names))
    np.testing.assert_array_equal(of_faces(painted), np.where(HEAD[:, None], head, rest))
    assert painted.told == told


def test_names_in_an_older_encoding_stay_two(tmp_path):
    path = put_materials(tmp_path, "", "\xe9", "\xe8")
    path.write_bytes(path.read_text("utf-8").encode("latin-1"))
    (tmp_path / "material0.mtl").write_bytes(b"newmtl \xe9\nKd 1 0 0\nnewmtl \xe8\nKd 0 0 1\n")
    shown = of_faces(read_painted(path))
    np.testing.assert_array_equal(shown, np.where(HEAD[:, None], (255, 0, 0), (0, 0, 255)))


def test_one_name_for_two_materials_is_refused(tmp_path):
    path = put_materials(tmp_path, "newmtl a\nmap_Kd red.png\nnewmtl a\nKd 0 0 1\n", "a", "a")
    with pytest.raises(DataError, match="'a' of .* is defined twice, and differently"):
        read_painted(path)
    path = put_materials(tmp_path, 2 * "newmtl a\nKd 1 0 0\n" + "newmtl b\nKd 0 0 1\n", "a", "b")
    assert of_faces(read_painted(path))[HEAD].tolist() == [[255, 0, 0]] * int(HEAD.sum())


@pytest.mark.parametrize(
    ("options", "scale", "offset"),
    [
        ("-o 0 0.5 0", (1, 1), (0, 0.5)),
        ("-s 1 2 1", (1, 2), (0, 0)),
        ("-s 2 1 -o .25 .1", (2, 1), (0.25, 0.1)),
    ],
)
def test_options_move_the_picture(tmp_path, options, scale, offset):
    path = put_materials(tmp_path, f"newmtl a\nmap_Kd {options} red.png\n", "a", "a")
    Image.fromarray(ramp()).save(tmp_path / "red.png")
    mesh, pixels = converted(path, tmp_path / "p1")
    moved = replace(PERSON, uv=PERSON.uv * scale + offset)
    assert difference(photo(mesh, pixels, CAMERA), photo(moved, ramp(), CAMERA)) < 1e-3


@pytest.mark.parametrize(
    "materials", ["newmtl one\nmap_Kd skin.png\n", "newmtl one\nKd .5 .5 .5\n"]
)
def test_grey_needs_no_coordinates(tmp_path, materials):
    put_plain(tmp_path / "skin.png", RED)
    path = plain_obj(tmp_path / "p.obj", materials)
    told = read_painted(path, grey=True).told
    assert told == (
        ("it names a picture, but has no texture coordinates",) if "map" in materials else ()
    )
    with pytest.raises(DataError, match="no colours.*--grey"):
        read_painted(path)


def test_vertex_colours_of_an_obj_may_be_bytes(tmp_path):
    colours = corner_colours(PERSON)
    for name, scale in (("byte", 1.0), ("unit", 255.0)):
        rows = [f"v {x} {y} {z} {r / scale} {g / scale} {b / scale}" for (x, y, z), (r, g, b)
                in zip(PERSON.vertices, colours.tolist(), strict=True)]  # fmt: skip
        rows += [f"f {a} {b} {c}" for a, b, c in PERSON.faces + 1]
        (tmp_path / f"{name}.obj").write_text("\n".join(rows) + "\n")
        mesh, pixels = converted(tmp_path / f"{name}.obj", tmp_path / name)
        wanted = photo_of_corners(PERSON, colours, CAMERA)
        assert difference(photo(mesh, pixels, CAMERA), wanted) < 0.012


def test_files_in_the_folder_that_was_named_may_be_elsewhere(tmp_path):
    path = put_materials(tmp_path / "in", "newmtl a\nmap_Kd ../textures/red.png\n", "a", "a")
    (tmp_path / "textures").mkdir()
    put_plain(tmp_path / "textures" / "red.png", RED)
    with pytest.raises(DataError, match="outside the folders"):
        read_painted(path)
    assert (of_faces(read_painted(path, tmp_path)) == RED).all()
    convert_scan(path, Conversion("+y", folder=tmp_path), tmp_path / "p1")
    put_plain(tmp_path / "textures" / "red.png", BLUE)
    assert not is_converted(path, Conversion("+y", folder=tmp_path), tmp_path / "p1")


def test_a_texture_that_the_file_moves_is_refused(tmp_path):
    material = PBRMaterial(baseColorTexture=Image.fromarray(ramp()))
    visual = TextureVisuals(uv=PERSON.uv, material=material)
    scan = trimesh.Trimesh(PERSON.vertices, PERSON.faces, visual=visual, process=False)
    content = scan.export(file_type="glb")
    size = struct.unpack_from("<I", content, 12)[0]
    document = json.loads(content[20 : 20 + size])
    texture = document["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]
    texture["extensions"] = {"KHR_texture_transform": {"scale": [2, 2]}}
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    rest = content[20 + size :]
    head = struct.pack("<4sIIII", b"glTF", 2, 20 + len(text) + len(rest), len(text), 0x4E4F534A)
    (tmp_path / "p.glb").write_bytes(head + text + rest)
    with pytest.raises(DataError, match="KHR_texture_transform"):
        read_painted(tmp_path / "p.glb")


def test_a_damaged_picture_in_a_glb_is_refused(tmp_path):
    material = PBRMaterial(baseColorTexture=Image.fromarray(ramp()))
    visual = TextureVisuals(uv=PERSON.uv, material=material)
    scan = trimesh.Trimesh(PERSON.vertices, PERSON.faces, visual=visual, process=False)
    content = scan.export(file_type="glb")
    (tmp_path / "p.glb").write_bytes(content.replace(b"IHDR", b"IDHR"))
    with pytest.raises(DataError, match="texture of .* cannot be read.*PNG or JPEG"):
        read_painted(tmp_path / "p.glb")


def test_the_fourth_texel_continues_the_others_where_that_is_a_colour():
    greys = np.array([[10, 128, 250], [250, 10, 128], [128, 250, 10]], np.uint8)
    paint = paint_of_corners(np.repeat(greys[..., None], 3, axis=2))
    # The first texel is the corner between the two others.
    assert set(paint.pixels[0::2, 0::2, 0].ravel()[:3].tolist()) == {128}
    fourth = linear_from_srgb(paint.pixels[1::2, 1::2, 0].ravel()[:3] / 255.0)
    wanted = linear_from_srgb(np.array([10, 250]) / 255.0).sum() - linear_from_srgb(128 / 255.0)
    np.testing.assert_allclose(fourth, wanted, atol=0.01)


def test_corners_lie_at_texel_centres():
    colours = np.random.default_rng(2).integers(0, 256, (7, 3, 3)).astype(np.uint8)
    paint = paint_of_corners(colours)
    rows, columns = paint.pixels.shape[:2]
    place = paint.uv[paint.face_uv] * (columns, rows) - 0.5
    np.testing.assert_allclose(place, np.round(place), atol=1e-9)
    x, y = np.moveaxis(np.round(place).astype(int), -1, 0)
    np.testing.assert_array_equal(paint.pixels[rows - 1 - y, x], colours)


def test_a_picture_that_is_repeated_across_a_face_cannot_be_joined():
    faces = np.array([[0, 1, 2]])
    uv = np.array([[0.0, 0.0], [2.5, 0.0], [0.0, 1.0]])
    once = Paint(ramp(), uv / 2.5 + 3.0, faces)
    assert joined([once, once], "scan").uv.max() <= 1.0
    with pytest.raises(DataError, match="repeats"):
        joined([once, Paint(ramp(), uv, faces)], "scan")


def test_a_polygon_with_a_notch_has_its_area_when_it_is_added(tmp_path):
    outline = [(0, 0), (3, 0), (3, 3), (2, 3), (2, 1), (1, 1), (1, 3), (0, 3)]
    rows = [f"{x} {y} 0" for x, y in outline]
    numbers = " ".join(map(str, range(1, 9)))
    obj = "".join(f"v {row} {k * 20} 0 0\n" for k, row in enumerate(rows)) + f"f {numbers}\n"
    kinds = "".join(f"property float {axis}\n" for axis in "xyz")
    kinds += "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
    ply = f"ply\nformat ascii 1.0\nelement vertex 8\n{kinds}element face 1\n"
    ply += "property list uchar int vertex_indices\nend_header\n"
    ply += "".join(f"{row} {k * 20} 0 0\n" for k, row in enumerate(rows)) + "8 0 1 2 3 4 5 6 7\n"
    for name, text in (("p.obj", obj), ("p.ply", ply)):
        (tmp_path / name).write_text(text)
        assert load_mesh(tmp_path / name).area == pytest.approx(7)
        assert read_painted(tmp_path / name).mesh.area == pytest.approx(7)

"""The fast OBJ reader against a slow, readable twin, and its answer to every defect."""

import numpy as np
import pytest

from harness.core.errors import DataError
from harness.files.obj import read_obj

CORNERS = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


def slow_read(text):
    """The same, one line at a time."""
    vertices, uv, faces, face_uv = [], [], [], []
    for line in text.replace("\\\n", " ").splitlines():
        keyword, _, rest = line.replace("\t", " ").partition(" ")
        if keyword == "v":
            vertices.append([float(word) for word in rest.split()[:3]])
        elif keyword == "vt":
            uv.append([float(word) for word in rest.split()[:2]])
        elif keyword == "f":
            corners = [word.split("/") for word in rest.split()]
            for i in range(1, len(corners) - 1):
                fan = [corners[0], corners[i], corners[i + 1]]
                faces.append([_zero_based(corner[0], vertices) for corner in fan])
                if len(corners[0]) > 1 and corners[0][1]:
                    face_uv.append([_zero_based(corner[1], uv) for corner in fan])
    return vertices, faces, uv, face_uv


def _zero_based(word, available):
    return int(word) - 1 if int(word) > 0 else len(available) + int(word)


GOOD = {
    "triangles": CORNERS + "f 1 2 3\nf 1 3 4\n",
    "quad": CORNERS + "f 1 2 3 4\n",
    "a fan beside a triangle": CORNERS + "f 1 2 3\nf 1 2 3 4\n",
    "counted from the end": CORNERS + "f -4 -3 -2\n",
    "no newline at the end": CORNERS + "f 1 2 3",
    "windows": (CORNERS + "\nvn 0 0 1\nf 1//1 2//1 3//1\n").replace("\n", "\r\n"),
    "continued line": CORNERS + "f 1 2 \\\n 3\n",
    "comments and tabs": "# v 9 9 9\n\n" + CORNERS.replace("v ", "v\t ") + "o body\nf 1\t2 3 \n",
    "exponents": "v 1e-3 -2.5E+1 .5\nv 1 0 0\nv 1 1 0\nf 1 2 3\n",
    "vertex colours": "v 0 0 0 .1 .2 .3\nv 1 0 0 .1 .2 .3\nv 1 1 0 .1 .2 .3\nf 1 2 3\n",
    "normals": CORNERS + "vn 0 0 1\nf 1//1 2//1 3//1\n",
    "interleaved": "v 0 0 0\nvt 0 0\nv 1 0 0\nvt 1 0\nv 1 1 0\nvt 1 1\nf 1/1 2/2 3/3\n"
    "v 0 0 5\nf 1/3 2/2 4/1\n",
}


@pytest.mark.parametrize("name", GOOD)
def test_it_reads_what_the_slow_twin_reads(name, tmp_path):
    path = tmp_path / "mesh.obj"
    path.write_bytes(GOOD[name].encode())
    mesh = read_obj(path, texture=False)
    vertices, faces, _, _ = slow_read(GOOD[name])
    np.testing.assert_array_equal(mesh.vertices, vertices)
    np.testing.assert_array_equal(mesh.faces, faces)


@pytest.mark.parametrize("corner", ["{0}/{1}", "{0}/{1}/1"])
def test_texture_indices_stay_apart_from_vertex_indices(corner, tmp_path):
    random = np.random.default_rng(0)
    vertices, uv = random.normal(size=(20, 3)), random.random((30, 2))
    pairs = np.stack([random.integers(1, 21, (50, 3)), random.integers(1, 31, (50, 3))], axis=-1)
    lines = ["mtllib m.mtl", *(f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist())]
    lines += [f"vt {u!r} {v!r}" for u, v in uv.tolist()] + ["vn 0 0 1"]
    lines += ["f " + " ".join(corner.format(*pair) for pair in face) for face in pairs.tolist()]
    text = "\n".join(lines)
    (tmp_path / "mesh.obj").write_text(text)
    (tmp_path / "m.mtl").write_text("newmtl m\nmap_Kd skin.png\n")
    (tmp_path / "skin.png").write_bytes(b"not looked at")
    mesh = read_obj(tmp_path / "mesh.obj", texture=True)
    _, faces, slow_uv, face_uv = slow_read(text)
    np.testing.assert_array_equal(mesh.vertices, vertices)
    np.testing.assert_array_equal(mesh.faces, faces)
    np.testing.assert_array_equal(mesh.uv, slow_uv)
    np.testing.assert_array_equal(mesh.face_uv, face_uv)
    assert mesh.texture == tmp_path / "skin.png"


DECIMALS = [
    *(
        "0.1",
        "-0.000001",
        "123456789.987654",
        "-.5",
        "5.",
        "0.30000000000000004",
        "1.7976931348623",
    ),
    *("99999999999999.9", "9007199254740993.0", "123456789012345678901234567890.5", "00012.50"),
]


@pytest.mark.parametrize("decimal", DECIMALS)
def test_decimals_are_rounded_as_python_rounds_them(decimal, tmp_path):
    path = tmp_path / "mesh.obj"
    path.write_text(f"v {decimal} 0.0 0.0\nv 0.0 1.0 0.0\nv 0.0 0.0 1.0\nf 1 2 3\n")
    assert read_obj(path, texture=False).vertices[0, 0] == float(decimal)


@pytest.mark.parametrize("digits", [3, 6, 9, 17])
def test_random_decimals_are_read_to_the_last_bit(digits, tmp_path):
    vertices = np.random.default_rng(digits).normal(size=(300, 3)) * [[1e-3, 1, 1e3]]
    lines = [" ".join(["v", *(f"{x:.{digits}f}" for x in vertex)]) for vertex in vertices]
    path = tmp_path / "mesh.obj"
    path.write_text("\n".join([*lines, "f 1 2 3"]))
    expected = [[float(word) for word in line.split()[1:]] for line in lines]
    np.testing.assert_array_equal(read_obj(path, texture=False).vertices, expected)


BAD = {
    "v 0 0 0\nv 1 x 0\nv 1 1 0\nf 1 2 3\n": r"'v' line that is not numbers .* got '1 x 0'",
    "v 0 0\nv 1 0 0 0\nv 1 1 0\nf 1 2 3\n": "'v' line that is not numbers",
    "v 1.5-2 . 0.1\nv 1.0 0.0 0.0\nv 1.0 1.0 0.0\nf 1 2 3\n": "got '1.5-2 . 0.1'",
    "v 1.5.2 0 0.1\nv 1.0 0.0 0.0\nv 1.0 1.0 0.0\nf 1 2 3\n": "got '1.5.2 0 0.1'",
    "v 0 0 0\nv 1 0\nv 1 1 0\nf 1 2 3\n": r"'v' line that is not numbers .* got '1 0'",
    "v 0 0 0\nv 1 nan 0\nv 1 1 0\nf 1 2 3\n": "1 non-finite vertices",
    CORNERS + "f 1 2\n": r"face that cannot be read .* got '1 2'",
    CORNERS + "f \n": "face that cannot be read",
    CORNERS + "f 1 2 3\nf 1.5 2 3\n": r"face that cannot be read .* got '1.5 2 3'",
    CORNERS + "f 1 2 3\nf 1/1 2/2 3/3\n": r"face that cannot be read .* got '1/1 2/2 3/3'",
    # As many slashes and numbers as three corners of the form v/vt, and yet none of them is one.
    CORNERS + "f 1/1 2/2 3/3\nf 1/2/3 4 5/6\n": r"face that cannot be read .* '1/2/3 4 5/6'",
    CORNERS + "f 0 1 2\n": "face index 0",
    CORNERS + "f 9 1 2\n": "out of range",
    CORNERS: "no faces",
    "f 1 2 3\n": "no usable vertices",
    "": "no faces",
    "\x00\x01\xff\n\n": "no record of the format",
    # Blanks of other kinds, a line without its keyword, and one that another mark hides.
    CORNERS + "f 1 2 3\nf\x0b1 2 3\n": r"no record of the format .got 'f.x0b1 2 3'",
    CORNERS + "f 1 2 3\nf\u00a01 2 3\n": "no record of the format",
    CORNERS + "\x0cf 1 2 3\nf 1 2 3\n": "no record of the format",
    CORNERS + "f 1 2 3\n1 2 3\n": r"no record of the format .got '1 2 3'",
    CORNERS + "f 1 2 3\nf\n1 2 3\n": r"no record of the format .got 'f'",
    CORNERS + "f 1 2 3\n\xef\xbb\xbfv 0 0 0\nf 1 2 3\n": "no record of the format",
}


@pytest.mark.parametrize("text", BAD, ids=range(len(BAD)))
def test_every_defect_has_its_own_refusal(text, tmp_path):
    path = tmp_path / "mesh.obj"
    path.write_bytes(text.encode("latin-1"))
    with pytest.raises(DataError, match=BAD[text]):
        read_obj(path, texture=False)

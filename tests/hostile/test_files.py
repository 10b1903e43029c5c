"""Manifests, pictures and meshes made to do harm are refused in one sentence."""

from __future__ import annotations

import io
import json
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import strategies as st
from PIL import Image

SHIPPED = Path(__file__).resolve().parents[2] / "data_manifest.yaml"
MANIFEST = SHIPPED.read_bytes()


def changed(before: str, after: str) -> bytes:
    assert before.encode() in MANIFEST
    return MANIFEST.replace(before.encode(), after.encode(), 1)


MANIFESTS = {
    "aliases of aliases": "\n".join(
        ["a0: &a0 [x, x]", *(f"a{n}: &a{n} [*a{n - 1}, *a{n - 1}]" for n in range(1, 60))]
    ).encode(),
    "an alias to itself": b"a: &a [*a]",
    "merged mappings": b"a: &a {x: 1}\nb: {<<: *a}",
    "deep lists": b"[" * 100_000,
    "deep mappings": b"{a: " * 50_000 + b"}" * 50_000,
    "deep keys": b"? " * 50_000,
    "a number of digits": b"schema: " + b"9" * 100_000,
    "a date of no calendar": b"schema: 2026-02-31",
    "sixties": b"schema: " + b"1" + b":59" * 100_000,
    "a tag that calls": b"schema: !!python/object/apply:os.system [true]",
    "binary": b"schema: !!binary ////",
    "no text": b"\xff\xfe" + bytes(100),
    "control characters": b"schema: \x1b[2J",
    "escaped control characters": changed("  paper8:", '  "\\e[2Jpaper8":'),
    "two documents": b"a: 1\n---\nb: 2\n",
    "too large": b"# " + b"x" * 5_000_000,
    "a recipe elsewhere": changed("  paper8:", "  ../../victim:"),
    "a subject elsewhere": changed("subjects: [a01, a02]", "subjects: [../../a01, a02]"),
    "a million million subjects": changed("t00001..t02000", "t000000001..t999999999"),
    "a huge picture": changed("width: 1080", "width: 1000000000"),
    "a picture of nothing": changed("width: 1080", "width: .nan"),
    "a million views": changed("views: 8", "views: 1000000"),
    "nothing": b"",
}


def chunk(kind: bytes, content: bytes) -> bytes:
    checked = kind + content
    return struct.pack(">I", len(content)) + checked + struct.pack(">I", zlib.crc32(checked))


def png(width: int, height: int, *chunks: bytes, mode: int = 6, content: bytes = b"") -> bytes:
    head = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, mode, 0, 0, 0))
    data = chunk(b"IDAT", zlib.compress(content))
    return b"\x89PNG\r\n\x1a\n" + head + b"".join(chunks) + data + chunk(b"IEND", b"")


def sound_picture(form: str, mode: str = "RGB") -> bytes:
    stream = io.BytesIO()
    Image.new(mode, (8, 8)).save(stream, form)
    return stream.getvalue()


SOUND_PNG, SOUND_JPEG = sound_picture("PNG", "RGBA"), sound_picture("JPEG")
PNGS = {
    "a bomb": png(100_000, 100_000, content=bytes(2**24)),
    "a bomb of the largest sides": png(2**31 - 1, 2**31 - 1),
    "a little too large": png(8193, 8192, content=bytes(2**20)),
    "between warning and error": png(10_000, 10_000, content=bytes(2**20)),
    "without pixels": png(0, 10),
    "less than it says": png(4000, 4000, content=bytes(1000)),
    "text that expands": png(
        8, 8, *[chunk(b"zTXt", b"a\0\0" + zlib.compress(bytes(2**26)))] * 20, content=bytes(264)
    ),
    "a profile that expands": png(
        8, 8, chunk(b"iCCP", b"a\0\0" + zlib.compress(bytes(2**29))), content=bytes(264)
    ),
    "a palette without colours": png(8, 8, mode=3, content=bytes(72)),
    "an unknown mode": png(8, 8, mode=5, content=bytes(264)),
    "a cut chunk": SOUND_PNG[:40],
    "a chunk of four gigabytes": SOUND_PNG[:33] + struct.pack(">I", 2**32 - 1) + SOUND_PNG[37:],
    "a JPEG": SOUND_JPEG,
    "nothing": b"",
}
TEXTURES = {
    "a bomb": png(100_000, 100_000, content=bytes(2**24)),
    "a wide JPEG": SOUND_JPEG.replace(b"\x08\x00\x08\x00\x08", b"\x08\xff\xff\xff\xff", 1),
    "a cut JPEG": SOUND_JPEG[:-20],
    "PostScript, which another program would run": (
        b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n%%EndComments\n(%pipe%touch x) run\n"
    ),
    "a wide BMP": b"BM"
    + struct.pack("<IHHIIiiHHIIiiII", 54, 0, 0, 54, 40, 2**30, 2**30, 1, 24, *[0] * 6),
    "a TIFF of tags": b"II*\0\x08\0\0\0\xff\xff" + bytes(2000),
    "a drawing": b"<svg/>",
}


def ply(header: str, body: bytes = b"", form: str = "binary_little_endian") -> bytes:
    return f"ply\nformat {form} 1.0\n{header}\nend_header\n".encode() + body


def glb(document: object, binary: bytes = b"") -> bytes:
    text = document if isinstance(document, bytes) else json.dumps(document).encode()
    parts = struct.pack("<II", len(text), 0x4E4F534A) + text
    parts += struct.pack("<II", len(binary), 0x004E4942) + binary
    return b"glTF" + struct.pack("<II", 2, 12 + len(parts)) + parts


XYZ = "property float x\nproperty float y\nproperty float z"
CORNERS = "property list uchar int vertex_indices"
TRIANGLE = np.eye(3, dtype="<f4").tobytes()


def shown(nodes: list[dict[str, object]], **accessor: object) -> dict[str, object]:
    """A document whose nodes show one triangle."""
    return {
        "nodes": nodes,
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 3, **accessor}
        ],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"byteLength": 36}],
    }


PLYS = {
    "vertices without end": ply(f"element vertex {10**15}\n{XYZ}\nelement face 1\n{CORNERS}"),
    "faces without end": ply(
        f"element vertex 3\n{XYZ}\nelement face {2**62}\n{CORNERS}", TRIANGLE
    ),
    "counts below zero": ply(f"element vertex -5\n{XYZ}"),
    "a list of four milliards": ply(
        f"element vertex 3\n{XYZ}\nelement face 1\nproperty list uint int vertex_indices",
        TRIANGLE + b"\xff\xff\xff\xff" + bytes(100),
    ),
    "a list below zero": ply(
        f"element vertex 3\n{XYZ}\nelement face 1\nproperty list int int vertex_indices",
        TRIANGLE + b"\xff\xff\xff\xff" + bytes(100),
    ),
    "rows without properties": ply(f"element nothing {10**17}\nelement vertex 3\n{XYZ}", TRIANGLE),
    "coordinates that are lists": ply(
        "element vertex 1\nproperty list uchar float x\nproperty float y\nproperty float z",
        b"\x02" + bytes(16),
    ),
    "a face of many corners": ply(
        f"element vertex 3\n{XYZ}\nelement face 1\nproperty list uint int vertex_indices",
        TRIANGLE + struct.pack("<I", 10**6) + bytes(4 * 10**6),
    ),
    "a header without end": b"ply\n" + b"comment x\n" * 500_000,
    "text with wide lists": ply(
        f"element vertex 1\n{XYZ}\nelement face 1\n{CORNERS}", b"0 0 0\n999999999 0\n", "ascii"
    ),
}  # fmt: skip
GLBS = {
    "nodes that share children": glb(
        shown([*({"children": [n + 1, n + 1]} for n in range(60)), {"mesh": 0}]), TRIANGLE
    ),
    "a node in itself": glb(shown([{"children": [0], "mesh": 0}]), TRIANGLE),
    "vertices without end": glb(shown([{"mesh": 0}], count=2**60), TRIANGLE),
    "infinitely many": glb(shown([{"mesh": 0}], count=float("inf")), TRIANGLE),
    "a place before the file": glb(shown([{"mesh": 0}], byteOffset=-(2**40)), TRIANGLE),
    "steps backward": glb(
        {
            **shown([{"mesh": 0}]),
            "bufferViews": [{"buffer": 0, "byteLength": 36, "byteStride": -64}],
        },
        TRIANGLE,
    ),
    "vertices in one place": glb(
        {
            **shown([{"mesh": 0}], count=7),
            "bufferViews": [{"buffer": 0, "byteLength": 36, "byteStride": 4}],
        },
        TRIANGLE,
    ),
    "deep text": glb(b"[" * 100_000),
    "no text": glb(b"\xff\xfe"),
    "a longer chunk": b"glTF" + struct.pack("<IIII", 2, 20, 2**32 - 1, 0x4E4F534A),
}
OFFS = {
    "vertices without end": b"OFF\n999999999999 1 0\n0 0 0\n3 0 1 2\n",
    "a count below zero": b"OFF\n-1 -1 0\n0 0 0\n",
    "a wide face": b"OFF\n1 1 0\n0 0 0\n999999999 0 0\n",
    "an index without end": b"OFF\n1 1 0\n0 0 0\n3 0 0 " + b"9" * 40 + b"\n",
}
OBJS = {
    "an index without end": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 " + b"9" * 40 + b"\n",
    "a coordinate without end": b"v 0 0 " + b"9" * 400 + b"\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
    "an index below zero": b"v 0 0 0\nf -1 -2 -999999999999\n",
    "empty lines": b"\n" * 1_000_000,
}
STLS = {
    "facets without end": bytes(80) + struct.pack("<I", 2**32 - 1) + bytes(50),
    "vertices without facets": b"solid x\n" + b"vertex 0 0 0\n" * 100_000 + b"endsolid",
}


@pytest.mark.parametrize(
    ("kind", "suffix", "files"),
    [
        ("manifest", ".yaml", MANIFESTS),
        ("picture", ".png", PNGS),
        ("picture", ".jpg", TEXTURES),
        ("mesh", ".ply", PLYS),
        ("mesh", ".glb", GLBS),
        ("mesh", ".off", OFFS),
        ("mesh", ".obj", OBJS),
        ("mesh", ".stl", STLS),
    ],
    ids=["manifests", "photos", "textures", "ply", "glb", "off", "obj", "stl"],
)
def test_each_crafted_file_is_refused(read_all, assert_harmless, kind, suffix, files):
    readings = read_all(kind, files, suffix)
    assert_harmless(readings)
    assert [reading.name for reading in readings if reading.outcome != "DataError"] == []


def test_a_long_chain_of_nodes_is_read(read_all, assert_harmless):
    nodes = [*({"children": [n + 1]} for n in range(50_000)), {"mesh": 0}]
    readings = read_all("mesh", {"a chain": glb(shown(nodes), TRIANGLE)}, ".glb")
    assert_harmless(readings)
    assert [reading.outcome for reading in readings] == ["read"]


def spoilt(sound: bytes) -> st.SearchStrategy[bytes]:
    """A sound file, cut off or with some bytes changed."""

    def spoil(size: float, changes: list[tuple[int, int]]) -> bytes:
        content = bytearray(sound[: max(1, int(len(sound) * size))])
        for place, value in changes:
            content[place % len(content)] = value
        return bytes(content)

    changes = st.lists(
        st.tuples(st.integers(0, 2**20), st.integers(0, 255)), min_size=1, max_size=8
    )
    return st.builds(spoil, st.one_of(st.just(1.0), st.floats(0.1, 0.99)), changes)


BOX = ply(
    f"element vertex 3\n{XYZ}\nelement face 1\n{CORNERS}",
    TRIANGLE + struct.pack("<Biii", 3, 0, 1, 2),
)


@pytest.mark.parametrize(
    ("kind", "suffix", "sound"),
    [
        ("manifest", ".yaml", b"\n".join(MANIFEST.splitlines()[-40:])),
        ("picture", ".png", SOUND_PNG),
        ("picture", ".jpg", SOUND_JPEG),
        ("mesh", ".ply", BOX),
        ("mesh", ".glb", glb(shown([{"mesh": 0}]), TRIANGLE)),
        ("mesh", ".off", b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"),
        ("mesh", ".obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n"),
    ],
    ids=["manifests", "photos", "textures", "ply", "glb", "off", "obj"],
)
def test_spoilt_files_are_read_or_refused(made, read_all, assert_harmless, kind, suffix, sound):
    files = made(spoilt(sound), 100)
    assert_harmless(read_all(kind, {str(n): content for n, content in enumerate(files)}, suffix))

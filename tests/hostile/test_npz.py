"""NPZ files made to do harm are refused in one sentence, before room is made for what they say."""

from __future__ import annotations

import io
import pickle
import struct
import zipfile

import numpy as np
from hypothesis import strategies as st

#: Stands at the place of an array that SMPL-X needs.
NAME = "v_template.npy"


def header(text: str, version: int = 1) -> bytes:
    body = text.encode("latin1") + b"\n"
    return (
        b"\x93NUMPY"
        + bytes([version, 0])
        + struct.pack("<H" if version == 1 else "<I", len(body))
        + body
    )


def described(descr: str, shape: object, fortran: str = "False") -> bytes:
    return header(f"{{'descr': {descr}, 'fortran_order': {fortran}, 'shape': {shape}, }}")


def archive(*members: bytes, method: int = zipfile.ZIP_STORED, name: str = NAME) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", method) as file:
        for index, content in enumerate(members):
            file.writestr(name if not index else f"{index}.npy", content)
    return stream.getvalue()


def array_file(values: np.ndarray) -> bytes:
    stream = io.BytesIO()
    np.lib.format.write_array(stream, values)
    return stream.getvalue()


def changed(content: bytes, marker: bytes, offset: int, form: str, value: int) -> bytes:
    """A zip file with one field of its last directory entry or end record replaced."""
    place = content.rindex(marker) + offset
    new = struct.pack(form, value)
    return content[:place] + new + content[place + len(new) :]


SOUND = archive(array_file(np.zeros((4, 3))))
ZEROS = described("'<f8'", (2**27,)) + bytes(2**20)
DIRECTORY, END = b"PK\x01\x02", b"PK\x05\x06"

CRAFTED = {
    "objects": archive(array_file(np.zeros(3)).replace(b"'<f8'", b"'|O'  ")),
    "pickled objects": archive(described("'|O'", (1,)) + pickle.dumps([1])),
    "a pickle instead": archive(pickle.dumps({"a": 1})),
    "structured": archive(described("[('a', '<f8'), ('b', '|O')]", (1,)) + bytes(16)),
    "a subarray": archive(described("('<f8', (1000000, 1000000))", (1,)) + bytes(16)),
    "wide void": archive(described("'|V2147483647'", (1,)) + bytes(16)),
    "wide text": archive(described("'<U500000000'", (1,)) + bytes(16)),
    "complex": archive(described("'<c16'", (1,)) + bytes(16)),
    "dates": archive(described("'<M8[s]'", (1,)) + bytes(8)),
    "a wide number": archive(described("'<f16'", (1,)) + bytes(16)),
    "more shape than bytes": archive(described("'<f8'", (2**40,)) + bytes(16)),
    "shape that overflows": archive(described("'<f8'", (2**32, 2**32)) + bytes(16)),
    "shape below zero": archive(described("'<f8'", (-1, -2)) + bytes(16)),
    "shape of text": archive(described("'<f8'", ("a",)) + bytes(16)),
    "shape of a call": archive(described("'<f8'", "().__class__") + bytes(16)),
    "many dimensions": archive(described("'<f8'", (1,) * 60) + bytes(8)),
    "digits without end": archive(described("'<f8'", "(" + "9" * 9000 + ",)") + bytes(8)),
    "deep header": archive(described("'<f8'", "(" * 9000) + bytes(8)),
    "long header": archive(header(" " * 2**24, version=2)),
    "header longer than the file": archive(b"\x93NUMPY\x02\x00" + struct.pack("<I", 2**32 - 1)),
    "unknown version": archive(b"\x93NUMPY\x09\x00" + bytes(100)),
    "a bomb of zeros": archive(
        described("'<f8'", (2**26,)) + bytes(2**29), method=zipfile.ZIP_DEFLATED
    ),
    "a bomb of small ones": archive(
        *[array_file(np.zeros(2**23))] * 2, method=zipfile.ZIP_DEFLATED, name="shapedirs.npy"
    ),
    "a size that is a lie": changed(SOUND, DIRECTORY, 24, "<I", 2**32 - 2),
    "a small lie": changed(SOUND, DIRECTORY, 24, "<I", 10_000),
    "a stored size that is a lie": changed(SOUND, DIRECTORY, 20, "<I", 2**31),
    "an offset beyond": changed(SOUND, DIRECTORY, 42, "<I", 2**31),
    "encrypted": changed(SOUND, DIRECTORY, 8, "<H", 1),
    "unknown compression": changed(SOUND, DIRECTORY, 10, "<H", 99),
    "deflated, it says": changed(SOUND, DIRECTORY, 10, "<H", 8),
    "another checksum": changed(SOUND, DIRECTORY, 16, "<I", 1),
    "a large directory": changed(SOUND, END, 12, "<I", 2**30),
    "a directory elsewhere": changed(SOUND, END, 16, "<I", 2**31),
    "a larger kind of zip": SOUND[: SOUND.rindex(END)]
    + b"PK\x06\x07"
    + bytes(16)
    + SOUND[SOUND.rindex(END) :],
    "many members": archive(*[b""] * 40_000),
    "bzip2": archive(ZEROS, method=zipfile.ZIP_BZIP2),
    "lzma": archive(ZEROS, method=zipfile.ZIP_LZMA),
    "an empty archive": archive(),
    "nothing": b"",
    "an array without an archive": array_file(np.zeros(3)),
    "a pickle": pickle.dumps({"v_template": np.zeros(3)}),
}


def descriptions() -> st.SearchStrategy[bytes]:
    """Archives of one array whose header and content are of any kind."""
    descr = st.sampled_from(
        ["'<f8'", "'|O'", "'<i4'", "'|V99999999'", "'<U9'", "[('a', 'O')]", "'>f4'", "8"]
    )
    shape = st.one_of(
        st.lists(st.integers(-2, 2**40), max_size=5).map(tuple),
        st.text("(),0123456789L -", max_size=20),
    )
    content = st.builds(
        lambda d, s, f, c: described(d, s, f) + c,
        descr, shape, st.sampled_from(["True", "False", "None"]), st.binary(max_size=200),
    )  # fmt: skip
    method = st.sampled_from([zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
    return st.builds(lambda content, method: archive(content, method=method), content, method)


def spoilt() -> st.SearchStrategy[bytes]:
    """A small sound archive, cut off or with some bytes changed."""

    def spoil(size: float, changes: list[tuple[int, int]]) -> bytes:
        content = bytearray(SOUND[: int(len(SOUND) * size)])
        for place, value in changes:
            content[place % len(content)] = value
        return bytes(content)

    changes = st.lists(
        st.tuples(st.integers(0, 2**20), st.integers(0, 255)), min_size=1, max_size=8
    )
    return st.builds(spoil, st.one_of(st.just(1.0), st.floats(0.1, 0.99)), changes)


def test_each_crafted_archive_is_refused_within_little_memory(read_all, assert_harmless):
    readings = read_all("smplx", CRAFTED, ".npz")
    assert_harmless(readings)
    assert {reading.outcome for reading in readings} == {"DataError"}
    for reading in readings:
        assert reading.peak < 16 * len(CRAFTED[reading.name]) + 2**27, reading


def test_two_hundred_made_archives(made, read_all, assert_harmless):
    files = [*made(descriptions(), 120), *made(spoilt(), 80)]
    readings = read_all(
        "smplx", {str(index): content for index, content in enumerate(files)}, ".npz"
    )
    assert_harmless(readings)
    assert {reading.outcome for reading in readings} == {"DataError"}

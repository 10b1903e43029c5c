"""Checkpoints made to do harm, by hand and by hypothesis, are refused in one sentence."""

from __future__ import annotations

import io
import struct
import zipfile

import pytest
from hypothesis import strategies as st


def text(value: str) -> bytes:
    return b"X" + struct.pack("<I", len(value.encode())) + value.encode()


def name(module: str, attribute: str) -> bytes:
    return f"c{module}\n{attribute}\n".encode()


def whole(value: int) -> bytes:
    content = value.to_bytes(value.bit_length() // 8 + 1, "little", signed=True)
    return b"\x8a" + bytes([len(content)]) + content


def group(*values: bytes) -> bytes:
    return b"(" + b"".join(values) + b"t"


def memory(member: str = "0", count: int = 4, kind: str = "FloatStorage") -> bytes:
    parts = (text("storage"), name("torch", kind), text(member), text("cpu"), whole(count))
    return group(*parts) + b"Q"


REBUILD = name("torch._utils", "_rebuild_tensor_v2")
ORDERED = name("collections", "OrderedDict") + b")R"


def tensor(
    shape: tuple[int, ...] = (4,),
    strides: tuple[int, ...] = (1,),
    offset: int = 0,
    held: bytes | None = None,
) -> bytes:
    sizes, steps = (group(*map(whole, values)) for values in (shape, strides))
    held = memory() if held is None else held
    return REBUILD + group(held, whole(offset), sizes, steps, b"\x89", ORDERED) + b"R"


def entry(value: bytes) -> bytes:
    return b"\x80\x02}" + text("a") + value + b"s."


def archive(program: bytes, memory: bytes = bytes(16), **more: bytes) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as made:
        files = {"data.pkl": program, "version": b"3\n", "data/0": memory, **more}
        for path, content in files.items():
            # With a fixed date, the same bytes are changed in every run.
            made.writestr(zipfile.ZipInfo(f"archive/{path}"), content)
    return stream.getvalue()


def with_stored_size(content: bytes, size: int) -> bytes:
    """The same archive, whose list of contents says how many bytes its last file takes in it."""
    place = content.rindex(b"PK\x01\x02") + 20
    return content[:place] + struct.pack("<I", size) + content[place + 4 :]


def deflated(program: bytes) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as made:
        made.writestr("archive/data.pkl", program)
    return stream.getvalue()


SOUND = archive(entry(tensor()))
SYSTEM = name("posix", "system") + group(text("touch /sprung")) + b"R"

CRAFTED = {
    "a call of system": archive(entry(SYSTEM)),
    "a call within a tensor": archive(entry(tensor(held=SYSTEM))),
    "a tensor far beyond its memory": archive(entry(tensor((2**20,)))),
    "a tensor that begins beyond it": archive(entry(tensor(offset=2**33))),
    "a tensor that begins below it": archive(entry(tensor(offset=-1))),
    "strides beyond it": archive(entry(tensor((2, 2), (2**38, 1)))),
    "strides below zero": archive(entry(tensor((4,), (-1,)))),
    "one number a thousand million times": archive(entry(tensor((2**10, 2**20), (0, 0)))),
    "one number as often as is allowed": archive(entry(tensor((2**28,), (0,)))),
    "sizes that overflow": archive(entry(tensor((2**39, 2**39), (0, 0)))),
    "sizes of text": archive(
        entry(REBUILD + group(memory(), whole(0), text("a"), text("b")) + b"R")
    ),
    "another number of strides": archive(entry(tensor((2, 2), (1,)))),
    "forty dimensions": archive(entry(tensor((1,) * 40, (0,) * 40))),
    "memory that is not there": archive(entry(tensor(held=memory("7")))),
    "memory outside the archive": archive(entry(tensor(held=memory("../../etc/passwd")))),
    "memory of another size": archive(entry(tensor()), bytes(12)),
    "memory said to be huge": archive(entry(tensor(held=memory(count=2**39)))),
    "memory of objects": archive(entry(tensor(held=memory(kind="ObjectStorage")))),
    "memory without a kind": archive(entry(tensor(held=group(text("storage")) + b"Q"))),
    "no memory": archive(entry(tensor(held=b"N"))),
    "a dictionary in itself": archive(b"\x80\x02}q\x00" + text("a") + b"h\x00s."),
    "two million instructions": archive(b"\x80\x02" + b"N0" * 10**6 + b"}."),
    "lists in lists": archive(b"\x80\x02" + b"]" * 90_000 + b"a" * 89_999 + b"."),
    "a list that doubles": archive(b"\x80\x02]q\x00" + b"(h\x00h\x00e" * 900 + b"."),
    "an unknown instruction": archive(b"\x80\x02\xff."),
    "no end": archive(b"\x80\x02}"),
    "nothing": archive(b""),
    "a compressed list": deflated(entry(tensor())),
    "a bomb": deflated(b"N0" * 10**8 + b"."),
    "the other byte order": archive(entry(tensor()), byteorder=b"big"),
    "two lists": archive(entry(tensor()), **{"x/data.pkl": b"}."}),
    "a list of contents that is cut off": SOUND[:-30] + SOUND[-22:],
    "a huge list of contents": SOUND[:-10] + struct.pack("<I", 2**32 - 2) + SOUND[-6:],
    "a stored size of 4 GB": with_stored_size(SOUND, 2**32 - 2),
    "a name that moves the cursor": archive(entry(tensor()).replace(b"torch\n", b"\x1b[2J\n")),
}


def test_crafted_checkpoints_are_refused(read_all, assert_harmless):
    readings = read_all("checkpoint", {"sound": SOUND, **CRAFTED}, ".ckpt")
    assert_harmless(readings)
    assert readings[0].outcome == "read"
    read = {reading.name for reading in readings[1:] if reading.outcome == "read"}
    assert read == {"a dictionary in itself"}  # it has no tensors


@pytest.mark.nightly
def test_changed_bytes_are_harmless(read_all, made, assert_harmless):
    def changed(places: list[tuple[int, int]]) -> bytes:
        content = bytearray(SOUND)
        for place, value in places:
            content[place % len(content)] = value
        return bytes(content)

    place = st.tuples(st.integers(0, len(SOUND) - 1), st.integers(0, 255))
    contents = made(st.lists(place, min_size=1, max_size=6).map(changed), 200)
    assert_harmless(read_all("checkpoint", dict(enumerate(contents)), ".ckpt"))


@pytest.mark.nightly
def test_any_list_of_tensors_is_harmless(read_all, made, assert_harmless):
    pieces = st.sampled_from(
        [tensor(), memory(), REBUILD, ORDERED, SYSTEM, text("a"), whole(7), *map(bytes, zip(
            b"().]}0N12QRbtsuae", strict=True)), b"q\x00", b"h\x00", b"\x85", b"\x86"]
    )  # fmt: skip
    programs = st.lists(pieces, max_size=12).map(lambda each: archive(b"\x80\x02" + b"".join(each)))
    assert_harmless(read_all("checkpoint", dict(enumerate(made(programs, 150))), ".ckpt"))

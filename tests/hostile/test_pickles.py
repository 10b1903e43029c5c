"""Pickles made to do harm, by hand and by hypothesis, are refused in one sentence."""

from __future__ import annotations

import pickle
import resource
import struct
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import strategies as st


def text(value: str) -> bytes:
    return b"X" + struct.pack("<I", len(value.encode())) + value.encode()


def name(module: str, attribute: str) -> bytes:
    return f"c{module}\n{attribute}\n".encode()


def whole(value: int) -> bytes:
    content = value.to_bytes(value.bit_length() // 8 + 1, "little", signed=True)
    return b"\x8a" + bytes([len(content)]) + content


def raw(value: bytes) -> bytes:
    return b"B" + struct.pack("<I", len(value)) + value


def group(*values: bytes) -> bytes:
    return b"(" + b"".join(values) + b"t"


def call(function: bytes, *arguments: bytes) -> bytes:
    return function + group(*arguments) + b"R"


def entry(*values: bytes, key: str = "betas") -> bytes:
    """A pickled dictionary with one entry."""
    return b"\x80\x04}" + text(key) + b"".join(values) + b"s."


MULTIARRAY = "numpy.core.multiarray"
RECONSTRUCT = name(MULTIARRAY, "_reconstruct")
NDARRAY = name("numpy", "ndarray")
ZERO, NONE, FALSE = b"K\x00", b"N", b"\x89"


def dtype(code: str, *state: bytes) -> bytes:
    made = call(name("numpy", "dtype"), text(code), FALSE, b"\x88")
    return (
        made
        + group(
            *(state or (b"K\x03", text("<"), NONE, NONE, NONE, *[b"J\xff\xff\xff\xff"] * 2, ZERO))
        )
        + b"b"
    )


def empty_array(*shape: int, code: bytes = b"b") -> bytes:
    return call(RECONSTRUCT, NDARRAY, group(*map(whole, shape)), raw(code))


def pickled_array(
    shape: tuple[int, ...], kind: bytes, content: bytes, fortran: bytes = FALSE
) -> bytes:
    state = group(b"K\x01", group(*map(whole, shape)), kind, fortran, content)
    return empty_array(0) + state + b"b"


def structured(code: str) -> bytes:
    """A dtype of one field 'a' of objects, at an offset far outside of the row."""
    fields = b"}" + text("a") + group(dtype("O8"), whole(2**40)) + b"s"
    state = (b"K\x03", text("|"), NONE, group(text("a")), fields, whole(8), whole(1), ZERO)
    return dtype(code, *state)


ENCODE = name("_codecs", "encode")
FROM_BUFFER = name("numpy.core.numeric", "_frombuffer")
MEGABYTE = "a" * 2**20


def colliding(count: int) -> bytes:
    """A dictionary so many of whose keys have one hash: it takes the square of the count."""
    keys = (whole((n + 1) * (2**61 - 1)) + b"N" for n in range(count))
    return b"\x80\x04}(" + b"".join(keys) + b"u."


#: Each of these does harm to a reader that lets numpy rebuild what the file says.
CRAFTED = {
    "an empty array of 2.4 GB": entry(empty_array(300_000_000, code=b"d")),
    "objects from bytes": entry(pickled_array((8,), dtype("O8"), raw(b"\x41" * 64))),
    "objects from a list": entry(pickled_array((1,), dtype("O8"), b"]K\x01a")),
    "scalar of an object": entry(call(name(MULTIARRAY, "scalar"), dtype("O8"), raw(b"\x41" * 8))),
    "structured objects": entry(pickled_array((1,), structured("V8"), raw(b"\x41" * 8))),
    "structured number": entry(pickled_array((1,), structured("f8"), raw(b"\x41" * 8))),
    "a subarray": entry(
        pickled_array(
            (1,),
            dtype(
                "V8",
                b"K\x03",
                text("|"),
                group(dtype("f8"), group(whole(2**40))),
                NONE,
                NONE,
                whole(8),
                whole(1),
                ZERO,
            ),
            raw(b"\0" * 8),
        )
    ),
    "a wide void": entry(pickled_array((1,), dtype("V2147483647"), raw(b""))),
    "wide text": entry(call(name(MULTIARRAY, "scalar"), dtype("U500000000"))),
    "a wide number": entry(pickled_array((1,), dtype("f16"), raw(b"\0" * 16))),
    "complex": entry(pickled_array((1,), dtype("c16"), raw(b"\0" * 16))),
    "dates": entry(pickled_array((1,), dtype("M8"), raw(b"\0" * 8))),
    "far more shape than bytes": entry(pickled_array((2**30,), dtype("f8"), raw(b"\0" * 8))),
    "shape that overflows": entry(pickled_array((2**32, 2**32), dtype("f8"), raw(b""))),
    "shape below zero": entry(pickled_array((-1, -8), dtype("f8"), raw(b"\0" * 64))),
    "shape of text": entry(
        empty_array(0) + group(b"K\x01", group(text("a")), dtype("f8"), FALSE, raw(b"")) + b"b"
    ),
    "many dimensions": entry(pickled_array((1,) * 40, dtype("f8"), raw(b"\0" * 8))),
    "state of five nothings": entry(empty_array(0) + group(NONE, NONE, NONE, NONE, NONE) + b"b"),
    "state that is the array": entry(empty_array(0) + b"q\x00h\x00b"),
    "a buffer without bytes": entry(
        call(FROM_BUFFER, raw(b""), dtype("f8"), group(whole(2**34)), text("C"))
    ),
    "a dtype of itself": entry(dtype("f8", b"K\x03", text("<"), NONE, NONE, group(NONE))),
    "encoding again and again": entry(
        text(MEGABYTE) + b"q\x00]" + 3000 * (call(ENCODE, b"h\x00", text("latin1")) + b"a")
    ),
    "another encoding": entry(call(ENCODE, text("a" * 1000), text("punycode"))),
    "lists in lists": entry(
        b"]K\x01aq\x000"
        + b"".join(
            bytes((93, 40, 104, n, 104, n, 101, 113, n + 1, 48)) for n in range(60)
        )  # ](hnhneqm0
        + b"h\x3c"
    ),
    "wide lists in lists": entry(
        b"]("
        + b"K\x01" * 1000
        + b"eq\x000"
        + b"]("
        + b"h\x00" * 1000
        + b"eq\x010"
        + b"]("
        + b"h\x01" * 1000
        + b"e"
    ),
    "a list that holds itself": entry(b"]q\x00h\x00a"),
    "deep lists": entry(b"]" * 100_000 + b"a" * 99_999),
    "deep tuples": entry(b")" + b"\x85" * 100_000),
    "a million nothings": b"\x80\x04" + b"N" * 1_000_000 + b".",
    "a billion bytes promised": entry(b"\x8e" + struct.pack("<Q", 2**30)),
    "endless bytes promised": entry(b"\x8e" + struct.pack("<Q", 2**63 - 1)),
    "text of less than nothing": entry(b"T" + struct.pack("<i", -1)),
    "a number of a megabyte": entry(b"\x8b" + struct.pack("<i", 2**20) + b"\x7f" * 2**20),
    "digits without end": entry(b"L" + b"9" * 1_000_000 + b"L\n"),
    "a memory far away": entry(b"K\x01r\xff\xff\xff\xff"),
    "wide characters": entry(text("\U0001f600" * 1_000_000)),
    "wide escapes": entry(b"S'" + b"\\u2603" * 100_000 + b"'\n"),
    "colliding keys": colliding(10_000),
    "two gigabytes of zeros": entry(call(name("builtins", "bytearray"), whole(2**31))),
    "a function": entry(call(name("os", "system"), text("true"))),
    "an instance": entry(b"(" + text("true") + b"ios\nsystem\n"),
    "an object": entry(b"(" + name("os", "system") + text("true") + b"o"),
    "a persistent name": entry(b"Pname\n"),
    "an extension": entry(b"\x82\x01"),
    "a set": entry(b"\x8f(K\x01\x90"),
    "a buffer from outside": entry(b"\x97"),
    "an attribute of an attribute": entry(b"\x8c\x05numpy\x8c\x0edtype.__init__\x93"),
    "control characters": entry(name("\x1b[2Jos", "system")),
    "no dictionary": b"\x80\x04](NNe.",
    "a stack without values": b"\x80\x04...",
    "nothing": b"",
}

_PIECES = [
    *(bytes([code]) for code in b"(.012)]}abdeltsuRNQ\x81\x85\x86\x87\x88\x89\x90\x92\x93\x94\x97"),
    b"h\x00", b"h\x01", b"q\x00", b"q\x01", ZERO, whole(-1), whole(2**40), whole(10**9),
    raw(b"A" * 64), text("f8"), text("O"), text("betas"), RECONSTRUCT, NDARRAY,
    name("numpy", "dtype"), ENCODE,
    name(MULTIARRAY, "scalar"), FROM_BUFFER, name("os", "system"),
    dtype("f8"), dtype("O8"), dtype("V1000000000"), structured("V8"), empty_array(0),
    empty_array(10**9, code=b"d"), name("trimesh.caching", "TrackedArray"),
]  # fmt: skip


def programs(key: str = "betas") -> st.SearchStrategy[bytes]:
    """Pickles of instructions in any order, some of which make and fill arrays."""
    pieces = st.lists(st.sampled_from(_PIECES), min_size=1, max_size=40).map(b"".join)
    shapes = st.lists(st.integers(-3, 2**40), max_size=6).map(tuple)
    kinds = st.sampled_from([dtype(code) for code in ("f8", "O8", "V9", "U9", "f4", "b1")])
    content = st.one_of(st.binary(max_size=80).map(raw), pieces)
    arrays = st.builds(pickled_array, shapes, kinds, content, pieces)
    return st.one_of(pieces, arrays).map(lambda program: entry(program, key=key))


def spoilt(value: object) -> st.SearchStrategy[bytes]:
    """A sound pickle, cut off or with some bytes changed."""
    protocol = st.integers(0, 5)
    change = st.tuples(st.integers(0, 2**20), st.binary(min_size=1, max_size=8))

    def change_bytes(content: bytes, changes: list[tuple[int, bytes]]) -> bytes:
        for place, new in changes:
            place %= len(content)
            content = content[:place] + new + content[place + len(new) :]
        return content

    sound = protocol.map(lambda number: pickle.dumps(value, number))
    cut = st.tuples(sound, st.floats(0, 0.99)).map(
        lambda pair: pair[0][: int(len(pair[0]) * pair[1])]
    )
    return st.one_of(cut, st.builds(change_bytes, sound, st.lists(change, min_size=1, max_size=6)))


FIT = {
    "betas": np.linspace(-1, 1, 10, dtype=np.float32)[None],
    "scale": np.array([0.43]),
    "global_orient": np.zeros((1, 3), np.float32),
    "left_hand_pose": [0.1, 0.2],
}
MODEL = {
    "v_template": np.zeros((50, 3)),
    "f": np.zeros((20, 3), np.uint32),
    "joint2num": np.array({"pelvis": 0}, dtype=object),
}


def test_each_crafted_fit_is_refused(read_all, assert_harmless):
    readings = read_all("fit", CRAFTED, ".pkl")
    assert_harmless(readings)
    assert [reading.name for reading in readings if reading.outcome != "DataError"] == []
    # Memory grows with the file and not with what it says.
    for reading in readings:
        assert reading.peak < 3 * len(CRAFTED[reading.name]) + 2**27, reading


@pytest.mark.nightly
def test_many_colliding_keys_are_refused(read_all, assert_harmless):
    readings = read_all("fit", {"colliding keys": colliding(30_000)}, ".pkl")
    assert_harmless(readings)
    assert [reading.outcome for reading in readings] == ["DataError"]


@pytest.mark.nightly
def test_two_hundred_made_fits(made, read_all, assert_harmless):
    files = [*made(programs(), 150), *made(spoilt(FIT), 50)]
    readings = read_all("fit", {str(index): content for index, content in enumerate(files)}, ".pkl")
    assert_harmless(readings)
    assert sum(reading.outcome == "DataError" for reading in readings) >= 150


@pytest.mark.nightly
def test_two_hundred_made_pickles_of_smplx(made, read_all, assert_harmless):
    """What the model does not need is passed over, but never rebuilt."""
    files = [*CRAFTED.values(), *made(programs("v_template"), 100), *made(spoilt(MODEL), 60)]
    readings = read_all(
        "smplx", {str(index): content for index, content in enumerate(files)}, ".pkl"
    )
    assert len(readings) >= 200
    assert_harmless(readings)
    assert {reading.outcome for reading in readings} == {"DataError"}


@pytest.mark.parametrize("name", ["an empty array of 2.4 GB", "objects from bytes"])
def test_the_crafted_files_do_harm(name):
    """An ordinary unpickler takes too much, or crashes: else the tests above prove nothing."""
    script = "import pickle, sys; repr(pickle.loads(sys.stdin.buffer.read()))"

    def one_gib() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (2**31, 2**31))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))

    done = subprocess.run(
        [sys.executable, "-c", script], input=CRAFTED[name], capture_output=True, check=False,
        preexec_fn=one_gib, env={"OPENBLAS_NUM_THREADS": "1"},
    )  # fmt: skip
    print(len(CRAFTED[name]), done)
    assert (
        done.returncode < 0 or b"MemoryError" in done.stderr or b"Unable to allocate" in done.stderr
    )

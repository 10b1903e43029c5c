"""NPZ files of numbers are read as numpy reads them; other members are passed over."""

from __future__ import annotations

import io
import zipfile

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from harness.core.errors import DataError
from harness.core.files.npz import read_array_npz, read_required_arrays, write_npz

KINDS = [
    np.dtype(code).newbyteorder(order)
    for code in ["?", "b", "B", "h", "H", "i", "I", "q", "Q", "e", "f", "d"]
    for order in "<>"
]


@settings(max_examples=100, deadline=None)
@given(
    array=st.sampled_from(KINDS).flatmap(
        lambda dtype: hnp.arrays(dtype, hnp.array_shapes(min_dims=0, max_dims=4, min_side=0))
    ),
    compressed=st.booleans(),
    fortran=st.booleans(),
)
def test_every_numeric_array_is_as_numpy_reads_it(tmp_path_factory, array, compressed, fortran):
    array = np.asfortranarray(array) if fortran and array.ndim > 1 else array
    path = tmp_path_factory.getbasetemp() / "a.npz"
    (np.savez_compressed if compressed else np.savez)(
        path, a=array, other=np.array({}, dtype=object)
    )
    found = read_array_npz(path, ["a", "absent"])
    assert list(found) == ["a"]
    assert found["a"].dtype == array.dtype
    np.testing.assert_array_equal(found["a"], array)


def test_short_text_is_read(tmp_path):
    names = np.array(["pelvis", "knie\N{WHITE SMILING FACE}"])
    np.savez(tmp_path / "a.npz", names=names)
    assert read_array_npz(tmp_path / "a.npz", ["names"])["names"].tolist() == names.tolist()


@pytest.mark.filterwarnings("ignore:Reading `.npy`")
def test_headers_of_python_2_are_read(tmp_path):
    header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (2L, 1L), }          \n"
    content = (
        b"\x93NUMPY\x01\x00" + bytes([len(header), 0]) + header + np.array([1.0, 2.0]).tobytes()
    )
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("a.npy", content)
    np.testing.assert_array_equal(read_array_npz(tmp_path / "a.npz", ["a"])["a"], [[1.0], [2.0]])


def test_one_changed_bit_is_noticed(tmp_path):
    stream = io.BytesIO()
    np.savez(stream, a=np.arange(1000.0))
    content = bytearray(stream.getvalue())
    content[4000] ^= 1
    (tmp_path / "a.npz").write_bytes(content)
    with pytest.raises(DataError, match=r"was refused .*Bad CRC-32"):
        read_array_npz(tmp_path / "a.npz", ["a"])


def test_what_is_not_there_is_told(tmp_path):
    with pytest.raises(DataError, match="no readable file"):
        read_array_npz(tmp_path / "a.npz", ["a"])


def test_a_wanted_array_of_objects_is_refused(tmp_path):
    np.savez(tmp_path / "a.npz", a=np.array({}, dtype=object))
    with pytest.raises(DataError, match=r"'a.npy' holds something else than numbers"):
        read_array_npz(tmp_path / "a.npz", ["a"])


@pytest.mark.parametrize("compressed", [True, False])
def test_what_is_written_is_read_whole(tmp_path, compressed):
    arrays = {"a": np.arange(3.0), "name": np.array("knee"), "mask": np.eye(2, dtype=bool)}
    path = tmp_path / "deep" / "a.npz"
    write_npz(path, arrays, compressed=compressed)
    found = read_array_npz(path)
    assert found.keys() == arrays.keys()
    for name, array in arrays.items():
        np.testing.assert_array_equal(found[name], array)
    assert [file.name for file in path.parent.iterdir()] == ["a.npz"]


def test_a_file_without_a_required_array_says_what_it_should_hold(tmp_path):
    write_npz(tmp_path / "a.npz", {"a": np.arange(3.0)})
    assert list(read_required_arrays(tmp_path / "a.npz", ["a"], "fitted body", "Again")) == ["a"]
    message = r"a\.npz holds no fitted body \(expected a, b; got a file without b\)\. Again"
    with pytest.raises(DataError, match=message):
        read_required_arrays(tmp_path / "a.npz", ["a", "b"], "fitted body", "Again")
    (tmp_path / "b.npz").write_bytes(b"no zip")
    with pytest.raises(DataError, match=r"b\.npz holds no fitted body .*Again"):
        read_required_arrays(tmp_path / "b.npz", ["a"], "fitted body", "Again")

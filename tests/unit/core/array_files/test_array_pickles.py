"""Fits are read, planted code is not run."""

from __future__ import annotations

import collections
import os
import pathlib
import pickle
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse
import trimesh.caching
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from harness.core.errors import DataError
from harness.core.files.pickles import MOST_PICKLE_BYTES, arrays_of, read_array_pickle


def write(path: Path, value: object, protocol: int = 4) -> Path:
    path.write_bytes(pickle.dumps(value, protocol=protocol))
    return path


@pytest.mark.parametrize("protocol", [0, 1, 2, 3, 4, 5])
def test_arrays_scalars_and_lists_are_read(tmp_path, protocol):
    fit = {
        "betas": np.arange(10, dtype=np.float32)[None],
        "scale": np.array([0.4335]),
        "number": np.float64(2.5),
        "translation": [0.1, 0.2, 0.3],
    }
    found = read_array_pickle(write(tmp_path / "fit.pkl", fit, protocol))
    assert set(found) == set(fit)
    for name, value in fit.items():
        assert type(found[name]) is np.ndarray
        np.testing.assert_array_equal(found[name], value)


KINDS = [np.dtype(code) for code in ["?", "b", "B", "h", "H", "i", "I", "q", "Q", "e", "f", "d"]]


@settings(max_examples=150, deadline=None)
@given(
    array=st.sampled_from([dtype.newbyteorder(order) for dtype in KINDS for order in "<>"]).flatmap(
        lambda dtype: hnp.arrays(dtype, hnp.array_shapes(min_dims=0, max_dims=4, min_side=0))
    ),
    protocol=st.integers(0, 5),
    fortran=st.booleans(),
)
def test_every_numeric_array_is_as_pickle_reads_it(tmp_path_factory, array, protocol, fortran):
    array = np.asfortranarray(array) if fortran and array.ndim > 1 else array
    path = write(tmp_path_factory.getbasetemp() / "fit.pkl", {"a": array, "again": array}, protocol)
    found = arrays_of(path, None)
    for name in ("a", "again"):
        assert found[name].dtype == array.dtype
        np.testing.assert_array_equal(found[name], array)


@pytest.mark.parametrize("protocol", [0, 1, 2, 4, 5])
def test_names_of_both_numpys_are_known(tmp_path, protocol):
    content = pickle.dumps({"a": np.arange(3.0)}, protocol)
    newer = content.replace(b"numpy.core", b"numpy._core")
    # Shorter names have their length before them.
    newer = newer.replace(b"\x15numpy._core.multi", b"\x16numpy._core.multi")
    newer = newer.replace(b"\x12numpy._core.num", b"\x13numpy._core.num")
    assert newer != content
    (tmp_path / "fit.pkl").write_bytes(newer)
    np.testing.assert_array_equal(read_array_pickle(tmp_path / "fit.pkl")["a"], np.arange(3.0))


#: {'betas': float32 array, 'n': 3} as Python 2 writes it: bytes are text, without any encoding.
PYTHON_2 = {
    0: (
        b"(dp0\nS'betas'\np1\ncnumpy.core.multiarray\n_reconstruct\np2\n(cnumpy\nndarray\np3\n(I0\ntp4"
        b"\nS'b'\np5\ntp6\nRp7\n(I1\n(I2\ntp8\ncnumpy\ndtype\np9\n(S'f4'\np10\nI0\nI1\ntp11\nRp12\n(I3"
        b"\nS'<'\np13\nNNNI-1\nI-1\nI0\ntp14\nbI00\nS'\\x00\\x00\\x80?\\x00\\x00\\x00\\xc0'\np15\ntp16\nb"
        b"sS'n'\np17\nI3\ns."
    ),
    2: (
        b"\x80\x02}q\x00(U\x05betasq\x01cnumpy.core.multiarray\n_reconstruct\nq\x02cnumpy\nndarray\n"
        b"q\x03K\x00\x85q\x04U\x01bq\x05\x87q\x06Rq\x07(K\x01K\x02\x85q\x08cnumpy\ndtype\nq\x09U\x02f4q"
        b"\x0aK\x00K\x01\x87q\x0bRq\x0c(K\x03U\x01<q\x0dNNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\x00tq"
        b"\x0eb\x89U\x08\x00\x00\x80?\x00\x00\x00\xc0q\x0ftq\x10bU\x01nq\x11K\x03u."
    ),
}


@pytest.mark.parametrize("protocol", [0, 2])
def test_fits_of_python_2_are_read(tmp_path, protocol):
    (tmp_path / "fit.pkl").write_bytes(PYTHON_2[protocol])
    expected = pickle.loads(PYTHON_2[protocol], encoding="latin1")  # noqa: TID251  our own bytes
    np.testing.assert_array_equal(expected["betas"], np.float32([1, -2]))
    found = read_array_pickle(tmp_path / "fit.pkl")
    np.testing.assert_array_equal(found["betas"], expected["betas"])
    assert found["n"] == 3


def test_only_what_is_wanted_has_to_be_numbers(tmp_path):
    path = write(tmp_path / "m.pkl", {"v": np.eye(2), "names": np.array({"a": 1}, dtype=object)})
    assert list(read_array_pickle(path, ["v", "absent"])) == ["v"]
    with pytest.raises(DataError, match="an array of 'O8', which are not plain numbers"):
        read_array_pickle(path)
    with pytest.raises(DataError, match="'names': it holds an array of 'O8'"):
        read_array_pickle(path, ["names"])


@pytest.mark.parametrize("protocol", [0, 2, 4])
def test_objects_of_packages_are_passed_over(tmp_path, protocol):
    """SMPL-X's own files hold such, as chumpy's arrays and SciPy's matrices are."""
    model = {
        "v": np.eye(2),
        "chumpy": pathlib.PurePosixPath("a"),
        "ordered": collections.OrderedDict(a=1),
        "counted": collections.defaultdict(list, a=[1]),
        "sparse": scipy.sparse.csc_matrix(np.eye(3)),
        "list": [scipy.sparse.csc_matrix(np.eye(3)), {"a": {1, 2}}],
    }
    path = write(tmp_path / "m.pkl", model, protocol)
    np.testing.assert_array_equal(read_array_pickle(path, ["v"])["v"], np.eye(2))
    with pytest.raises(DataError, match="'sparse': it refers to (scipy|copy_reg)"):
        read_array_pickle(path, ["v", "sparse"])


def test_tracked_arrays_of_trimesh_become_plain(tmp_path):
    tracked = trimesh.caching.tracked_array(np.arange(6.0).reshape(2, 3))
    found = read_array_pickle(write(tmp_path / "fit.pkl", {"transl": tracked}))
    assert type(found["transl"]) is np.ndarray
    np.testing.assert_array_equal(found["transl"], tracked)


class Planted:
    """Calls a function when it is unpickled."""

    def __init__(self, function: object, *arguments: object) -> None:
        self.call = (function, arguments)

    def __reduce__(self) -> tuple[object, tuple[object, ...]]:
        return self.call  # type: ignore[return-value]


@pytest.mark.parametrize("kind", ["system", "eval", "numpy"])
def test_planted_code_is_refused_and_does_not_run(tmp_path, kind):
    trap = tmp_path / "trap"
    planted = {
        "system": Planted(os.system, f"touch {trap}"),
        "eval": Planted(eval, f"__import__('pathlib').Path({str(trap)!r}).touch()"),
        "numpy": Planted(np.save, str(trap), np.zeros(1)),
    }[kind]
    path = write(tmp_path / "fit.pkl", {"betas": np.zeros(10), "scale": planted})
    with pytest.raises(DataError, match=r"was refused .*nothing else.*refers to"):
        read_array_pickle(path)
    assert not list(tmp_path.glob("trap*"))
    pickle.loads(path.read_bytes())  # noqa: TID251  an ordinary unpickler springs the trap
    assert list(tmp_path.glob("trap*")), "the planted code does not work: the test proves nothing"


def test_other_defects_are_explained(tmp_path):
    with pytest.raises(DataError, match="no readable file"):
        read_array_pickle(tmp_path / "none.pkl")
    (tmp_path / "cut.pkl").write_bytes(pickle.dumps({"a": np.zeros(99)})[:-20])
    with pytest.raises(DataError, match="was refused"):
        read_array_pickle(tmp_path / "cut.pkl")
    with pytest.raises(DataError, match="a dictionary of arrays"):
        read_array_pickle(write(tmp_path / "list.pkl", [1, 2]))
    with pytest.raises(DataError, match=r"'name' in .* is not numeric"):
        read_array_pickle(write(tmp_path / "text.pkl", {"name": "x"}))


def test_files_beyond_the_stated_size_are_refused_unread(tmp_path):
    path = tmp_path / "huge.pkl"
    with path.open("wb") as stream:
        stream.truncate(MOST_PICKLE_BYTES + 1)
    with pytest.raises(DataError, match="larger than any pickle of arrays"):
        read_array_pickle(path)

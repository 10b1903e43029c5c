"""Fits are read, planted code is not run."""

from __future__ import annotations

import os
import pickle
from pathlib import Path

import numpy as np
import pytest
import trimesh.caching

from harness.core.errors import DataError
from harness.data.unpickle import read_array_pickle


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

"""Systems of a mesh's vertices against a factorisation."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from scipy.sparse import diags_array
from scipy.sparse.linalg import spsolve

from harness.geometry.solving import SOLVED, solved


def chain(count: int, hold: float) -> object:
    """Springs in a row, each vertex held a little."""
    off = -np.ones(count - 1)
    return diags_array([off, np.full(count, 2.0 + hold), off], offsets=[-1, 0, 1]).tocsr()


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e6])
def test_the_answer_is_the_factorisations(scale: float) -> None:
    right = np.random.default_rng(0).normal(size=4000)
    stretch = diags_array(np.geomspace(1.0, 300.0, 4000))
    matrix = scale * (stretch @ chain(4000, 0.02) @ stretch)
    before = SOLVED.factorised
    found = solved(matrix, right)
    exact = spsolve(matrix.tocsc(), right)
    assert SOLVED.factorised == before
    np.testing.assert_allclose(found, exact, atol=1e-5 * np.abs(exact).max())


def test_what_hardly_holds_is_factorised_and_counted() -> None:
    right = np.zeros(20_000)
    right[0] = 1.0
    matrix = chain(20_000, 1e-11)
    before = SOLVED.factorised
    found = solved(matrix, right)
    assert SOLVED.factorised == before + 1
    np.testing.assert_allclose(matrix @ found, right, atol=1e-9)


def test_nothing_asked_is_nothing_moved() -> None:
    assert not solved(chain(10, 0.1), np.zeros(10)).any()


def test_the_number_of_threads_changes_no_bit() -> None:
    program = """
import hashlib, numpy as np
from tests.unit.geometry.test_solving import chain, solved
found = solved(chain(100_000, 0.05), np.random.default_rng(0).normal(size=100_000))
print(hashlib.sha256(found.tobytes()).hexdigest())
"""
    answers = {
        subprocess.run(
            [sys.executable, "-c", program],
            env={"OMP_NUM_THREADS": threads, "OPENBLAS_NUM_THREADS": threads, "PATH": ""},
            check=True,
            capture_output=True,
        ).stdout
        for threads in ("1", "2", "4")
    }
    assert len(answers) == 1

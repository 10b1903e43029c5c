"""The half-size solver agrees with a dense one on the whole system."""

from __future__ import annotations

import numpy as np
import pytest

from harness.core.errors import MissingPart
from methods.surface.bilateral import Couplings, solve


def dense(system: Couplings) -> np.ndarray:
    """The matrix of a system, written out pixel by pixel."""
    rows, columns = system.diagonal.shape
    matrix = np.diag(system.diagonal.ravel())

    def tie(first: int, second: int, strength: float) -> None:
        matrix[first, second] -= strength
        matrix[second, first] -= strength

    for row in range(rows):
        for column in range(columns):
            here = row * columns + column
            if column + 1 < columns:
                tie(here, here + 1, system.right[row, column])
            if row + 1 < rows:
                tie(here, here + columns, system.down[row, column])
            if system.link is not None and row + system.link_rows < rows:
                there = here + system.link_rows * columns
                tie(here, there, system.link[row, column])
    return matrix


def random_system(seed: int, *, linked: bool) -> Couplings:
    rng = np.random.default_rng(seed)
    shape = (10, 7)
    right, down = rng.uniform(0.1, 2.0, shape), rng.uniform(0.1, 2.0, shape)
    right[:, -1], down[-1] = 0.0, 0.0
    diagonal = rng.uniform(0.05, 0.2, shape)
    diagonal += right + down
    diagonal[:, 1:] += right[:, :-1]
    diagonal[1:] += down[:-1]
    link = None
    if linked:
        link = rng.uniform(0.1, 1.0, shape)
        link[5:] = 0.0
        diagonal += link
        diagonal[5:] += link[:-5]
    return Couplings(diagonal, right, down, rng.normal(size=shape), link, 5 if linked else 0)


@pytest.mark.parametrize("linked", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_solution_is_the_dense_one(seed: int, linked: bool) -> None:
    system = random_system(seed, linked=linked)
    start = np.random.default_rng(seed + 100).normal(size=system.diagonal.shape)
    solution, steps = solve(system, start, 1e-6)
    expected = np.linalg.solve(dense(system), system.target.ravel()).reshape(start.shape)
    assert steps > 0
    np.testing.assert_allclose(solution, expected, atol=2e-5)


def test_half_the_steps_of_plain_conjugate_gradients() -> None:
    system = random_system(7, linked=False)
    _, steps = solve(system, np.zeros(system.diagonal.shape), 1e-4)
    matrix, target = dense(system), system.target.ravel()
    values, residual, direction, plain = np.zeros(70), target, None, 0
    previous = 0.0
    while np.linalg.norm(residual) > 1e-4 * np.linalg.norm(target):
        preconditioned = residual / np.diag(matrix)
        squared = residual @ preconditioned
        direction = preconditioned + (squared / previous * direction if plain else 0.0)
        length = squared / (direction @ matrix @ direction)
        values, residual = values + length * direction, residual - length * (matrix @ direction)
        previous, plain = squared, plain + 1
    assert steps <= plain / 2 + 1


def test_pixels_without_equation_keep_their_value() -> None:
    shape = (4, 3)
    zeros = np.zeros(shape)
    start = np.arange(12.0).reshape(shape)
    solution, steps = solve(Couplings(zeros, zeros, zeros, zeros), start, 1e-3)
    assert steps == 0
    np.testing.assert_array_equal(solution, start)


@pytest.mark.parametrize("linked", [False, True])
def test_torch_takes_the_same_steps(linked: bool) -> None:
    """On torch's own CPU: the code path of a GPU, on every machine."""
    import torch

    system = random_system(3, linked=linked)
    start = np.random.default_rng(5).normal(size=system.diagonal.shape)
    ours, steps = solve(system, start, 1e-5)
    torchs, torch_steps = solve(system, start, 1e-5, device=str(torch.device("cpu", 0)))
    np.testing.assert_allclose(torchs, ours, atol=1e-4)
    assert steps <= torch_steps < steps + 8


def test_torch_stays_finite_when_nothing_is_left_to_do() -> None:
    system = random_system(3, linked=False)
    exact = np.linalg.solve(dense(system), system.target.ravel()).reshape(10, 7)
    solution, steps = solve(system, exact, 1e-6, device="cpu:0")
    assert steps == 0
    solution, _ = solve(system, np.zeros((10, 7)), 1e-30, max_steps=400, device="cpu:0")
    np.testing.assert_allclose(solution, exact, atol=1e-5)


def test_a_gpu_agrees_with_the_processor() -> None:
    import torch

    if not torch.cuda.is_available():
        pytest.skip("this machine has no GPU")
    system = random_system(3, linked=True)
    start = np.random.default_rng(5).normal(size=system.diagonal.shape)
    ours, _ = solve(system, start, 1e-5)
    theirs, _ = solve(system, start, 1e-5, device="cuda")
    np.testing.assert_allclose(theirs, ours, atol=1e-4)


def test_a_missing_gpu_is_said() -> None:
    import torch

    if torch.cuda.is_available():
        pytest.skip("this machine has a GPU")
    with pytest.raises(MissingPart, match="Choose the device 'cpu'"):
        solve(random_system(0, linked=False), np.zeros((10, 7)), 1e-3, device="cuda")

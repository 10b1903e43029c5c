"""The reweighting loop agrees with a dense twin that writes every statement as a row."""

from __future__ import annotations

import numpy as np
import pytest

from harness.core.arrays import Floats
from methods.surface.bilateral import Anchors, Equations, Schedule, integrate


def random_equations(seed: int, shape: tuple[int, int]) -> Equations:
    """A noisy relief with a ledge, seen through a ragged mask."""
    rng = np.random.default_rng(seed)
    inside = rng.random(shape) > 0.1
    relief = np.cumsum(rng.normal(0, 0.4, shape), axis=1)
    relief[:, shape[1] // 2 :] += 4.0
    slope_x = np.diff(relief, axis=1, append=relief[:, -1:]) * (rng.random(shape) > 0.2)
    slope_y = np.diff(relief, axis=0, append=relief[-1:]) * (rng.random(shape) > 0.2)
    normals = np.stack([slope_x, slope_y, np.full(shape, -1.0)])
    normals /= np.linalg.norm(normals, axis=0)
    normals *= inside
    return Equations(inside, normals[2], normals[2] * 1.1, normals[0], normals[1])


def random_anchors(seed: int, equations: Equations, link_rows: int) -> Anchors:
    rng = np.random.default_rng(seed + 50)
    shape = equations.inside.shape
    weight = 0.02 * (equations.inside & (rng.random(shape) > 0.4))
    link = np.zeros(shape)
    both = equations.inside[:-link_rows] & equations.inside[link_rows:]
    link[:-link_rows] = 0.05 * (both & (rng.random(both.shape) > 0.5))
    return Anchors(rng.normal(5.0, 1.0, shape), weight, link, link_rows)


class DenseTwin:
    """Every round solved exactly by least squares on one row per statement."""

    def __init__(self, equations: Equations, anchors: Anchors | None) -> None:
        self.equations, self.anchors = equations, anchors
        self.pixels = [tuple(p) for p in np.argwhere(equations.inside)]
        self.index = {pixel: number for number, pixel in enumerate(self.pixels)}

    def statements(self, weights: dict) -> tuple[Floats, Floats, Floats]:
        """Rows, right-hand sides and weights of all statements, tangent planes first."""
        e, rows, sides, strengths = self.equations, [], [], []
        for row, column in self.pixels:
            for name, there, facing, slope, sign in (
                ("right", (row, column + 1), e.facing_x, e.slope_x, 1),
                ("left", (row, column - 1), e.facing_x, e.slope_x, -1),
                ("down", (row + 1, column), e.facing_y, e.slope_y, 1),
                ("up", (row - 1, column), e.facing_y, e.slope_y, -1),
            ):
                line = np.zeros(len(self.pixels))
                if there in self.index:
                    line[self.index[there]] = sign * facing[row, column]
                    line[self.index[row, column]] = -sign * facing[row, column]
                rows.append(line)
                sides.append(-slope[row, column])
                strengths.append(weights[row, column, name])
        for line, side, strength in self.tied() if self.anchors is not None else ():
            rows.append(line)
            sides.append(side)
            strengths.append(strength)
        return np.array(rows), np.array(sides), np.array(strengths)

    def tied(self):
        anchors = self.anchors
        for row, column in self.pixels:
            line = np.zeros(len(self.pixels))
            line[self.index[row, column]] = 1.0
            yield line, anchors.prior[row, column], anchors.prior_weight[row, column]
            below = (row + anchors.link_rows, column)
            if anchors.link_weight[row, column] > 0:
                line = line.copy()
                line[self.index[below]] = -1.0
                yield line, 0.0, anchors.link_weight[row, column]

    def run(self, schedule: Schedule, rounds: int) -> tuple[Floats, list[float]]:
        names = ("right", "left", "down", "up")
        weights = {(*pixel, name): 0.5 for pixel in self.pixels for name in names}
        energies = []
        for _ in range(rounds):
            rows, sides, strengths = self.statements(weights)
            root = np.sqrt(strengths)
            values = np.linalg.lstsq(rows * root[:, None], sides * root, rcond=None)[0]
            sharpness = schedule.k
            steps = (rows[: 4 * len(self.pixels)] @ values).reshape(-1, 4)
            for pixel, (right, left, down, up) in zip(self.pixels, steps, strict=True):
                for one, other, ahead, back in (
                    ("right", "left", right, left),
                    ("down", "up", down, up),
                ):
                    share = 1.0 / (1.0 + np.exp(-sharpness * (back**2 - ahead**2)))
                    weights[*pixel, one], weights[*pixel, other] = share, 1.0 - share
            rows, sides, strengths = self.statements(weights)
            energies.append(float(strengths @ (rows @ values - sides) ** 2))
        return values, energies


@pytest.mark.parametrize("anchored", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_rounds_agree_with_dense_twin(seed: int, anchored: bool) -> None:
    equations = random_equations(seed, (14, 9))
    anchors = random_anchors(seed, equations, 7) if anchored else None
    schedule = Schedule(k=2.0, max_iter=4, tol=1e-12, solver_tol=1e-6)
    depth, energies = integrate(equations, schedule, anchors)
    expected, expected_energies = DenseTwin(equations, anchors).run(schedule, 4)
    np.testing.assert_allclose(energies, expected_energies, rtol=1e-4)
    found = depth[equations.inside]
    if not anchored:  # each connected part keeps a constant of its own
        from scipy.ndimage import label

        parts = label(equations.inside)[0][equations.inside]
        for part in np.unique(parts):
            found[parts == part] -= found[parts == part].mean()
            expected[parts == part] -= expected[parts == part].mean()
    np.testing.assert_allclose(found, expected, atol=5e-3)


def test_the_loop_ends_where_the_energy_rests() -> None:
    _, energies = integrate(random_equations(0, (14, 9)), Schedule(2.0, 100, tol=10.0))
    assert len(energies) == 1
    _, energies = integrate(random_equations(0, (14, 9)), Schedule(2.0, 100, tol=1e-4))
    changes = np.abs(np.diff(energies)) / energies[:-1]
    assert changes[-1] <= 1e-4
    assert (changes[:-1] > 1e-4).all()


def test_loop_ends_at_max_iter() -> None:
    _, energies = integrate(random_equations(1, (14, 9)), Schedule(2.0, 3, 1e-12))
    assert len(energies) == 3

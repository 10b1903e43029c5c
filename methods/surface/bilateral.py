"""Bilaterally weighted normal integration: the equations, their energy and the reweighting loop.

Each pixel states the slope of its tangent plane four times, towards each neighbour, scaled by how
squarely it is seen: ``facing * (z_neighbour - z) + slope = 0`` towards right and down, the mirrored
form towards left and up. Where the two opposite statements disagree the surface may jump, and the
worse one loses its weight (Cao et al., "Bilateral Normal Integration", ECCV 2022, equations 12 to
18).
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, dia_array
from scipy.special import expit

from harness.core.arrays import Floats, Singles
from harness.core.errors import MissingPart

if TYPE_CHECKING:
    import torch


@dataclass(frozen=True, slots=True, eq=False)
class ReducedSystem:
    """``(I - A B) x = residual``, in single precision, and when its solution is good enough.

    Attributes:
        from_black: The operator A.
        from_red: The operator B.
        residual: (N,) right-hand side.
        unscale: (N,) factors that give the residual of the unscaled equations.
        limit: The solution is good enough when ``|unscale * remaining residual|`` is this or less.
        max_steps: Most steps.
    """

    from_black: dia_array
    from_red: dia_array
    residual: Singles
    unscale: Singles
    limit: float
    max_steps: int


# Reading the residual back stalls the device; a few steps too many cost less.
_STEPS_BETWEEN_READINGS = 8


def require_device(device: str) -> None:
    """Refuse a device that torch cannot compute on here.

    Raises:
        MissingPart: this machine has no such device.
    """
    import torch

    name, _, index = device.partition(":")
    if name == "cuda" and int(index or 0) >= torch.cuda.device_count():
        raise MissingPart(
            "normals cannot be integrated on the GPU",
            expected=f"a device '{device}' that torch can use",
            got=f"{torch.cuda.device_count()} GPUs",
            hint="Choose the device 'cpu': --set surface.device=cpu",
        )


def conjugate_gradients_on(device: str, system: ReducedSystem) -> tuple[Singles, int]:
    """The system's solution (N,) and the steps taken.

    The arithmetic is that of the processor's version, the order of the sums is not.

    Raises:
        MissingPart: this machine has no such device.
    """
    import torch

    require_device(device)
    left, right = _on_device(system.from_black, device), _on_device(system.from_red, device)
    remaining = torch.from_numpy(system.residual.copy()).to(device)
    weights = torch.from_numpy(system.unscale).to(device)
    tiny = torch.tensor(torch.finfo(torch.float32).tiny, device=device)
    solution, direction = torch.zeros_like(remaining), remaining.clone()
    squared = torch.dot(remaining, remaining)
    steps = 0
    for steps in range(system.max_steps + 1):
        reading = steps % _STEPS_BETWEEN_READINGS == 0
        if steps == system.max_steps:
            break
        if reading and float((weights * remaining).norm()) <= system.limit:
            break
        product = direction - left @ (right @ direction)
        # Once nothing remains, both quotients have to stay finite until the next reading.
        length = squared / torch.maximum(torch.dot(direction, product), tiny)
        solution += length * direction
        remaining -= length * product
        previous, squared = squared, torch.dot(remaining, remaining)
        direction = remaining + (squared / torch.maximum(previous, tiny)) * direction
    return solution.cpu().numpy(), steps


def _on_device(operator: dia_array, device: str) -> torch.Tensor:
    import torch

    rows = csr_array(operator, dtype=np.float32)
    with warnings.catch_warnings():
        # torch calls its CSR tensors beta; the product with a vector is all that is used.
        warnings.filterwarnings("ignore", message="Sparse", category=UserWarning)
        return torch.sparse_csr_tensor(
            torch.from_numpy(rows.indptr.astype(np.int32)),
            torch.from_numpy(rows.indices.astype(np.int32)),
            torch.from_numpy(rows.data),
            size=rows.shape,
        ).to(device)


# Solving for the correction of a float64 iterate, single precision is far finer than the tolerance
# and halves the memory traffic that conjugate gradients are made of.
_WORKING = np.float32


@dataclass(frozen=True, slots=True)
class Couplings:
    """The normal equations of a grid of (rows, columns) pixels; columns odd, pixels even in number.

    Attributes:
        diagonal: (rows, columns), zero where a pixel has no equation: it keeps its value.
        right: (rows, columns) strength of the tie to the pixel on the right; last column zero.
        down: (rows, columns) strength of the tie to the pixel below; last row zero.
        link: (rows, columns) strength of the tie to the pixel ``link_rows`` further down, or None.
        link_rows: An odd number of rows, so that the two ends differ in colour.
        target: (rows, columns) right-hand side.
    """

    diagonal: Floats
    right: Floats
    down: Floats
    target: Floats
    link: Floats | None = None
    link_rows: int = 0

    def ties(self) -> list[tuple[int, Floats]]:
        """The flat offset and flat strengths of each kind of tie, at the tie's first pixel."""
        columns = self.diagonal.shape[1]
        ties = [(1, self.right.ravel()), (columns, self.down.ravel())]
        if self.link is not None:
            ties.append((self.link_rows * columns, self.link.ravel()))
        return ties


def solve(
    system: Couplings,
    start: Floats,
    tolerance: float,
    max_steps: int = 5000,
    device: str = "cpu",
) -> tuple[Floats, int]:
    """Values (rows, columns) that satisfy the system, and the conjugate gradient steps taken.

    Starts from ``start`` (rows, columns) and stops when the residual is below ``tolerance`` times
    the length of the right-hand side. One step here does the work of two on the whole system.
    ``device`` is "cpu" for numpy, else a torch device such as "cuda".

    Raises:
        MissingPart: this machine has no such device.
    """
    diagonal = system.diagonal.ravel()
    free = diagonal <= 0  # no equation: out of the system, and back to its start at the end
    scale = 1.0 / np.sqrt(np.where(free, 1.0, diagonal))
    target = system.target.ravel() * scale
    from_black, from_red = _red_black(system.ties(), scale)

    red = (np.where(free, 0.0, start.ravel()) / scale)[0::2]
    reduced = target[0::2] + from_black @ target[1::2]
    residual = reduced - red + from_black @ (from_red @ red)
    # The stopping rule is about the residual of the unscaled equations.
    half = ReducedSystem(
        from_black=dia_array(from_black, dtype=_WORKING),
        from_red=dia_array(from_red, dtype=_WORKING),
        residual=residual.astype(_WORKING),
        unscale=(1.0 / scale[0::2]).astype(_WORKING),
        limit=tolerance * float(np.linalg.norm(system.target)),
        max_steps=max_steps,
    )
    if device == "cpu":
        correction, steps = _conjugate_gradients(half)
    else:
        correction, steps = conjugate_gradients_on(device, half)
    values = np.empty(diagonal.size)
    values[0::2] = red + correction
    values[1::2] = target[1::2] + from_red @ values[0::2]
    values *= scale
    values[free] = start.ravel()[free]
    return values.reshape(start.shape), steps


def _red_black(ties: list[tuple[int, Floats]], scale: Floats) -> tuple[dia_array, dia_array]:
    """The scaled ties as the two operators red <- black and black <- red."""
    half = scale.size // 2
    to_red: dict[int, Floats] = {}
    to_black: dict[int, Floats] = {}
    for offset, strength in ties:
        ahead = np.zeros_like(scale)  # at the first pixel of each tie
        ahead[:-offset] = strength[:-offset] * scale[:-offset] * scale[offset:]
        behind = np.zeros_like(scale)  # the same ties at their second pixel
        behind[offset:] = ahead[:-offset]
        # Red pixel 2a meets black 2b+1 at b-a = (offset-1)/2 ahead and -(offset+1)/2 behind;
        # a diagonal stores its entries by column, so by the pixel that is read.
        forward, backward = (offset - 1) // 2, (offset + 1) // 2
        to_red[forward], to_red[-backward] = behind[1::2], ahead[1::2]
        to_black[backward], to_black[-forward] = behind[0::2], ahead[0::2]
    shape = (half, half)
    return (
        dia_array((np.stack(list(to_red.values())), list(to_red)), shape=shape),
        dia_array((np.stack(list(to_black.values())), list(to_black)), shape=shape),
    )


def _conjugate_gradients(system: ReducedSystem) -> tuple[Singles, int]:
    """The system's solution (N,) and the steps taken."""
    limit, residual = system.limit, system.residual.copy()
    solution = np.zeros_like(residual)
    direction = residual.copy()
    scratch = np.empty_like(residual)
    squared = float(np.dot(residual, residual))
    for step in range(system.max_steps):
        np.multiply(residual, system.unscale, out=scratch)
        if float(np.dot(scratch, scratch)) <= limit * limit:
            return solution, step
        product = system.from_black @ (system.from_red @ direction)
        np.subtract(direction, product, out=product)
        curvature = float(np.dot(direction, product))
        if curvature <= 0.0:  # only a constant is left, which the equations do not see
            return solution, step
        length = _WORKING(squared / curvature)
        np.multiply(direction, length, out=scratch)
        np.add(solution, scratch, out=solution)
        np.multiply(product, length, out=scratch)
        np.subtract(residual, scratch, out=residual)
        previous, squared = squared, float(np.dot(residual, residual))
        np.multiply(direction, _WORKING(squared / previous), out=direction)
        np.add(direction, residual, out=direction)
    return solution, system.max_steps


@dataclass(frozen=True, slots=True)
class Equations:
    """The tangent planes of a grid of pixels; every array is (rows, columns), zero outside.

    Attributes:
        inside: Pixels that belong to the surface.
        facing_x, facing_y: Factor of the depth step along a row and along a column.
        slope_x, slope_y: What that product has to cancel, towards right and towards down.
    """

    inside: NDArray[np.bool_]
    facing_x: Floats
    facing_y: Floats
    slope_x: Floats
    slope_y: Floats

    def rearranged(self, place: Callable[[NDArray[Any]], NDArray[Any]]) -> Equations:
        """The equations with every array put through ``place``, as onto a larger grid."""
        return Equations(
            place(self.inside),
            place(self.facing_x),
            place(self.facing_y),
            place(self.slope_x),
            place(self.slope_y),
        )


@dataclass(frozen=True, slots=True)
class Anchors:
    """Quadratic ties of depth to a prior, and of one sheet to the other.

    Attributes:
        prior: (rows, columns) depth to stay close to.
        prior_weight: (rows, columns) weight of that, zero where there is no prior.
        link_weight: (rows, columns) weight of the difference to the pixel ``link_rows`` below.
        link_rows: An odd number of rows.
    """

    prior: Floats
    prior_weight: Floats
    link_weight: Floats
    link_rows: int


@dataclass(frozen=True, slots=True)
class Schedule:
    """How the reweighting goes on and when it ends, as published.

    ``k``, ``max_iter``, ``tol``, the solver tolerance 1e-3 and the start (depth 0, weights 0.5) are
    the published ones. A surface with jumps has many minima of nearly the same energy, so every
    change of the way there changes the result: a smaller k in the first rounds moves the error of
    one map by -16 to +3 %, and a tighter solver tolerance is better on some maps and worse on
    others. The published way keeps numbers comparable.

    Attributes:
        k: Sharpness of the choice between opposite sides; higher cuts more readily.
        max_iter: Most rounds of reweighting.
        tol: Relative change of energy that ends them.
        device: "cpu", or the torch device that solves the linear systems.
        solver_tol: Residual of the linear systems, relative to their right-hand side.
    """

    k: float
    max_iter: int
    tol: float
    device: str = "cpu"
    solver_tol: float = 1e-3


def integrate(
    equations: Equations, schedule: Schedule, anchors: Anchors | None = None
) -> tuple[Floats, list[float]]:
    """Depth (rows, columns) of least bilateral energy, and the energy after each round.

    Without anchors every connected part keeps a free constant.
    """
    depth = np.zeros(equations.inside.shape)
    weights = _Weights.even(equations)
    energy = _energy(equations, weights, depth, anchors)
    history: list[float] = []
    for _ in range(schedule.max_iter):
        if anchors is not None:
            depth = _shifted_to_prior(depth, equations.inside, anchors)
        system = _normal_equations(equations, weights, anchors)
        depth, _ = solve(system, depth, schedule.solver_tol, device=schedule.device)
        weights = _Weights.bilateral(equations, depth, schedule.k)
        previous, energy = energy, _energy(equations, weights, depth, anchors)
        history.append(energy)
        if abs(energy - previous) <= schedule.tol * previous:
            break
    return depth, history


@dataclass(frozen=True, slots=True)
class _Weights:
    """Weights (rows, columns) of the right and the down statement; left and up have the rest."""

    right: Floats
    down: Floats

    @classmethod
    def even(cls, equations: Equations) -> _Weights:
        half = np.full(equations.inside.shape, 0.5)
        return cls(half, half)

    @classmethod
    def bilateral(cls, equations: Equations, depth: Floats, k: float) -> _Weights:
        right, left, down, up = _scaled_steps(equations, depth)
        return cls(expit(k * (left**2 - right**2)), expit(k * (up**2 - down**2)))


def _steps(equations: Equations, depth: Floats) -> tuple[Floats, Floats]:
    """Depth steps to the right and down, zero where either end is outside."""
    inside = equations.inside
    across, along = np.zeros_like(depth), np.zeros_like(depth)
    np.subtract(depth[:, 1:], depth[:, :-1], out=across[:, :-1])
    np.subtract(depth[1:], depth[:-1], out=along[:-1])
    across[:, :-1] *= inside[:, 1:] & inside[:, :-1]
    along[:-1] *= inside[1:] & inside[:-1]
    across[:, -1] = 0.0
    along[-1] = 0.0
    return across, along


def _scaled_steps(equations: Equations, depth: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Steps to right, from left, down and from above, each scaled by the pixel's own facing."""
    across, along = _steps(equations, depth)
    right, down = equations.facing_x * across, equations.facing_y * along
    left, up = np.zeros_like(depth), np.zeros_like(depth)
    np.multiply(equations.facing_x[:, 1:], across[:, :-1], out=left[:, 1:])
    np.multiply(equations.facing_y[1:], along[:-1], out=up[1:])
    return right, left, down, up


def _energy(
    equations: Equations, weights: _Weights, depth: Floats, anchors: Anchors | None
) -> float:
    right, left, down, up = _scaled_steps(equations, depth)
    x, y = equations.slope_x, equations.slope_y
    energy = weights.right * (right + x) ** 2 + (1 - weights.right) * (left + x) ** 2
    energy += weights.down * (down + y) ** 2 + (1 - weights.down) * (up + y) ** 2
    if anchors is not None:
        rows = anchors.link_rows
        energy += anchors.prior_weight * (depth - anchors.prior) ** 2
        energy[:-rows] += anchors.link_weight[:-rows] * (depth[rows:] - depth[:-rows]) ** 2
    return float(energy.sum())


def _normal_equations(
    equations: Equations, weights: _Weights, anchors: Anchors | None
) -> Couplings:
    """The linear system of one round, tie by tie: no sparse matrix is multiplied."""
    inside = equations.inside
    shape = inside.shape
    diagonal, target = np.zeros(shape), np.zeros(shape)
    ties = []
    for axis, facing, slope, weight in (
        (1, equations.facing_x, equations.slope_x, weights.right),
        (0, equations.facing_y, equations.slope_y, weights.down),
    ):
        first = (slice(None), slice(None, -1)) if axis == 1 else (slice(None, -1), slice(None))
        second = (slice(None), slice(1, None)) if axis == 1 else (slice(1, None), slice(None))
        joined = inside[first] & inside[second]
        # A tie is stated twice: by its first pixel looking ahead, by its second looking back.
        scaled = weight * facing, (1 - weight) * facing
        strength = scaled[0][first] * facing[first] + scaled[1][second] * facing[second]
        pull = scaled[0][first] * slope[first] + scaled[1][second] * slope[second]
        strength *= joined
        pull *= joined
        diagonal[first] += strength
        diagonal[second] += strength
        target[first] += pull
        target[second] -= pull
        tie = np.zeros(shape)
        tie[first] = strength
        ties.append(tie)
    if anchors is None:
        return Couplings(diagonal, ties[0], ties[1], target)
    rows, link = anchors.link_rows, anchors.link_weight
    diagonal += anchors.prior_weight + link
    diagonal[rows:] += link[:-rows]
    target += anchors.prior_weight * anchors.prior
    return Couplings(diagonal, ties[0], ties[1], target, link, rows)


def _shifted_to_prior(depth: Floats, inside: NDArray[np.bool_], anchors: Anchors) -> Floats:
    """Depth with each sheet moved as a whole to its prior: what the solver would reach last."""
    shifted = depth.copy()
    for sheet in (slice(None, anchors.link_rows), slice(anchors.link_rows, None)):
        known = anchors.prior_weight[sheet] > 0
        if known.any():
            offset = (anchors.prior[sheet] - depth[sheet])[known].mean()
            shifted[sheet][inside[sheet]] += offset
    return shifted

"""Linear systems on a pixel grid, solved by conjugate gradients on half of the pixels.

Every equation here joins a pixel to a neighbour of the other colour of the checkerboard, so with a
symmetric diagonal scaling the normal equations read ``[[I, -C], [-C', I]]`` over (red, black).
Eliminating black leaves ``(I - C C') red = ...`` with half the unknowns, and its conjugate
gradients make in one step the progress of two Jacobi-preconditioned steps on the whole system,
along the same path (Reid 1972, "The use of conjugate gradients for systems of linear equations
possessing 'Property A'"): half the work for the same answer.

The grid is kept flat with an odd row length, so that neighbours of either colour sit at constant
offsets and ``C`` is four diagonals: no index arrays, products that run at memory speed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import dia_array

from harness.core.arrays import Floats, Singles
from methods.surface.device_solver import conjugate_gradients_on
from methods.surface.reduced_system import ReducedSystem

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

"""The linear system that is left once half of the pixels are eliminated."""

from __future__ import annotations

from dataclasses import dataclass

from scipy.sparse import dia_array

from harness.core.arrays import Singles


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

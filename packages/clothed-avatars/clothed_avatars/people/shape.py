"""How far a person's body is from what the body model gives for a phenotype."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Deformation:
    """How a body differs from all that the body model can give (see ``deformation``).

    seed; rms_m: root mean square of the movement over the skin that moves; bump_m: how far apart
    bumps are.
    """

    seed: int
    rms_m: float
    bump_m: float

"""What Blender's cloth solver is asked for, as it travels to the process that runs it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class ClothFabric:
    """How one garment's cloth behaves.

    Attributes:
        stiffness: Resistance to bending.
        surplus: Share by which the cloth is longer than it was cut.
        quality: The solver's steps in each frame.
    """

    stiffness: float
    surplus: float
    quality: int


@dataclass(frozen=True, slots=True)
class GarmentJob:
    """One garment.

    Attributes:
        file: .npz with frames (N,V,3) in metres and the product's axes, faces, and pin (V,).
        out: .npy to write: the last two frames (2,V,3).
        fabric: Its cloth.
    """

    file: Path
    out: Path
    fabric: ClothFabric


@dataclass(frozen=True, slots=True)
class DrapeJob:
    """A moving body and the garments that are draped on it.

    Attributes:
        folder: For the solver's own files.
        body: .npz with frames (N,V,3) in metres and the product's axes, and faces.
        garments: The inner first; each becomes an obstacle for the next.
    """

    folder: Path
    body: Path
    garments: tuple[GarmentJob, ...]

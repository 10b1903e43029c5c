"""What Blender's cloth solver is asked for, as it travels to the process that runs it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any


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

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> GarmentJob:
        """The garment behind ``DrapeJob.to_dict``."""
        return cls(Path(values["file"]), Path(values["out"]), ClothFabric(**values["fabric"]))


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

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values."""
        garments = [
            {"file": str(each.file), "out": str(each.out), "fabric": asdict(each.fabric)}
            for each in self.garments
        ]
        return {"folder": str(self.folder), "body": str(self.body), "garments": garments}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> DrapeJob:
        """The job behind ``to_dict``."""
        garments = tuple(GarmentJob.from_dict(each) for each in values["garments"])
        return cls(Path(values["folder"]), Path(values["body"]), garments)

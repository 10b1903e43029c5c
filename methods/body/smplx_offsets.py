"""Where MediaPipe marks people, relative to SMPL-X's points of the same names.

For Anny these offsets were measured once and are in ``models/offsets.py``. SMPL-X may not be passed
on, and so nobody could measure them here: a user measures them with ``harness parts calibrate
smplx``, on scans whose SMPL-X body is known. They hold for all model files, which number their
vertices alike. Where nothing was measured, all offsets are zero, and the parts of a method say so.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from harness.core.errors import DataError
from harness.core.files.atomic import read_json, write_json
from harness.core.files.hashing import file_sha256
from harness.core.protocols import Part
from harness.core.typed_json import from_json, to_json
from methods.parts.store import parts_folder

_ROLE = "landmark offsets"
_REMEDY = "Run: harness parts calibrate smplx --replace"
_MOST_MM = 500.0

Triple = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class MeasuredOffset:
    """One landmark's.

    Attributes:
        landmark: MediaPipe's index.
        offset_mm: From SMPL-X's point to where MediaPipe marks it, in the world's axes of the rest
            pose; it turns with the joint that carries the landmark.
        spread_mm: Median distance of a subject from it.
    """

    landmark: int
    offset_mm: Triple
    spread_mm: float


@dataclass(frozen=True, slots=True)
class SmplxOffsets:
    """What was measured, and on what.

    Attributes:
        dataset: Name of the scans' dataset.
        subjects: Those that were used.
        recipe: How they were photographed.
        model_sha256: Digest of the model that was fitted to their photos.
        measured: By landmark.
    """

    dataset: str
    subjects: tuple[str, ...]
    recipe: str
    model_sha256: str
    measured: tuple[MeasuredOffset, ...]

    @property
    def offsets_mm(self) -> Mapping[int, Triple]:
        """The offsets by MediaPipe index."""
        return {each.landmark: each.offset_mm for each in self.measured}

    @property
    def title(self) -> str:
        """What records call them."""
        return f"measured on {len(self.subjects)} subjects of {self.dataset}"


def offsets_file() -> Path:
    """Where measured offsets are kept, beside the imported models; it need not exist."""
    return parts_folder() / "smplx" / "landmark_offsets.json"


def stored_offsets() -> SmplxOffsets | None:
    """What was measured; None where nothing was.

    Raises:
        DataError: the file is no such measurement.
    """
    path = offsets_file()
    if not path.is_file():
        return None
    found = from_json(SmplxOffsets, read_json(path), path, "a measurement of landmark offsets")
    for each in found.measured:
        if not all(math.isfinite(value) and abs(value) < _MOST_MM for value in each.offset_mm):
            raise DataError(
                f"{path} is damaged: landmark {each.landmark} has no sound offset",
                expected=f"three numbers below {_MOST_MM:g} mm",
                got=str(each.offset_mm),
                hint=_REMEDY,
            )
    return found


def keep_offsets(offsets: SmplxOffsets) -> Path:
    """The file in which a measurement is kept from now on."""
    path = offsets_file()
    path.parent.mkdir(parents=True, exist_ok=True)
    write_json(path, to_json(offsets))
    return path


def forget_offsets() -> bool:
    """Whether there was a measurement; from now on all offsets are zero."""
    there = offsets_file().is_file()
    offsets_file().unlink(missing_ok=True)
    return there


def offsets_part() -> Part:
    """The offsets that a fit of SMPL-X uses, as records name them; errors as ``stored_offsets``."""
    found = stored_offsets()
    if found is None:
        return Part(_ROLE, "zero, not measured", "none")
    licence = f"as SMPL-X and {found.dataset}"
    return Part(_ROLE, found.title, licence, file_sha256(offsets_file()))

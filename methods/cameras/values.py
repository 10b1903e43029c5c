"""What an estimate of cameras is made from, and what it says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from harness.core.arrays import Bytes, Floats
from harness.core.camera import Camera
from harness.core.errors import DataError
from harness.core.typed_json import to_json

#: Without any word of a lens: phones' main cameras, in longer sides of the picture, and how far
#: lenses are from them.
_USUAL_FOCAL, _USUAL_SD = 1.1, 0.35
#: An estimate reports as many steps as there are photos and so many more, at most.
STEPS = 5
#: What photos of a person cannot tell.
GAUGE = (
    "the scale is from the person's height, the world's upright from the cameras and the person, "
    "its front from the person, and its origin is the middle of the person's hull"
)


@dataclass(frozen=True, slots=True, eq=False)
class PhotoView:
    """One upright photo with its mask.

    Attributes:
        name: As messages name it, such as its file's name.
        rgba: (H, W, 4) uint8: sRGB colour, not premultiplied, and coverage of the subject.
    """

    name: str
    rgba: Bytes

    def __post_init__(self) -> None:
        if self.rgba.ndim != 3 or self.rgba.shape[2] != 4 or self.rgba.dtype != np.uint8:
            raise DataError(
                f"{self.name} is not a photo with a mask",
                expected="(H, W, 4) of eight bits",
                got=f"{self.rgba.shape} of {self.rgba.dtype}",
            )

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        return self.rgba.shape[1], self.rgba.shape[0]


@dataclass(frozen=True, slots=True)
class Focal:
    """What is known of the focal lengths. Principal points are taken to be the pictures' middles.

    Attributes:
        px: Focal length of each photo, pixels.
        relative_sd: By how much all of them may be wrong, by one common factor; 0 holds them.
    """

    px: tuple[float, ...]
    relative_sd: float = 0.0

    def __post_init__(self) -> None:
        if not all(np.isfinite(px) and px > 0 for px in self.px) or not 0 <= self.relative_sd <= 1:
            raise DataError(
                "focal lengths are not usable",
                expected="pixels above 0, and a relative error of 0 to 1",
                got=f"{self.px}, {self.relative_sd}",
            )

    @classmethod
    def unknown(cls, photos: Sequence[PhotoView]) -> Focal:
        """Of one camera whose lens nobody knows: a usual one, to be found."""
        return cls(tuple(_USUAL_FOCAL * max(photo.size) for photo in photos), _USUAL_SD)


@dataclass(frozen=True, slots=True)
class StageReport:
    """What one stage did.

    Attributes:
        name: ``landmarks``, ``outlines``, ``photos 1`` and so on.
        time_s: Wall time.
        residuals: What is left after it, by name; names carry the unit.
        gain: Share of the stage's own cost that it took away, 0 to 1.
    """

    name: str
    time_s: float
    residuals: dict[str, float]
    gain: float


@dataclass(frozen=True, slots=True)
class PhotoReport:
    """What is left in one photo.

    Attributes:
        name: The photo's.
        outline_px: Root mean square by which its contour's rays miss the others' hull, pixels.
        matches: Points that it has in common with its neighbours.
        match_px: Median distance of these from where the cameras have them, pixels; NaN of few.
        left_out: Why it has no camera; empty where it has one.
    """

    name: str
    outline_px: float
    matches: int
    match_px: float
    left_out: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class EstimatedCameras:
    """Cameras of photos, in their order; metres, +Y up, the person upright and facing +Z.

    Attributes:
        cameras: One for each photo; None for one that was left out.
        covariances: (6, 6) for each photo with a camera, of a turn (radians) and a shift (metres)
            in the camera's own axes, relative to the mean of all cameras; None for others.
        focal_px: Of each photo, pixels.
        focal_relative_sd: Of the common factor; 0 where focal lengths were given.
        stages: In order.
        photos: What is left in each.
        contradiction_mm: Median by which two pairs of photos place a point differently; NaN where
            too few do.
        warnings: What a reader of the numbers should know.
        gauge: What could not be observed, and how it was fixed.
    """

    cameras: tuple[Camera | None, ...]
    covariances: tuple[Floats | None, ...]
    focal_px: tuple[float, ...]
    focal_relative_sd: float
    stages: tuple[StageReport, ...]
    photos: tuple[PhotoReport, ...]
    contradiction_mm: float
    warnings: tuple[str, ...] = ()
    gauge: str = GAUGE

    @property
    def left_out(self) -> tuple[tuple[str, str], ...]:
        """Name and reason of each photo without a camera."""
        return tuple((photo.name, photo.left_out) for photo in self.photos if photo.left_out)

    @property
    def turn_sds_deg(self) -> dict[str, float]:
        """How sure cameras are: standard deviations of their turns, degrees, by photo."""
        own = zip(self.photos, self.covariances, strict=True)
        return {p.name: float(turn_sds_deg(each)) for p, each in own if each is not None}

    @property
    def turn_sd_deg(self) -> float:
        """Their median."""
        return float(np.median(list(self.turn_sds_deg.values())))

    @property
    def remarks(self) -> tuple[str, ...]:
        """The warnings, and which photos were left out, a sentence each."""
        return (*self.warnings, *(f"{name} was left out: {why}" for name, why in self.left_out))

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values of everything but the cameras, for a capture's provenance."""
        told = {each.name: getattr(self, each.name) for each in fields(self)}
        told["turn_sd_deg"] = self.turn_sd_deg
        del told["cameras"], told["warnings"]
        shown: dict[str, object] = _rounded(to_json(told))
        return shown


def turn_sds_deg(covariances: Floats) -> Floats:
    """(...) standard deviations of turns, degrees, of covariances (..., 6, 6)."""
    squares = np.trace(covariances[..., :3, :3], axis1=-2, axis2=-1)
    return np.degrees(np.sqrt(squares))


def _rounded(value: Any) -> Any:
    """JSON values with five digits of each number, and none that JSON does not have."""
    if isinstance(value, dict):
        return {name: _rounded(entry) for name, entry in value.items()}
    if isinstance(value, list | np.ndarray):
        return [_rounded(entry) for entry in value]
    if isinstance(value, float):
        return float(f"{value:.5g}") if np.isfinite(value) else None
    return value

"""What a real camera does to a photo, and calibration to a camera: stated, not hidden."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from harness.core.errors import DataError


@dataclass(frozen=True, slots=True)
class PhotoFaults:
    """How photos and cameras differ from exact ones. Masks stay exact.

    Attributes:
        noise: Standard deviation of the sensor's noise at middle grey, in levels of 255; shot noise
            grows with the square root of the light.
        blur_px: Standard deviation of the lens' blur, pixels.
        exposure_stops: Standard deviation of the exposure from view to view, in stops.
        jpeg_quality: Quality of the compression, 1 to 100 as Pillow counts; 0 does not compress.
        calibration_px: Root mean square of the re-projection error over the subject's box, of the
            cameras that methods are given; the photos are taken with the exact ones.
    """

    __pydantic_config__: ClassVar[dict[str, str]] = {"extra": "forbid"}

    noise: float = 0.0
    blur_px: float = 0.0
    exposure_stops: float = 0.0
    jpeg_quality: int = 0
    calibration_px: float = 0.0

    def __post_init__(self) -> None:
        ranges = {
            "noise": 50.0,
            "blur_px": 20.0,
            "exposure_stops": 3.0,
            "jpeg_quality": 100.0,
            "calibration_px": 50.0,
        }
        for name, most in ranges.items():
            if not 0 <= getattr(self, name) <= most:
                raise DataError(
                    f"photos cannot be taken with {name} {getattr(self, name)}",
                    expected=f"0 to {most:g}",
                )

    @property
    def changes_pictures(self) -> bool:
        """Whether the pictures differ from exact ones."""
        return any((self.noise, self.blur_px, self.exposure_stops, self.jpeg_quality))

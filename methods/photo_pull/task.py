"""What is asked of a capture's photos."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass

from harness.core.arrays import Floats
from methods.body.result import BodyFitResult
from methods.stereo.settings import StereoSettings


@dataclass(frozen=True, slots=True, eq=False)
class StereoTask:
    """What is asked of the photos.

    Attributes:
        views: Indices of the photos that are used.
        hands: (N, 3) places, world metres, near which points do not count: fingers are thinner than
            a window.
        settings: How points are found, kept and followed.
        narrow: Whether a short search in full resolution finishes the surface.
        is_shared: Whether other methods ask for the points around the same start.
    """

    views: Sequence[int]
    hands: Floats
    settings: StereoSettings
    narrow: bool = True
    is_shared: bool = False


def hands_of(fitted: BodyFitResult) -> Floats:
    """(N, 3) vertices of the fitted body's hands, world metres."""
    return fitted.body.vertices[fitted.regions["left_hand"] | fitted.regions["right_hand"]]


def stereo_parameters(settings: StereoSettings) -> dict[str, dict[str, object]]:
    """The settings by room, as methods state them.

    ``match``, ``keep``, ``narrow`` and ``pulls``, and ``dents`` and ``cameras`` where these are
    filled and corrected.
    """
    more = [name for name in ("dents", "cameras") if getattr(settings, name)]
    names = ("match", "keep", "narrow", *more)
    rooms: dict[str, dict[str, object]] = {name: asdict(getattr(settings, name)) for name in names}
    rounds: dict[str, object] = {
        f"round_{number}": asdict(each) for number, each in enumerate(settings.pulls, start=1)
    }
    return {**rooms, "pulls": rounds}

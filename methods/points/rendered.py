"""A source that is never wrong: the scan's own depth, with noise of a stated size.

It shows what alignment, filtering and meshing lose by themselves: the ceiling of every other
source. Its cameras are in a world of its own, turned, scaled and shifted at random, so that the
alignment has something to find.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from harness.core.arrays import Floats
from harness.core.cameras.camera import Camera
from harness.core.errors import MethodError
from harness.core.files.hashing import derive_seed
from harness.core.privileges import Privilege
from harness.core.protocols import Part
from harness.core.settings import check_range
from harness.geometry.raycast import Raycaster
from methods.points.alignment import ALIGNMENTS, Similarity
from methods.points.frames import Frame
from methods.points.sources import Estimate, SourceRequest, ViewDepth

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

#: The own world's unit in metres is between 1 / this and this.
_LARGEST_UNIT = 5.0


@dataclass(frozen=True, slots=True)
class DepthSettings:
    """The depth maps.

    Attributes:
        longest_px: Longest side of the depth maps, pixels; photos are never enlarged.
        noise: Standard deviation of the depth's error, as a share of the depth: 0.01 is 3 cm at
            3 m.
        noise_px: Over which length the error is smooth, pixels; 0 makes each pixel's its own.
    """

    longest_px: int = 960
    noise: float = 0.0
    noise_px: float = 0.0

    def __post_init__(self) -> None:
        for name, least, most in (
            ("longest_px", 16, 8192),
            ("noise", 0.0, 0.5),
            ("noise_px", 0.0, 500.0),
        ):
            check_range(name, getattr(self, name), least, most)


@dataclass(frozen=True, slots=True)
class RenderedDepth:
    """Depth of the scan in the photos' own cameras."""

    settings: DepthSettings = DepthSettings()

    @property
    def title(self) -> str:
        """For tables."""
        noise = self.settings.noise
        return f"Depth of the scan{f' with {noise:.1%} noise' if noise else ''}"

    @property
    def rooms(self) -> dict[str, DataclassInstance]:
        """Its settings."""
        return {"depth": self.settings}

    @property
    def parts(self) -> tuple[Part, ...]:
        """None."""
        return ()

    @property
    def privileges(self) -> tuple[Privilege, ...]:
        """The scan itself."""
        return (Privilege.GROUND_TRUTH_MESH,)

    @property
    def alignments(self) -> tuple[str, ...]:
        """All of them."""
        return ALIGNMENTS

    def with_rooms(self, rooms: dict[str, DataclassInstance]) -> RenderedDepth:
        """The same with other settings."""
        settings = rooms["depth"]
        assert isinstance(settings, DepthSettings)
        return RenderedDepth(settings)

    def require_installed(self) -> None:
        """Always."""

    def estimate(self, request: SourceRequest) -> Estimate:
        """The scan's depth, noisy where that is set, in a world of its own."""
        if request.truth is None:
            raise MethodError(
                "the scan was not lent", expected="the privilege 'ground truth mesh'", got="nothing"
            )
        rng = np.random.default_rng(derive_seed(request.seed, "world"))
        own = Similarity(1.0, np.eye(3), np.zeros(3)) if request.give_cameras else _somewhere(rng)
        caster = Raycaster(request.truth)
        views: list[ViewDepth] = []
        for view, photo in zip(request.views, request.photos, strict=True):
            frame = self._frame(photo.camera)
            camera = frame.camera(photo.camera)
            noise = np.random.default_rng(derive_seed(request.seed, "noise", str(view)))
            depth = self._noisy(caster.depth(camera), noise)
            views.append(ViewDepth(frame, own.camera(camera), own.scale * depth))
        return Estimate(tuple(views), {"noise": self.settings.noise})

    def _frame(self, camera: Camera) -> Frame:
        share = min(1.0, self.settings.longest_px / max(camera.size))
        width, height = (max(1, round(share * side)) for side in camera.size)
        return Frame.whole(camera.size, (width, height))

    def _noisy(self, depth: Floats, rng: np.random.Generator) -> Floats:
        if self.settings.noise == 0:
            return depth
        errors = rng.standard_normal(depth.shape)
        if self.settings.noise_px > 0:
            from scipy.ndimage import gaussian_filter

            errors = np.asarray(gaussian_filter(errors, self.settings.noise_px, mode="wrap"))
            errors /= errors.std()
        return depth * (1.0 + self.settings.noise * errors)


def _somewhere(rng: np.random.Generator) -> Similarity:
    """From the world to one of its own: any turn, any place, and another unit."""
    turn, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    scale = float(np.exp(rng.uniform(-1, 1) * np.log(_LARGEST_UNIT)))
    return Similarity(scale, turn, rng.uniform(-1.0, 1.0, 3))

"""What a source of points is asked, and what it answers: depth and cameras of each view."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np

from harness.core.arrays import Floats
from harness.core.camera import Camera
from harness.core.errors import MethodError
from harness.core.files.hashing import derive_seed
from harness.core.mesh import Mesh
from harness.core.protocols import Part, Privilege
from harness.core.settings import check_range
from harness.geometry.photo import Photo
from harness.geometry.raycast import Raycaster
from harness.geometry.similarity import Similarity
from methods.points.alignment import ALIGNMENTS
from methods.points.cloud import Frame

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


@dataclass(frozen=True, slots=True, eq=False)
class SourceRequest:
    """What a source may see.

    Attributes:
        views: Indices of the photos, counted from the front.
        photos: One for each view, each with its camera.
        give_cameras: Whether the source is to work with the photos' cameras (``native_posed``); a
            source that is not must not look at them.
        seed: For this method and subject.
        workdir: Folder for intermediate files.
        truth: The scan's surface, for a source with that privilege; else None.
    """

    views: tuple[int, ...]
    photos: Sequence[Photo]
    give_cameras: bool
    seed: int
    workdir: Path
    truth: Mesh | None = None


@dataclass(frozen=True, slots=True, eq=False)
class ViewDepth:
    """What a source says of one view, in a world and a unit of its own.

    Attributes:
        frame: How its pixels belong to the photo's.
        camera: Camera of these pixels, in the source's own world and unit.
        depth: (H, W) along the optical axis; not finite or not positive where it says nothing.
        confidence: (H, W), larger is better, in any unit; None where the source has none.

    Raises:
        MethodError: maps that are not of the frame's size.
    """

    frame: Frame
    camera: Camera
    depth: Floats
    confidence: Floats | None = None

    def __post_init__(self) -> None:
        width, height = self.frame.size
        for name, array in (("depth", self.depth), ("confidence", self.confidence)):
            if array is not None and array.shape != (height, width):
                raise MethodError(
                    f"a {name} map does not fit its picture",
                    expected=f"shape {(height, width)}",
                    got=f"shape {np.shape(array)}",
                )


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """What a source says of all views.

    Attributes:
        views: One entry for each photo asked about, in the same order.
        details: What a reader of the record should know, as JSON values.
    """

    views: tuple[ViewDepth, ...]
    details: dict[str, object] = field(default_factory=dict[str, object])


class PointSource(Protocol):
    """Gives depth and cameras of each view."""

    @property
    def title(self) -> str:
        """A few words for a table."""
        ...

    @property
    def needs_perspective(self) -> str:
        """As in ``MethodInfo``."""
        ...

    @property
    def rooms(self) -> dict[str, DataclassInstance]:
        """The source's own settings, by room."""
        ...

    @property
    def parts(self) -> tuple[Part, ...]:
        """Learned or licensed ingredients, as far as they are installed."""
        ...

    @property
    def privileges(self) -> tuple[Privilege, ...]:
        """What it is given beyond photos, masks and cameras."""
        ...

    @property
    def alignments(self) -> tuple[str, ...]:
        """Those of ``alignment.ALIGNMENTS`` that make sense for it; the first is the default."""
        ...

    def with_rooms(self, rooms: dict[str, DataclassInstance]) -> PointSource:
        """The same source with other settings."""
        ...

    def require_installed(self) -> None:
        """Nothing, if it can run here.

        Raises:
            MissingPart: with the command that installs what is missing.
            MethodError: this machine cannot hold it.
        """
        ...

    def estimate(self, request: SourceRequest) -> Estimate:
        """Depth and cameras of the photos.

        Raises:
            MissingPart, MethodError: as ``require_installed``, or it failed.
        """
        ...


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
    def needs_perspective(self) -> str:
        """Nothing: rays of either kind meet the scan."""
        return ""

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

"""What a source of points is asked, and what it answers: depth and cameras of each view."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np

from harness.core.arrays import Floats
from harness.core.cameras.camera import Camera
from harness.core.errors import MethodError
from harness.core.mesh import Mesh
from harness.core.privileges import Privilege
from harness.core.protocols import Part
from harness.geometry.photo import Photo
from methods.points.frames import Frame

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

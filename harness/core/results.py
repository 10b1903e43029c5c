"""What a method may return in place of a mesh: depth maps, a cloud of points, or Gaussians.

The harness makes each a surface by the same steps, so that rows differ in the method and not in the
meshing. A method whose world is its own gives its cameras there; the rest is world metres.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from harness.core.arrays import Floats
from harness.core.camera import Camera
from harness.core.errors import DataError, MethodError


@dataclass(frozen=True, slots=True)
class PhotoFrame:
    """A picture made of a photo by resizing it, then shifting it into another frame.

    Attributes:
        photo: Width and height of the photo, pixels.
        resized: Width and height that the whole photo was resized to.
        shift: Where its left and top edges are in the picture; negative where they are cut off.
        size: Width and height of the picture.
    """

    photo: tuple[int, int]
    resized: tuple[int, int]
    shift: tuple[int, int]
    size: tuple[int, int]

    @classmethod
    def whole(cls, photo: tuple[int, int], size: tuple[int, int]) -> PhotoFrame:
        """The whole photo at another size."""
        return cls(photo, size, (0, 0), size)

    def camera(self, camera: Camera) -> Camera:
        """The photo's camera, on the picture's pixels.

        Raises:
            DataError: a camera of another photo size.
        """
        if camera.size != self.photo:
            raise DataError(
                "a camera does not fit its photo",
                expected=f"{self.photo[0]} x {self.photo[1]} pixels",
                got=f"{camera.width} x {camera.height}",
            )
        left, top = self.shift
        return camera.resized(*self.resized).cropped(-left, -top, *self.size)


@dataclass(frozen=True, slots=True, eq=False)
class ViewDepth:
    """What a method says of one view.

    Attributes:
        frame: How its pixels belong to the photo's.
        camera: Camera of these pixels, in the method's own world and unit.
        depth: (H, W) along the optical axis; not finite or not positive where it says nothing.
        confidence: (H, W), larger is better, in any unit; None where there is none.

    Raises:
        MethodError: maps that are not of the frame's size.
    """

    frame: PhotoFrame
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
class DepthMaps:
    """Depth of each view that the method takes, in their order.

    Attributes:
        views: One entry for each photo.
        details: What a reader of the record should know, as JSON values.
    """

    views: tuple[ViewDepth, ...]
    details: Mapping[str, object] = field(default_factory=dict[str, object])


@dataclass(frozen=True, slots=True, eq=False)
class PointCloud:
    """Points of a surface.

    Attributes:
        positions: (N, 3).
        normals: (N, 3) outwards, of any length; None where there are none.
        cameras: The method's own camera of each photo, if its world is its own; else None.
        details: As in ``DepthMaps``.

    Raises:
        MethodError: other shapes, or numbers that are not finite.
    """

    positions: Floats
    normals: Floats | None = None
    cameras: tuple[Camera, ...] | None = None
    details: Mapping[str, object] = field(default_factory=dict[str, object])

    def __post_init__(self) -> None:
        count = len(self.positions)
        _require("positions", self.positions, (count, 3))
        if self.normals is not None:
            _require("normals", self.normals, (count, 3))


@dataclass(frozen=True, slots=True, eq=False)
class Gaussians:
    """Gaussians of a splatted scene, isotropic, long or flat.

    Attributes:
        centres: (N, 3).
        scales: (N, 3) standard deviations along their own axes; 0 along the normal of a flat one.
        rotations: (N, 4) unit quaternions w, x, y, z from their own axes to the world's.
        opacities: (N,) from 0 to 1.
        cameras: As in ``PointCloud``.
        details: As in ``DepthMaps``.

    Raises:
        MethodError: other shapes, or numbers that are not finite.
    """

    centres: Floats
    scales: Floats
    rotations: Floats
    opacities: Floats
    cameras: tuple[Camera, ...] | None = None
    details: Mapping[str, object] = field(default_factory=dict[str, object])

    def __post_init__(self) -> None:
        count = len(self.centres)
        for name, width in (("centres", 3), ("scales", 3), ("rotations", 4)):
            _require(name, getattr(self, name), (count, width))
        _require("opacities", self.opacities, (count,))

    def axes(self) -> Floats:
        """(N, 3, 3) rotations whose columns are the Gaussians' own axes."""
        w, x, y, z = (self.rotations / np.linalg.norm(self.rotations, axis=1, keepdims=True)).T
        rows = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
        return np.moveaxis(np.array(rows), 2, 0)


Unmeshed = DepthMaps | PointCloud | Gaussians


def _require(name: str, values: Any, shape: tuple[int, ...]) -> None:
    array = np.asarray(values)
    if array.shape != shape or not shape[0] or not np.isfinite(array).all():
        raise MethodError(
            f"the {name} of a result are not usable",
            expected=f"finite, shape {shape}, at least one row",
            got=f"shape {array.shape}",
        )

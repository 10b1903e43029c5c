"""A subject's silhouettes, how far points are from an outline, and how far inside the hull."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from harness.core.arrays import Floats, Mask, Singles
from harness.core.camera import Camera
from harness.core.mesh import Mesh
from harness.geometry.images import resampled, sampled
from harness.geometry.window import Window


@dataclass(frozen=True, eq=False)
class Outline:
    """What one camera sees of where the subject is.

    A pixel belongs to the subject where its coverage is above one half. Beyond the frame nothing is
    known: there the silhouette goes on as it is at the border, so that a subject that the frame
    cuts does not end there.

    Attributes:
        camera: Of exactly these pixels.
        coverage: (H, W) share of each pixel that the subject covers, 0 to 1.
    """

    camera: Camera
    coverage: Floats

    @cached_property
    def mask(self) -> Mask:
        """(H, W) where the subject is."""
        return self.coverage > 0.5

    @property
    def is_empty(self) -> bool:
        """Whether the view shows no subject."""
        return not self.mask.any()

    @property
    def box(self) -> Window:
        """The least window that holds the subject, which must not be empty."""
        return Window.around(self.mask)

    @cached_property
    def distance_px(self) -> Singles:
        """(H, W) signed distance of pixel centres to the outline, pixels; positive inside.

        Within a pixel of the outline it is what coverage says, exact where the outline is straight
        and along the pixels.
        """
        far = np.where(self.mask, inner_depth_px(self.mask), -inner_depth_px(~self.mask))
        # Between the centres of two pixels the outline runs where coverage says, not half-way.
        sub_pixel = np.clip(self.coverage - 0.5, -0.5, 0.5)
        return np.where(np.abs(far) < 1.0, sub_pixel, far).astype(np.float32)

    def distance_m(self, points_world: Floats) -> Singles:
        """(N,) signed distance of world points to the silhouette's cone, metres at their depth.

        Positive inside. Points must be in front of the camera.
        """
        pixels, depth = self.camera.project(points_world)
        distance = sampled(self.distance_px, pixels)
        return (distance * self.camera.spread(depth) / self.camera.K[0, 0]).astype(np.float32)

    def holds(self, points_world: Floats) -> Mask:
        """(N,) whether world points are seen within the subject, to whole pixels.

        Beyond the frame and behind the camera all are: nothing says that the subject ends there.
        """
        pixels, _ = self.camera.project(points_world)
        with np.errstate(invalid="ignore"):  # behind the camera: NaN, so not in the frame
            framed = ((pixels >= 0) & (pixels < self.camera.size)).all(axis=1)
        columns, rows = pixels[framed].astype(np.int64).T
        held = np.ones(len(points_world), dtype=bool)
        held[framed] = self.mask[rows, columns]
        return held

    def cropped(self, window: Window) -> Outline:
        """The silhouette in a window inside the picture."""
        return Outline(window.camera(self.camera), self.coverage[window.slices])

    def resized(self, width: int, height: int) -> Outline:
        """The silhouette on other pixels; a larger one is the mean of those that it covers."""
        coverage = resampled(self.coverage, (width, height), "box")
        return Outline(self.camera.resized(width, height), coverage)


def inner_depth_px(mask: Mask) -> Floats:
    """(H, W) distance of the centres of a mask's pixels to its outline, pixels; -0.5 outside.

    Beyond the frame the mask goes on as it is at the border. Where it is the whole picture there is
    no outline, and all is width plus height deep.
    """
    from scipy.ndimage import distance_transform_edt

    if mask.all():
        return np.full(mask.shape, float(sum(mask.shape)))
    padded = np.pad(mask, 1, mode="edge")
    depth = np.asarray(distance_transform_edt(padded), dtype=np.float64)
    return depth[1:-1, 1:-1] - 0.5


def hull_distance(
    distances_m: Sequence[Callable[[Floats], Floats | Singles]], points: Floats, outside_m: float
) -> Singles:
    """(N,) least signed distance of world points to all silhouettes' cones, metres.

    Positive inside. A point that is further than ``outside_m`` outside one silhouette is not asked
    of the next ones: its value is then an upper bound.

    Args:
        distances_m: For each silhouette, the function that gives the signed distances (N,) of
            world points (N, 3) to its cone, metres, positive inside.
        points: (N, 3) world metres.
        outside_m: See above; not negative.
    """
    distance = np.full(len(points), np.inf, dtype=np.float32)
    asked = np.arange(len(points))
    for distance_m in distances_m:
        distance[asked] = np.minimum(distance[asked], distance_m(points[asked]))
        asked = asked[distance[asked] > -outside_m]
    return distance


def isosurface(
    field: Singles,
    *,
    level: float = 0.0,
    outside: float,
    origin: Floats | float = 0.0,
    step: float = 1.0,
    source: str,
) -> Mesh:
    """The surface around what is above a level, facing outwards; marching cubes.

    Args:
        field: (X, Y, Z) values; some are above the level, and some are not.
        level: The value on the surface.
        outside: A value below the level, which the field has beyond the lattice, so that the
            surface is closed there.
        origin: (3,) place of the lattice's first point.
        step: Between the lattice's points, in the unit of ``origin``.
        source: What the mesh calls itself.
    """
    from skimage.measure import marching_cubes

    padded = np.pad(field, 1, constant_values=outside)
    vertices, faces, _, _ = marching_cubes(padded, level=level, spacing=(step,) * 3)
    placed = vertices.astype(np.float64) + origin - step
    mesh = Mesh(placed, faces, source=source)
    return mesh if mesh.signed_volume >= 0 else Mesh(placed, faces[:, ::-1], source=source)

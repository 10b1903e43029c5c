"""The colours of a surface's vertices from all photos that show it.

Each vertex takes its colour mostly from the photo that shows it best, so that two photos that do
not meet exactly do not blur each other; that photo is first brought to the others by a gain and a
smooth correction, so that no seam shows where the best photo changes. What no photo shows is
continued from around.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from harness.core.arrays import Floats, Singles
from harness.core.errors import DataError
from harness.core.formats.coloured_mesh import ColouredMesh
from harness.core.mesh import Mesh
from harness.geometry.colours.levelling import blended, corrections, gains
from harness.geometry.colours.sights import Sight, linear_light, sight_of
from harness.geometry.colours.smoothing import SurfaceGraph
from harness.geometry.images import srgb_from_linear
from harness.geometry.photo import Photo
from harness.geometry.raycast import Raycaster

__all__ = ["Colouring", "coloured"]

#: The power of a photo's worth in the blend: high takes the best, low the mean.
_SHARPNESS = 6.0
#: Colour of a mesh that no photo shows, linear.
_GREY = 0.2


def coloured(mesh: Mesh, photos: Sequence[Photo]) -> ColouredMesh:
    """The mesh with a colour for each vertex, in the photos' mean exposure.

    Args:
        mesh: World metres, wound outward.
        photos: Any number, of any sizes; their cameras see the same world.

    Raises:
        DataError: no photo.
    """
    if not photos:
        raise DataError(f"{mesh.source} cannot be coloured without photos", expected="at least one")
    colouring = Colouring(mesh, photos)
    return colouring.from_photos(range(len(photos)))


class Colouring:
    """A mesh and what each of some photos shows of it: colours from any choice of the photos."""

    def __init__(self, mesh: Mesh, photos: Sequence[Photo]) -> None:
        self.mesh = mesh
        self.graph = SurfaceGraph(mesh)
        self.caster = Raycaster(mesh.geometry())
        self.sights = tuple(
            sight_of(photo, self.caster, self.graph.positions, self.graph.normals)
            for photo in photos
        )

    def from_photos(self, chosen: Sequence[int]) -> ColouredMesh:
        """The mesh with colours from some of the photos, by their index."""
        sights = [self.sights[index] for index in chosen]
        light, total = _light(sights, self.graph)
        seen = total > 0
        colours = srgb_from_linear(
            linear_light(light) if seen.any() else np.full_like(light, _GREY)
        )
        colours = self.graph.filled(colours, seen)
        pixels = np.round(255.0 * np.clip(colours, 0.0, 1.0)).astype(np.uint8)
        return ColouredMesh(self.mesh, pixels[self.graph.place], seen[self.graph.place])


def _light(sights: Sequence[Sight], graph: SurfaceGraph) -> tuple[Floats, Floats]:
    """(count, 3) logarithm of light at each place, and (count,) weight: 0 where no photo shows."""
    added = gains(sights)
    levelled: list[Singles] = [
        sight.light + gain.astype(np.float32) for sight, gain in zip(sights, added, strict=True)
    ]
    smooth = corrections(sights, levelled, graph)
    lights = [light + change for light, change in zip(levelled, smooth, strict=True)]
    best = np.zeros(graph.count, dtype=np.float32)
    for sight in sights:
        best[sight.places] = np.maximum(best[sight.places], sight.worth)
    sharp = [(sight.worth / best[sight.places]) ** _SHARPNESS for sight in sights]
    return blended(sights, lights, sharp, graph.count)

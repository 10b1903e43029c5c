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

#: The power of a photo's worth in the blend: high takes the best, low the mean.
_SHARPNESS = 6.0
#: How far a photo's light may be from the others', as a logarithm, before it is doubted.
_DOUBT = 0.25
_ROUNDS = 4
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
    believed = _believed(sights, lights, graph.count)
    best = np.zeros(graph.count, dtype=np.float32)
    for sight, worth in zip(sights, believed, strict=True):
        best[sight.places] = np.maximum(best[sight.places], worth)
    sharp = [
        (worth / best[sight.places]) ** _SHARPNESS
        for sight, worth in zip(sights, believed, strict=True)
    ]
    return blended(sights, lights, sharp, graph.count)


def _believed(sights: Sequence[Sight], lights: Sequence[Singles], count: int) -> list[Singles]:
    """(N,) the worth of each photo at each place, less where it is alone with its colour.

    A photo in which something else lies before the place, because the surface is not exactly where
    it should be, shows another colour than the others do.
    """
    believed = [sight.worth for sight in sights]
    for _ in range(_ROUNDS):
        middle, _ = blended(sights, lights, believed, count)
        believed = []
        for sight, light in zip(sights, lights, strict=True):
            apart = np.abs(light - middle[sight.places]).max(axis=1)
            trust = 1.0 / (1.0 + (apart / _DOUBT) ** 2) ** 2
            believed.append((sight.worth * trust).astype(np.float32))
    return believed

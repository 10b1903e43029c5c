"""Pictures of a mesh for figures: plain clay shading, and colours that stand for errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats
from harness.core.cameras.camera import Camera
from harness.core.errors import DataError
from harness.geometry.raycast import Raycaster

#: Towards the light from the surface, in the frame of maps: from the viewer's upper left.
_LIGHT = np.array([-0.35, 0.45, 0.82]) / np.linalg.norm([-0.35, 0.45, 0.82])
_AMBIENT = 0.25
_CLAY = np.array([0.80, 0.80, 0.84])
#: Rays along each side of a pixel.
_SUPERSAMPLE = 2


@dataclass(frozen=True, slots=True)
class ErrorScale:
    """Which colour stands for which error, shared by all panels of a figure.

    Attributes:
        limit: Error of the last colour; larger ones share it.
        label: What the errors are, with their unit.
        colours: Name of a matplotlib colour map.
    """

    limit: float
    label: str = "distance to the true surface (mm)"
    colours: str = "viridis"

    def __post_init__(self) -> None:
        if not self.limit > 0:
            raise DataError("an error scale has no range", expected="> 0", got=str(self.limit))

    def rgb(self, errors: Floats) -> Floats:
        """(..., 3) in [0, 1] for errors (...) in the limit's unit."""
        from matplotlib import colormaps

        share = np.clip(np.asarray(errors) / self.limit, 0.0, 1.0)
        return np.asarray(colormaps[self.colours](share))[..., :3]


def shaded(caster: Raycaster, camera: Camera) -> Floats:
    """(H, W, 4) in [0, 1]: the mesh as clay lit from the upper left; alpha is coverage."""
    fine = _finer(camera)
    hits = caster.cast(fine)
    normals = caster.normals_at(hits, fine, "camera")
    light = _AMBIENT + (1.0 - _AMBIENT) * np.clip(normals @ _LIGHT, 0.0, 1.0)
    return _coarser(light[..., None] * _CLAY, hits.mask)


def heat(caster: Raycaster, camera: Camera, errors_mm: Floats, scale: ErrorScale) -> Floats:
    """(H, W, 4) in [0, 1]: the mesh in the colours of its errors, unlit so that they can be read.

    Args:
        caster: Rays against the mesh.
        camera: The view.
        errors_mm: (V,) one error per vertex of the mesh, millimetres.
        scale: Colours of the errors.

    Raises:
        DataError: another number of errors than of vertices, or one that is not finite.
    """
    vertices = len(caster.mesh.vertices)
    if errors_mm.shape != (vertices,) or not np.isfinite(errors_mm).all():
        raise DataError(
            f"errors do not fit {caster.mesh.source}",
            expected=f"{vertices} finite numbers, one per vertex",
            got=f"shape {errors_mm.shape}, {int((~np.isfinite(errors_mm)).sum())} not finite",
        )
    hits = caster.cast(_finer(camera))
    at_hits = hits.interpolate(errors_mm[:, None], caster.mesh.faces)[..., 0]
    return _coarser(scale.rgb(at_hits), hits.mask)


def _finer(camera: Camera) -> Camera:
    return camera.resized(camera.width * _SUPERSAMPLE, camera.height * _SUPERSAMPLE)


def _coarser(rgb: Floats, mask: NDArray[np.bool_]) -> Floats:
    """Mean colour of the rays that meet the mesh, with their share as alpha."""
    height, width = (side // _SUPERSAMPLE for side in mask.shape)
    blocks = (height, _SUPERSAMPLE, width, _SUPERSAMPLE)
    alpha = mask.reshape(blocks).mean(axis=(1, 3))
    colour = (rgb * mask[..., None]).reshape(*blocks, 3).mean(axis=(1, 3))
    return np.dstack([colour / np.where(alpha > 0, alpha, 1.0)[..., None], alpha])

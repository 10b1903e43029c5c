"""What all figures share: photos on white, panels of one size, a canvas without a screen."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats
from harness.core.artifacts import Capture
from harness.core.camera import Camera
from harness.core.errors import DataError, HarnessError
from harness.core.files.atomic import atomic_path
from harness.core.mesh import Mesh
from harness.geometry.images import resampled
from harness.geometry.photo import WHITE, open_photo
from harness.geometry.raycast import Raycaster
from harness.geometry.window import Window

_DPI = 150
_MARGIN = 0.06
#: Room beside the panels for row labels and the colour bar, inches.
_SIDE_INCH = 1.2
_TITLE_INCH = 0.4
_UNDATED: Mapping[str, dict[str, None]] = {
    ".png": {},
    ".pdf": {"CreationDate": None},
    ".svg": {"Date": None},
}


@dataclass(frozen=True, slots=True)
class PanelWindow:
    """What a panel shows of a view.

    Attributes:
        window: The part of the view's picture; it may reach outside.
        most_height: What is taller is shown smaller: a panel has no more pixels than are printed.
    """

    window: Window
    most_height: int = 2**31

    @property
    def shown(self) -> tuple[int, int]:
        """Width and height of the panel, pixels."""
        width, height = self.window.size
        share = min(1.0, self.most_height / height)
        return max(1, round(share * width)), max(1, round(share * height))

    def of_camera(self, camera: Camera, least_height: int = 1) -> Camera:
        """The camera of the panel, enlarged by whole factors to at least some height in pixels."""
        width, height = self.shown
        factor = -(-min(least_height, self.most_height) // height)
        return self.window.camera(camera, (width * factor, height * factor))

    def of_image(self, image: Floats) -> Floats:
        """The panel of an image (H, W, 3), white where it reaches outside."""
        whole = self.window.cut(image, 1.0)
        return whole if self.shown == self.window.size else resampled(whole, self.shown, "box")


def panel_windows(scenes: Sequence[tuple[Mesh, Camera]], panel_inch: float) -> list[PanelWindow]:
    """A window round the mesh of each scene, all of one size so that all have one scale.

    Args:
        scenes: Meshes, world metres, and who looks at them.
        panel_inch: Height at which they are printed.
    """
    boxes = [Window.around_points(mesh.vertices, camera) for mesh, camera in scenes]
    border = round(_MARGIN * max(box.height for box in boxes))
    # At least one pixel, for a mesh that is in no picture at all.
    width = max(1, *(box.width + 2 * border for box in boxes))
    height = max(1, *(box.height + 2 * border for box in boxes))
    most_height = round(panel_inch * _DPI)
    return [PanelWindow(box.about_its_middle(width, height), most_height) for box in boxes]


def photo(capture: Capture, view: int) -> Floats:
    """(H, W, 3) in [0, 1]: a view of the capture on white.

    Raises:
        DataError: an image that is not usable.
    """
    return open_photo(capture, view).over(WHITE)


def on_white(rgba: Floats) -> Floats:
    """(H, W, 3) of an image (H, W, 4) in [0, 1]."""
    return rgba[..., :3] * rgba[..., 3:] + (1.0 - rgba[..., 3:])


def blended(
    image: Floats, clay: Floats, fill: float, tint: tuple[float, float, float] = (1.0, 1.0, 1.0)
) -> Floats:
    """An image (H, W, 3) with a shaded mesh (H, W, 4), tinted, over it; ``fill`` is its opacity."""
    opacity = fill * clay[..., 3:]
    return image * (1.0 - opacity) + clay[..., :3] * tint * opacity


def canvas(shape: tuple[int, int], window: Window, panel_inch: float) -> tuple[Any, Any]:
    """A figure and its axes, rows x columns, each ``panel_inch`` high, in a window's shape."""
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    rows, columns = shape
    width = columns * panel_inch * window.width / window.height
    figure = Figure(
        figsize=(width + _SIDE_INCH, rows * panel_inch + _TITLE_INCH),
        dpi=_DPI,
        layout=ConstrainedLayoutEngine(w_pad=0.01, h_pad=0.01, wspace=0.0, hspace=0.0),
    )
    axes = figure.subplots(rows, columns, squeeze=False)
    for axis in axes.flat:
        axis.set_xticks([])
        axis.set_yticks([])
        axis.set_frame_on(False)
    return figure, axes


def show(axis: Any, image: Floats) -> None:
    """Put an image (H, W, 3) in [0, 1] on an axis."""
    axis.imshow(np.clip(image, 0.0, 1.0), interpolation="antialiased")


def save(figure: Any, path: Path) -> None:
    """Write a figure atomically, without a date so that equal figures give equal files.

    Raises:
        HarnessError: an extension that is not of PNG, PDF or SVG.
        DataError: the file cannot be written.
    """
    suffix = path.suffix.lower()
    if suffix not in _UNDATED:
        raise HarnessError(
            f"cannot draw {path}", expected=" or ".join(_UNDATED), got=suffix or "no extension"
        )
    with atomic_path(path) as temporary:
        figure.savefig(temporary, metadata=_UNDATED[suffix])


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

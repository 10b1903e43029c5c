"""``hull8`` and ``hull``: the visual hull of eight or of all silhouettes.

It is a strong classical baseline under exact cameras.

A point belongs to the hull when every view sees it inside the silhouette (Laurentini 1994). The
field that is contoured is, at each point, the least over the views of its signed distance to the
silhouette's outline, in metres at the point's depth, so that the surface lies between voxels.

Before: ``renderers/blender/scene.py``. After: ``metrics/distance.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace

import numpy as np

from harness.core.arrays import Floats, Singles
from harness.core.artifacts import Capture, Reconstruction
from harness.core.errors import MethodError
from harness.core.mesh import Mesh
from harness.core.protocols import Context, MethodInfo, Privilege
from harness.core.settings import check_range, configured
from harness.geometry.coinciding import pieces_of
from harness.geometry.outline import Outline, hull_distance, isosurface
from harness.geometry.photo import open_photo
from harness.geometry.place import Place, place_of

#: What the settings are filed under, as in ``--set hull.voxel_m=0.002``.
_ROOM = "hull"
#: Views all round see a subject nearly as wide as it is; a few may look along it.
_WIDEST = 1.5
#: One silhouette bounds no volume.
_LEAST_VIEWS = 2


@dataclass(frozen=True, slots=True)
class HullSettings:
    """Settings of the visual hull.

    Attributes:
        voxel_m: Edge of a voxel, metres.
        block: Voxels along the edge of a coarse block; blocks far from every outline are not
            subdivided.
        margin_m: Free space around what the silhouettes span in the volume searched, metres.
        minimum_component: Pieces of less than this share of all faces are dropped.
    """

    voxel_m: float = 0.004
    block: int = 8
    margin_m: float = 0.1
    minimum_component: float = 0.01

    def __post_init__(self) -> None:
        check_range("voxel_m", self.voxel_m, 0.0005, 0.2, "metres")
        check_range("block", self.block, 1, 256, "voxels")
        check_range("margin_m", self.margin_m, 0.0, 2.0, "metres")
        check_range("minimum_component", self.minimum_component, 0.0, 1.0)


class VisualHull:
    """Carves a volume with the capture's masks and contours what is left."""

    def __init__(self, info: MethodInfo, settings: HullSettings) -> None:
        self.info = info
        self.settings = settings

    def configured(self, parameters: Mapping[str, str]) -> VisualHull:
        """The method with other settings, given as text by ``hull.setting``."""
        settings = configured({_ROOM: self.settings}, parameters)[_ROOM]
        return VisualHull(replace(self.info, parameters={_ROOM: asdict(settings)}), settings)

    def reconstruct(self, capture: Capture, context: Context) -> Reconstruction:
        """The hull of the masks of the method's views, in world metres.

        Raises:
            MethodError: only one photo, or no point is inside all silhouettes.
        """
        views = self.info.views or range(len(capture.cameras))
        if len(views) < _LEAST_VIEWS:
            raise MethodError(
                f"{self.info.name} needs photos from more than one side",
                expected=f"at least {_LEAST_VIEWS} views",
                got=f"{len(views)}",
                hint="For one photo use 'econ' or 'body-front'",
            )
        with context.stage("outlines"):
            outlines = [open_photo(capture, view).outline for view in views]
            place = place_of(outlines)
        with context.stage("carve"):
            origin, field = _carve(outlines, place, self.settings)
        with context.stage("contour"):
            mesh = _contour(origin, field, self.settings)
        return Reconstruction(mesh=mesh, details={"voxels": int(field.size)})


def hull_of(outlines: list[Outline], settings: HullSettings) -> Mesh:
    """The hull of silhouettes, in the world of their cameras.

    Raises:
        MethodError: no point is inside all of them.
    """
    return _contour(*_carve(outlines, place_of(outlines), settings), settings)


def _lattice(origin: Floats, counts: tuple[int, ...], step: float) -> Floats:
    """(N, 3) lattice points in C order; three counts."""
    axes = [origin[axis] + step * np.arange(counts[axis]) for axis in range(3)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def _carve(outlines: list[Outline], place: Place, settings: HullSettings) -> tuple[Floats, Singles]:
    """The field on fine voxels of the blocks that the surface may cross, and its first point."""
    edge = settings.voxel_m * settings.block
    half = _half_extent(place, settings.margin_m)
    corner = place.centre - half
    counts = tuple(int(n) for n in np.ceil(2 * half / edge))
    centres = _lattice(corner + edge / 2, counts, edge)
    # The distance to a cone changes by at most about the distance moved: half a block's diagonal
    # away, its sign cannot change. The factor covers the change of depth and the pixel grid.
    reach = 1.2 * edge * np.sqrt(3) / 2 + settings.voxel_m
    cones = [outline.distance_m for outline in outlines]
    coarse = hull_distance(cones, centres, reach).reshape(counts)
    active = np.argwhere(np.abs(coarse) <= reach)
    if not len(active):
        raise _nothing_in_common()
    low, high = active.min(axis=0), active.max(axis=0) + 1
    # Inside stays inside: whole blocks take the sign of their centre.
    window = coarse[low[0] : high[0], low[1] : high[1], low[2] : high[2]]
    field = np.repeat(
        np.repeat(np.repeat(window, settings.block, 0), settings.block, 1), settings.block, 2
    )
    origin = corner + low * edge + settings.voxel_m / 2
    offsets = _lattice(np.zeros(3), (settings.block,) * 3, 1.0).astype(np.int64)
    for chunk in np.array_split(active - low, max(1, len(active) // 2000)):
        index = (chunk[:, None, :] * settings.block + offsets[None]).reshape(-1, 3)
        points = origin + settings.voxel_m * index
        field[tuple(index.T)] = hull_distance(cones, points, 2 * settings.voxel_m)
    if not (field > 0).any():
        raise _nothing_in_common()
    return origin, field


def _nothing_in_common() -> MethodError:
    return MethodError(
        "the silhouettes have no common volume",
        expected="points that all photos see inside the subject's outline",
        got="none",
        hint="Check that each photo has its own camera and mask; 'harness render' proves cameras "
        "against the scan, 'harness capture import' against each other",
    )


def _half_extent(place: Place, margin_m: float) -> Floats:
    """(3,) half the edges of the volume searched, metres."""
    across = _WIDEST * place.half_width_m + margin_m
    return np.array([across, place.half_height_m + margin_m, across])


def _contour(origin: Floats, field: Singles, settings: HullSettings) -> Mesh:
    """Marching cubes at zero, closed at the volume's border, without crumbs."""
    step = settings.voxel_m
    mesh = isosurface(field, outside=-step, origin=origin, step=step, source="visual hull")
    return _without_crumbs(mesh, settings.minimum_component)


def _without_crumbs(mesh: Mesh, minimum_share: float) -> Mesh:
    pieces = pieces_of(mesh.faces, len(mesh.vertices))
    sizes = pieces.face_counts[pieces.of_face]
    return mesh.submesh(sizes >= minimum_share * len(mesh.faces))


def _of(name: str, title: str, views: tuple[int, ...] | None) -> VisualHull:
    return VisualHull(
        MethodInfo(
            name=name,
            title=title,
            views=views,
            privileges=(Privilege.KNOWN_CAMERAS, Privilege.EXACT_MASKS),
            parameters={_ROOM: asdict(HullSettings())},
        ),
        HullSettings(),
    )


hull8 = _of("hull8", "Visual hull, 8 views", tuple(range(8)))
hull = _of("hull", "Visual hull, all views", None)

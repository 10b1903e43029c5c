"""One sheet of pictures per subject: from photo to mesh, stage by stage, for a person to judge."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.core.arrays import Bytes, Floats
from harness.core.camera import Camera
from harness.core.mesh import Mesh
from harness.geometry.images import normal_colours
from harness.geometry.raycast import Raycaster
from methods.normals import ViewMaps

_TILE_PX = 480
#: As in the paper's figure: front green, back orange, completion purple; then the hands.
_COLOURS = ((0.55, 0.8, 0.5), (0.95, 0.65, 0.35), (0.65, 0.5, 0.85), (0.45, 0.65, 0.9))
_GREY = (0.78, 0.78, 0.78)
_TURNS_DEG = (0.0, 45.0, 90.0, 180.0)


@dataclass(frozen=True, slots=True, eq=False)
class Stages:
    """What a method made on its way.

    Attributes:
        maps: The maps of the views that sheets were made from.
        parts: The surfaces that went into the fusion: sheets, completion, hands.
        body: The fitted body.
        mesh: The result.
    """

    maps: Sequence[ViewMaps]
    parts: Sequence[Mesh]
    body: Mesh
    mesh: Mesh


def contact_sheet(stages: Stages) -> Bytes:
    """(H, W, 3) uint8 picture of the stages.

    For each view a row of photo, body normals, clothed normals of both sides; then rows of the
    body, the parts in the paper's colours and the mesh, seen from the front, 45 and 90 degrees to
    the side, and behind.
    """
    rows = [
        [
            maps.view.rgb + (1.0 - maps.view.mask[..., None]),
            normal_colours(maps.body_front),
            normal_colours(maps.front),
            normal_colours(maps.back),
        ]
        for maps in stages.maps
    ]
    front = stages.maps[0].view.camera.resized(_TILE_PX, _TILE_PX)
    cameras = [front.in_frame(_turned(angle)) for angle in _TURNS_DEG]
    for meshes, colours in (
        ([stages.body], (_GREY,)),
        (stages.parts, _COLOURS),
        ([stages.mesh], (_GREY,)),
    ):
        rows.append([shaded(meshes, colours, camera) for camera in cameras])
    width = _shown_width(stages.maps)
    pictures = [np.concatenate([_tile(tile, width) for tile in row], axis=1) for row in rows]
    return np.concatenate(pictures, axis=0)


def shaded(
    meshes: Sequence[Mesh], colours: Sequence[tuple[float, float, float]], camera: Camera
) -> Floats:
    """(H, W, 3) in [0, 1]: meshes in their colours on white, lit from the viewer; backs dark."""
    picture = np.ones((camera.height, camera.width, 3))
    nearest = np.full((camera.height, camera.width), np.inf)
    for mesh, colour in zip(meshes, colours, strict=False):
        caster = Raycaster(mesh)
        hits = caster.cast(camera)
        seen = hits.mask & (np.nan_to_num(hits.depth, nan=np.inf) < nearest)
        facing = caster.normals_at(hits, camera, "camera")[..., 2]
        light = np.where(facing >= 0, 0.25 + 0.75 * facing, 0.15)
        picture[seen] = light[seen, None] * colour
        nearest[seen] = hits.depth[seen]
    return picture


def _shown_width(all_maps: Sequence[ViewMaps]) -> float:
    """Share of a square's width that is worth showing: a standing person needs little of it."""
    shares = []
    for maps in all_maps:
        columns = np.flatnonzero(maps.view.mask.any(axis=0))
        half = maps.view.mask.shape[1] / 2
        shares.append(max(half - columns[0], columns[-1] + 1 - half) / half)
    return min(1.0, max(shares) + 0.04)


def _turned(angle_deg: float) -> Floats:
    """(4, 4) rotation of the world about its vertical axis, degrees."""
    angle = np.deg2rad(angle_deg)
    turn = np.eye(4)
    turn[0, 0] = turn[2, 2] = np.cos(angle)
    turn[0, 2], turn[2, 0] = np.sin(angle), -np.sin(angle)
    return turn


def _tile(picture: Floats, width: float) -> Bytes:
    from PIL import Image

    image = Image.fromarray(np.round(255 * np.clip(picture, 0, 1)).astype(np.uint8))
    pixels = np.asarray(image.resize((_TILE_PX, _TILE_PX), Image.Resampling.BOX))
    margin = round((1.0 - width) / 2 * _TILE_PX)
    return pixels[:, margin : _TILE_PX - margin]

"""The folder that a foreign method is given for one subject: pictures, cameras, a request.

    images/000.png ...   RGBA, alpha is coverage; without the privilege exact_masks RGB on grey
    transforms.json      nerfstudio's; only with the privilege known_cameras
    request.json         views, vertical axis, seed, settings; subject_centre_m where it is lent

Only the photos that the method declares are there, under their numbers from the front.
"""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from harness.core.arrays import Floats
from harness.core.artifacts import Capture
from harness.core.cameras.camera import Camera, rigid_inverse
from harness.core.cameras.frames import BLENDER_TO_WORLD, write_transforms_json
from harness.core.errors import MethodError
from harness.core.files.atomic import write_json
from harness.core.mesh import Mesh
from harness.core.privileges import Privilege
from harness.core.protocols import Context, MethodInfo
from harness.geometry.images import composite, load_rgba, save_png
from methods.foreign.method_file import MethodFile

_SCHEMA = 1
_GREY = (0.5, 0.5, 0.5)


def views_of(info: MethodInfo, count: int) -> tuple[int, ...]:
    """The views that a method is given of so many photos, counted from the front.

    Raises:
        MethodError: it takes others than there are.
    """
    if info.view_count is not None and info.view_count > count:
        raise _too_few(info, f"{info.view_count} photos", count)
    views = info.views_of(count)
    if max(views) >= count:
        raise _too_few(info, f"view {max(views)}", count)
    return views


def _too_few(info: MethodInfo, wanted: str, count: int) -> MethodError:
    return MethodError(
        f"method '{info.name}' takes {wanted}",
        got=f"{count} photos",
        hint="Use a recipe with more views",
    )


def write_photos(
    folder: Path, method: MethodFile, info: MethodInfo, capture: Capture, context: Context
) -> None:
    """Write what a method is given, and nothing else.

    Raises:
        MethodError: it takes others views than there are.
        DataError: a photo that cannot be read, or the disk refuses.
    """
    views = views_of(info, len(capture.cameras))
    names = [f"images/{view:03d}.png" for view in views]
    (folder / "images").mkdir(parents=True)
    for view, name in zip(views, names, strict=True):
        _write_photo(folder / name, capture, view, masked=Privilege.EXACT_MASKS in info.privileges)
    cameras = [capture.cameras[view] for view in views]
    if Privilege.KNOWN_CAMERAS in info.privileges:
        write_transforms_json(folder / "transforms.json", _turned(cameras, method.up), names)
    request: dict[str, object] = {
        "schema": _SCHEMA,
        "views": list(views),
        "images": names,
        "up": method.up,
        "unit": "metre",
        "settings": {room: dict(own) for room, own in info.parameters.items()},
    }
    if method.uses_seed:
        request["seed"] = context.seed
    centre = context.privileged.get(Privilege.SUBJECT_CENTRE)
    if centre is not None:
        request["subject_centre_m"] = _from_ours(np.asarray(centre), method.up).tolist()
    write_json(folder / "request.json", request)


def _write_photo(path: Path, capture: Capture, view: int, *, masked: bool) -> None:
    source = capture.image_path(view)
    if masked:
        shutil.copyfile(source, path)
        return
    picture = composite(load_rgba(source, capture.cameras[view].size), _GREY)
    save_png(path, np.round(255 * picture).astype(np.uint8))


def _turned(cameras: Sequence[Camera], up: str) -> list[Camera]:
    """Cameras whose ``transforms.json``, which is one of Blender's world, has poses in another."""
    if up == "+z":
        return list(cameras)
    turn = rigid_inverse(BLENDER_TO_WORLD)
    return [replace(each, world_to_camera=each.world_to_camera @ turn) for each in cameras]


def _from_ours(points: Floats, up: str) -> Floats:
    return points @ BLENDER_TO_WORLD[:3, :3] if up == "+z" else points


def in_our_world(mesh: Mesh, up: str) -> Mesh:
    """A mesh from the world that a method works in."""
    if up == "+y":
        return mesh
    return replace(mesh, vertices=mesh.vertices @ BLENDER_TO_WORLD[:3, :3].T)

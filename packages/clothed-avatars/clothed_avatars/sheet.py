"""A contact sheet of one avatar, for a person to judge: eight views, bare geometry, true body."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from clothed_avatars.mesh.quads import Floats
from harness.core.camera import Camera
from harness.core.files.npz import read_required_arrays
from harness.core.mesh import Mesh
from harness.core.rigs import RingRig
from harness.files.mesh_files import load_mesh
from harness.geometry.raycast import Raycaster

_VIEW_PX = (324, 576)
_PAPER = 0.97
_CLAY: Floats = np.array([0.66, 0.66, 0.70])
_BODY: Floats = np.array([0.80, 0.62, 0.52])
_KEY: Floats = np.array([-0.45, 0.65, 0.62])
_FINE = 2


def _shade(normals: Floats) -> Floats:
    """Light (H,W,1) on camera-frame normals: a key from the upper left, a fill from the viewer."""
    key = np.clip(normals @ (_KEY / np.linalg.norm(_KEY)), 0, 1)
    return (0.38 + 0.47 * key + 0.22 * np.clip(normals[..., 2], 0, 1))[..., None]


def _picture(caster: Raycaster, camera: Camera, colour: Floats, texture: Floats | None) -> Floats:
    """(H,W,3) in [0,1]: textured where there is a texture, else of one colour."""
    fine = camera.resized(camera.width * _FINE, camera.height * _FINE)
    hits = caster.cast(fine)
    mesh = caster.mesh
    light = _shade(caster.normals_at(hits, fine, "camera"))
    surface = np.broadcast_to(colour, (*hits.mask.shape, 3))
    if texture is not None and mesh.uv is not None and mesh.face_uv is not None:
        uv = hits.interpolate(mesh.uv, mesh.face_uv)
        size = np.array(texture.shape[1::-1])
        column, row = np.moveaxis(np.clip((uv * size).astype(int), 0, size - 1), -1, 0)
        surface = texture[texture.shape[0] - 1 - row, column]
    image = np.where(hits.mask[..., None], np.clip(surface * light, 0, 1), _PAPER)
    blocks = image.reshape(camera.height, _FINE, camera.width, _FINE, 3)
    return blocks.mean(axis=(1, 3))


def avatar_sheet(directory: Path, name: str) -> np.ndarray:
    """The sheet (H,W,3), 8-bit sRGB, of the avatar in a folder.

    Above: its eight views of the paper's rig with texture. Below: front, side and back as bare
    geometry, then the true body under it in the same views, and the head from near.

    Raises:
        DataError: the folder holds no avatar.
    """
    from PIL import Image

    mesh = load_mesh(directory / f"{name}.obj", texture=True)
    middle = mesh.bounds.mean(axis=0)
    to_centre = np.eye(4)
    to_centre[:3, 3] = -middle
    mesh = mesh.transformed(to_centre)
    with Image.open(directory / "material0.jpeg") as image:
        texture = np.asarray(image.convert("RGB"), float) / 255
    data = read_required_arrays(
        directory / "body.npz", ("vertices", "faces"), "avatar's body", "Make the avatar again"
    )
    body = Mesh(data["vertices"] - middle, data["faces"], source=f"body of {name}")
    outer, inner = Raycaster(mesh), Raycaster(body)
    cameras = RingRig().cameras(*_VIEW_PX)
    above = [_picture(outer, camera, _CLAY, texture) for camera in cameras]
    bare = [_picture(outer, cameras[k], _CLAY, None) for k in (0, 1, 2, 4)]
    under = [_picture(inner, cameras[k], _BODY, None) for k in (0, 2)]
    near = [_near(outer, mesh, cameras[k], texture) for k in (0, 1)]
    rows = [np.concatenate(above, axis=1), np.concatenate([*bare, *under, *near], axis=1)]
    return np.rint(np.concatenate(rows) * 255).astype(np.uint8)


def _near(caster: Raycaster, mesh: Mesh, camera: Camera, texture: Floats) -> Floats:
    """The same view, three times as near, of head and chest."""
    width, height = camera.width, camera.height
    top = mesh.vertices[mesh.vertices[:, 1].argmax()]
    pixel, _ = camera.project(np.array([[top[0], top[1] - 0.25, top[2]]]))
    K = camera.K.copy()
    K[:2] *= 3.0
    K[0, 2], K[1, 2] = (
        3.0 * (K[0, 2] / 3.0 - pixel[0, 0]) + width / 2,
        3.0 * (K[1, 2] / 3.0 - pixel[0, 1]) + height / 2,
    )
    closer = Camera(K=K, world_to_camera=camera.world_to_camera, width=width, height=height)
    return _picture(caster, closer, _CLAY, texture)

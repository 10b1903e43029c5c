"""A standing person of six boxes, with texture coordinates and with colours at its corners."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from harness.core.camera import Camera, look_at
from harness.core.mesh import Mesh
from harness.files.coloured_mesh import ColouredMesh, save_coloured
from harness.files.obj import write_obj
from harness.geometry.images import linear_from_srgb
from harness.geometry.photo import linear_texture, texture_at
from harness.geometry.raycast import Raycaster

#: Centre and half sides of head, trunk, arms and legs, as shares of the height.
BOXES = (
    ((0.0, 0.92, 0.0), (0.07, 0.08, 0.08)),
    ((0.0, 0.66, 0.0), (0.13, 0.18, 0.09)),
    ((-0.2, 0.62, 0.02), (0.045, 0.2, 0.045)),
    ((0.2, 0.62, 0.02), (0.045, 0.2, 0.045)),
    ((-0.08, 0.25, 0.0), (0.06, 0.25, 0.06)),
    ((0.08, 0.25, 0.0), (0.06, 0.25, 0.06)),
)
CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
SIDES = np.array(
    [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
)
TRIANGLES = np.concatenate([SIDES[:, [0, 1, 2]], SIDES[:, [0, 2, 3]]])


def box_person(height: float = 1.7) -> Mesh:
    """Boxes that face +Z and stand on the plane y = 0; the texture is projected from the front."""
    vertices = np.concatenate([np.add(centre, CORNERS * half) for centre, half in BOXES])
    faces = np.concatenate([TRIANGLES + 8 * number for number in range(len(BOXES))])
    uv = np.stack([vertices[:, 0] + 0.5, 0.05 + 0.9 * vertices[:, 1]], axis=1)
    return Mesh(vertices * height, faces, uv=uv, face_uv=faces)


def corner_colours(mesh: Mesh) -> np.ndarray:
    """(V, 3) uint8, another colour at each corner; those of a face are not far apart."""
    waves = np.sin(7.0 * mesh.vertices / mesh.extent.max() + np.array([0.0, 1.0, 2.0]))
    return np.round(127 + 100 * waves[:, [1, 0, 2]]).astype(np.uint8)


def ramp(size: int = 32) -> np.ndarray:
    """(size, size, 3) uint8: red grows to the right, green downward."""
    line = np.linspace(40, 230, size).astype(np.uint8)
    return np.stack(np.broadcast_arrays(line[None], line[:, None], np.uint8(120)), axis=-1)


def put_ply(path: Path, mesh: Mesh) -> None:
    """A PLY with vertex colours."""
    path.parent.mkdir(parents=True, exist_ok=True)
    save_coloured(path, ColouredMesh(mesh, corner_colours(mesh), np.ones(len(mesh.vertices), bool)))


def put_glb(path: Path, mesh: Mesh) -> None:
    """A GLB with vertex colours in linear light, 16 bits."""
    put_ply(path, mesh)


def put_obj(path: Path, mesh: Mesh, picture: str = "material0.png") -> None:
    """An OBJ with the ramp on it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_obj(path, mesh)
    (path.parent / "material0.mtl").write_text(f"newmtl material0\nmap_Kd {picture}\n")
    Image.fromarray(ramp()).save(path.parent / picture)


def front_camera(mesh: Mesh, size: int = 96) -> Camera:
    """A camera before the middle of a person, a little to its left and above."""
    middle = mesh.bounds.mean(axis=0)
    K = np.array([[1.4 * size, 0, size / 2], [0, 1.4 * size, size / 2], [0, 0, 1.0]])
    return Camera(K, look_at(tuple(middle + np.array([1.0, 0.6, 2.6])), tuple(middle)), size, size)


def photo(mesh: Mesh, pixels: np.ndarray, camera: Camera) -> np.ndarray:
    """(H, W, 3) linear light of a textured mesh."""
    return texture_at(Raycaster(mesh).cast(camera), mesh, linear_texture(pixels))


def photo_of_corners(mesh: Mesh, colours: np.ndarray, camera: Camera) -> np.ndarray:
    """(H, W, 3) linear light of a mesh whose faces blend the colours of their corners."""
    hits = Raycaster(mesh).cast(camera)
    seen = np.zeros((*hits.mask.shape, 3))
    linear = linear_from_srgb(colours / 255.0)
    seen[hits.mask] = hits.interpolate(linear, mesh.faces)[hits.mask]
    return seen

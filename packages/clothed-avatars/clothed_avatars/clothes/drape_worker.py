"""Blender's cloth solver in a process of its own: moving body in, resting cloth out.

Garments are draped one after the other, the inner first; each becomes an obstacle for the next.
"""

# bpy is a compiled module without types.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np

from clothed_avatars.clothes.drape_job import ClothFabric, DrapeJob
from harness.core.process.threads import StepReport
from harness.core.process.workers import worker_main

_STIFFNESS = {"tension": 15.0, "compression": 10.0, "shear": 5.0}
_DAMPING = {"tension": 10.0, "compression": 10.0, "shear": 5.0, "bending": 0.5}
_VERTEX_MASS_KG = 0.25
_CLOTH_GAP_M = 0.004
_BODY_GAP_M = 0.003
_CLOTH_OBSTACLE_GAP_M = 0.002
_BODY_FRICTION = 8.0
_INNER_M = 0.02


def _to_blender(points: np.ndarray) -> np.ndarray:
    """Blender's axes: +Z up, the subject facing -Y."""
    return np.stack([points[..., 0], -points[..., 2], points[..., 1]], axis=-1)


def _from_blender(points: np.ndarray) -> np.ndarray:
    return np.stack([points[..., 0], points[..., 2], -points[..., 1]], axis=-1)


def _write_point_cache(path: Path, frames: np.ndarray) -> None:
    """A PC2 file: header, then (frames, vertices, 3) 32-bit floats."""
    header = b"POINTCACHE2\0" + np.array([1, frames.shape[1]], "<i4").tobytes()
    header += np.array([0, 1], "<f4").tobytes() + np.array([len(frames)], "<i4").tobytes()
    path.write_bytes(header + frames.astype("<f4").tobytes())


def _animated_mesh(
    name: str, frames: np.ndarray, faces: np.ndarray, folder: Path
) -> bpy.types.Object:
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(frames[0].tolist(), [], faces.tolist())
    mesh.update()
    item = bpy.data.objects.new(name, mesh)
    bpy.context.collection.objects.link(item)
    path = folder / f"{name}.pc2"
    _write_point_cache(path, frames)
    cache = item.modifiers.new("motion", "MESH_CACHE")
    cache.cache_format = "PC2"
    cache.filepath = str(path)
    cache.frame_start = 1
    cache.forward_axis, cache.up_axis = "POS_Y", "POS_Z"
    return item


def _add_obstacle(
    name: str, frames: np.ndarray, faces: np.ndarray, gap: float, folder: Path
) -> None:
    item = _animated_mesh(name, frames, faces, folder)
    item.modifiers.new("obstacle", "COLLISION")
    item.collision.thickness_outer = gap
    item.collision.thickness_inner = _INNER_M
    item.collision.cloth_friction = _BODY_FRICTION
    item.collision.damping = 0.2


def _add_cloth(item: bpy.types.Object, pin: np.ndarray, fabric: ClothFabric, frames: int) -> None:
    held = item.vertex_groups.new(name="held")
    held.add(np.flatnonzero(pin > 0).tolist(), 1.0, "REPLACE")
    cloth = item.modifiers.new("cloth", "CLOTH")
    cloth.point_cache.frame_start, cloth.point_cache.frame_end = 1, frames
    settings = cloth.settings
    settings.quality = fabric.quality
    settings.mass = _VERTEX_MASS_KG
    settings.bending_model = "ANGULAR"
    for kind, value in {**_STIFFNESS, "bending": fabric.stiffness}.items():
        setattr(settings, f"{kind}_stiffness", value)
        setattr(settings, f"{kind}_damping", _DAMPING[kind])
    settings.shrink_min = -fabric.surplus
    settings.vertex_group_mass = held.name
    settings.pin_stiffness = 1.0
    contact = cloth.collision_settings
    contact.collision_quality = 3
    contact.distance_min = _CLOTH_GAP_M
    contact.use_self_collision = False


def _solve(
    item: bpy.types.Object, frames: int, tick: StepReport, done: int, total: int
) -> np.ndarray:
    scene = bpy.context.scene
    positions = []
    for frame in range(1, frames + 1):
        scene.frame_set(frame)
        evaluated = item.evaluated_get(bpy.context.evaluated_depsgraph_get())
        flat = np.empty(len(evaluated.data.vertices) * 3, np.float32)
        evaluated.data.vertices.foreach_get("co", flat)
        positions.append(flat.reshape(-1, 3))
        tick(done + frame, total)
    return np.array(positions)


def drape(job: DrapeJob, tick: StepReport) -> dict[str, object]:
    """Drape the garments of a ``DrapeJob`` and write the last two frames of each."""
    with np.load(job.body) as body:
        frames = len(body["frames"])
        _add_obstacle("body", _to_blender(body["frames"]), body["faces"], _BODY_GAP_M, job.folder)
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, frames
    for k, garment in enumerate(job.garments):
        with np.load(garment.file) as cloth:
            motion, faces, pin = _to_blender(cloth["frames"]), cloth["faces"], cloth["pin"]
        item = _animated_mesh(f"cloth{k}", motion, faces, job.folder)
        _add_cloth(item, pin, garment.fabric, frames)
        solved = _solve(item, frames, tick, k * frames, len(job.garments) * frames)
        bpy.data.objects.remove(item)
        np.save(garment.out, _from_blender(solved[-2:]))
        _add_obstacle(f"obstacle{k}", solved, faces, _CLOTH_OBSTACLE_GAP_M, job.folder)
    return {"frames": frames, "blender": bpy.app.version_string}


if __name__ == "__main__":
    worker_main(drape)

"""What IF-Nets+ is shown: voxels of the body and of both sheets, by (z, y, x), with y downwards.

The rules are those of ECON's public code, which its numbers were trained with. A sheet's depth is
entered half a voxel further from the viewer than the body's voxels are counted.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats, Mask, Singles
from harness.core.mesh import Mesh
from harness.geometry.raycast import Raycaster

#: Rays start this far from the cube's middle.
_AWAY = 4.0
#: Rays along columns pass beside the voxels' middles by this share of a voxel, so that they miss
#: the edges of surfaces that were modelled on round numbers.
_ASIDE = np.array([0.037, 0.041, 0.043])


def body_voxels(body: Mesh, side: int) -> Singles:
    """(D, D, D) 1 in the voxels that the body passes through or encloses.

    Args:
        body: In the cube's coordinates, closed but for small holes.
        side: Number of voxels along each axis.
    """
    enclosed = _enclosed(body, side) | _touched(body, side)
    return np.ascontiguousarray(enclosed.transpose(2, 1, 0)[:, ::-1]).astype(np.float32)


def sheet_voxels(front: Mesh, back: Mesh, side: int) -> Singles:
    """(D, D, D) weights of the voxels that each sheet's depth lies between, from 0 to 1.

    Args:
        front: In the cube's coordinates; of it counts what is nearest to the viewer.
        back: Of it counts what is furthest from the viewer.
        side: Number of voxels along each axis.
    """
    voxels = np.zeros((side, side, side))
    for sheet, towards in ((front, -1.0), (back, 1.0)):
        rows, columns, height = _heights(sheet, side, towards)
        place = np.clip((height + 1.0) / 2.0 * side - 1.0, 0, side - 1)
        before = np.minimum(place.astype(np.int64), side - 2)
        share = place - before
        voxels[before, rows, columns] += 1.0 - share
        voxels[before + 1, rows, columns] += share
    return voxels.clip(max=1.0).astype(np.float32)


def _middles(side: int) -> Floats:
    return (2.0 * np.arange(side) + 1.0) / side - 1.0


def _heights(sheet: Mesh, side: int, towards: float) -> tuple[Any, Any, Floats]:
    """Rows, columns and z of what rays meet first that go along z in a direction, 1 or -1."""
    across = _middles(side)
    x, y = np.meshgrid(across, -across)
    origins = np.stack([x, y, np.full_like(x, -towards * _AWAY)], axis=-1).reshape(-1, 3)
    directions = np.broadcast_to([0.0, 0.0, towards], origins.shape)
    way = Raycaster(sheet).answer(origins, directions)["t_hit"].numpy().reshape(side, side)
    rows, columns = np.nonzero(np.isfinite(way))
    return rows, columns, towards * (way[rows, columns].astype(np.float64) - _AWAY)


def _enclosed(body: Mesh, side: int) -> Mask:
    """(D, D, D) by (x, y, z), whether most of three rays cross the surface an odd number of times.

    A ray through a hole, such as an eye's socket, errs along its whole way; two others do not.
    """
    votes = sum(_odd_crossings(body, side, axis).astype(np.int8) for axis in range(3))
    return np.asarray(votes) >= 2


def _odd_crossings(body: Mesh, side: int, axis: int) -> Mask:
    import open3d as o3d

    scene: Any = o3d.t.geometry.RaycastingScene()
    tensor: Any = o3d.core.Tensor
    scene.add_triangles(
        tensor(body.vertices.astype(np.float32)), tensor(body.faces.astype(np.uint32))
    )
    others = [other for other in range(3) if other != axis]
    grids = np.meshgrid(_middles(side), _middles(side), indexing="ij")
    rays = np.zeros((side * side, 6), dtype=np.float32)
    for other, grid in zip(others, grids, strict=True):
        rays[:, other] = grid.ravel() + 2.0 * _ASIDE[other] / side
    rays[:, axis], rays[:, 3 + axis] = -_AWAY, 1.0
    answer = scene.list_intersections(tensor(rays))
    place = answer["t_hit"].numpy().astype(np.float64) - _AWAY
    # The first voxel whose middle lies behind a crossing; one more is for those behind the cube.
    first = np.clip(np.ceil((place + 1.0) / 2.0 * side - 0.5), 0, side).astype(np.int64)
    crossed: NDArray[np.int32] = np.zeros((side * side, side + 1), dtype=np.int32)
    np.add.at(crossed, (answer["ray_ids"].numpy().astype(np.int64), first), 1)
    odd: Mask = np.asarray(np.cumsum(crossed, axis=1)[:, :side] % 2 == 1)
    return np.moveaxis(odd.reshape(side, side, side), 2, axis)


def _touched(body: Mesh, side: int) -> Mask:
    """(D, D, D) by (x, y, z), whether the surface passes through each voxel."""
    import open3d as o3d

    given: Any = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(body.vertices), o3d.utility.Vector3iVector(body.faces)
    )
    grid: Any = o3d.geometry.VoxelGrid.create_from_triangle_mesh_within_bounds(
        given, 2.0 / side, np.full(3, -1.0), np.full(3, 1.0)
    )
    places = np.array([voxel.grid_index for voxel in grid.get_voxels()], dtype=np.int64)
    touched = np.zeros((side, side, side), dtype=bool)
    inside = ((places >= 0) & (places < side)).all(axis=1)
    touched[tuple(places[inside].T)] = True
    return touched

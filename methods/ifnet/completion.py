"""IF-Nets+ completes two sheets to a closed surface, as ECON's variant with a network does.

Source: Xiu et al., "ECON", CVPR 2023, section 3.3 (ECON_IF), and its public code: voxels of the
body and of both sheets in a cube, occupancy on a lattice, its surface decimated and smoothed.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats, Mask, Singles
from harness.core.camera import Camera
from harness.core.camera_frames import OPENCV_TO_BLENDER_CAMERA
from harness.core.errors import MethodError
from harness.core.mesh import Mesh
from harness.core.protocols import Part
from harness.geometry.coinciding import concatenated, edges_of, largest_piece
from harness.geometry.outline import isosurface
from harness.geometry.raycast import Raycaster
from methods.parts.converted import DECODER, ENCODER, IFNET
from methods.parts.onnx_networks import answers, open_session

#: The field is at least this inside.
INSIDE = 0.5
#: Cells along each axis of the coarsest lattice: 33 points, as published.
_COARSEST = 32

#: Values (N,) of a field at points (N, 3) of the cube, from -1 to 1 along each axis.
Field = Callable[[Floats], Singles]


def contoured_field(field: Field, cells: int, looked_at: Mask) -> Mesh:
    """The largest piece of the surface around what is inside, facing outwards, closed.

    Args:
        field: Above one half inside.
        cells: Along each axis of the finest lattice, 32 times a power of two.
        looked_at: (D, D, D) voxels by (x, y, z) that all finer lattices ask around, however little
            the coarsest one sees.

    Raises:
        MethodError: the field is inside nowhere.
    """
    values = refined(field, cells, looked_at)
    if not (values > INSIDE).any():
        raise MethodError(
            "the completed surface is empty",
            expected="occupancies above one half",
            got=f"at most {values.max():.3g}",
        )
    outside = min(0.0, float(values.min()))
    mesh = isosurface(values, level=INSIDE, outside=outside, source="completed surface")
    return largest_piece(replace(mesh, vertices=2.0 * mesh.vertices / cells - 1.0))


def refined(field: Field, cells: int, looked_at: Mask) -> Singles:
    """(cells + 1,)*3 values of a field on a lattice by (x, y, z); arguments as above."""
    size = min(_COARSEST, cells)
    values = np.empty((size + 1,) * 3, dtype=np.float32)
    _ask(field, values, np.ones(values.shape, dtype=bool))
    while size < cells:
        size *= 2
        wanted = _between(_crossed(values) | _around(looked_at, size // 2))
        known = np.zeros((size + 1,) * 3, dtype=bool)
        known[::2, ::2, ::2] = True
        values = _doubled(values)
        _ask(field, values, wanted & ~known)
    return values


def _ask(field: Field, values: Singles, wanted: Mask) -> None:
    """Fill in the field's values where they are wanted."""
    places = np.argwhere(wanted)
    values[wanted] = field(2.0 * places / (len(values) - 1) - 1.0)


def _crossed(values: Singles) -> Mask:
    """(C, C, C) cells with corners both inside and outside, and the cells beside them."""
    from scipy.ndimage import binary_dilation

    inside = values > INSIDE
    corners = [
        inside[x : x - 1 or None, y : y - 1 or None, z : z - 1 or None]
        for x in (0, 1)
        for y in (0, 1)
        for z in (0, 1)
    ]
    mixed = np.logical_or.reduce(corners) & ~np.logical_and.reduce(corners)
    return np.asarray(binary_dilation(mixed, np.ones((3, 3, 3)))).astype(bool)


def _around(voxels: Mask, cells: int) -> Mask:
    """(C, C, C) cells that hold a voxel; with more cells than voxels, none."""
    width, rest = divmod(len(voxels), cells)
    if width == 0 or rest or cells > _COARSEST:
        return np.zeros((cells,) * 3, dtype=bool)
    blocks = voxels.reshape(cells, width, cells, width, cells, width)
    held: Mask = np.logical_or.reduce(blocks, axis=(1, 3, 5))
    return held


def _between(cells: Mask) -> Mask:
    """(2 C + 1,)*3 points of the lattice of half the step that lie in or on marked cells."""
    points = np.zeros(tuple(2 * count + 1 for count in cells.shape), dtype=bool)
    for x in range(3):
        for y in range(3):
            for z in range(3):
                part = tuple(
                    slice(start, start + 2 * count - 1, 2)
                    for start, count in zip((x, y, z), cells.shape, strict=True)
                )
                points[part] |= cells
    return points


def _doubled(values: Singles) -> Singles:
    """The same values with their neighbours' means between them, along each axis."""
    for axis in range(3):
        along = np.moveaxis(values, axis, 0)
        finer = np.empty((2 * len(along) - 1, *along.shape[1:]), dtype=np.float32)
        finer[::2] = along
        finer[1::2] = (along[1:] + along[:-1]) / 2.0
        values = np.moveaxis(finer, 0, axis)
    return np.ascontiguousarray(values)


#: Longer side of the person's box, seen from the camera, in units of the cube, whose side is 2.
_PERSON = 1.8


@dataclass(frozen=True, slots=True, eq=False)
class Cube:
    """Where the cube is: x right, y up, z towards the viewer, each from -1 to 1.

    Attributes:
        from_world: (4, 4) similarity from world metres.
        to_world: (4, 4) its inverse.
    """

    from_world: Floats
    to_world: Floats


def cube_around(camera: Camera, seen: Mesh, body: Mesh) -> Cube:
    """The cube around a person.

    Args:
        camera: Its axes become the cube's; its perspective plays no part.
        seen: The sheets, world metres; the box of what the camera sees is centred across the view.
        body: The body, world metres; its box is centred along the view.
    """
    turn = OPENCV_TO_BLENDER_CAMERA[:3, :3] @ camera.rotation
    (left, low, _), (right, high, _) = _box(seen.vertices @ turn.T)
    (_, _, far), (_, _, near) = _box(body.vertices @ turn.T)
    scale = _PERSON / max(right - left, high - low)
    middle = np.array([left + right, low + high, far + near]) / 2.0
    from_world = np.eye(4)
    from_world[:3, :3], from_world[:3, 3] = scale * turn, -scale * middle
    return Cube(from_world, np.linalg.inv(from_world))


def _box(points: Floats) -> tuple[Floats, Floats]:
    return points.min(axis=0), points.max(axis=0)


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


#: Voxels and cells along each axis of the cube.
SIDE = 256
#: Points that are asked for at once; a million would take 2 GB.
_AT_ONCE = 1 << 16
#: The published size of the completed surface, and its smoothing.
_FACES = 50_000
_ALPHA, _BETA, _ROUNDS = 0.1, 0.5, 10


def ifnet_part() -> Part:
    """The imported network, as records name it.

    Raises:
        MissingPart: it is not imported, or a file is gone.
        DataError: a file is another one.
    """
    return IFNET.find().installed.part(IFNET.about.role)


def completed_by_network(
    sheets: tuple[Mesh, Mesh], body: Mesh, camera: Camera, side: int = SIDE
) -> Mesh:
    """The closed surface that the network makes of two sheets and a body, world metres.

    Args:
        sheets: Front and back, world metres.
        body: The fitted body without its eyeballs, world metres.
        camera: The front view's; the network looks along its axis.
        side: Voxels along each axis; the network was trained with 256.

    Raises:
        MissingPart, DataError: as ``ifnet_part``.
        MethodError: nothing is inside the surface.
    """
    cube = cube_around(camera, concatenated(sheets), body)
    front, back = (sheet.geometry().transformed(cube.from_world) for sheet in sheets)
    inner = body_voxels(body.geometry().transformed(cube.from_world), side)
    occupancy = Occupancy(sheet_voxels(front, back, side), inner)
    mesh = contoured_field(occupancy, side, occupancy.shown)
    return smoothed(_decimated(mesh)).transformed(cube.to_world)


class Occupancy:
    """The network's answer at any point of the cube, above one half inside.

    Args:
        sheets: (D, D, D) by (z, y, x), y downwards; see ``methods.ifnet.completion``.
        body: (D, D, D) likewise.

    Raises:
        MissingPart, DataError: as ``ifnet_part``.
    """

    def __init__(self, sheets: Singles, body: Singles) -> None:
        stored = IFNET.find()
        shown = {"sheets": sheets[None], "body": body[None]}
        lattices = answers(open_session(stored.file(ENCODER)), "IF-Nets+", shown)
        named = {f"features_{level}": lattice for level, lattice in enumerate(lattices)}
        self._shown: dict[str, NDArray[np.float32]] = {"sheets": sheets[None], **named}
        self._decoder: Any = open_session(stored.file(DECODER))
        #: (D, D, D) by (x, y, z), y upwards: voxels with a body or a sheet in them.
        self.shown: Mask = ((sheets > 0) | (body > 0))[:, ::-1].transpose(2, 1, 0)

    def __call__(self, points: Floats) -> Singles:
        """(N,) occupancies at points (N, 3) of the cube: x right, y up, z towards the viewer."""
        asked = (points * (1.0, -1.0, 1.0)).astype(np.float32)
        found = np.empty(len(asked), dtype=np.float32)
        for start in range(0, len(asked), _AT_ONCE):
            some = slice(start, start + _AT_ONCE)
            feeds = {"points": asked[None, some], **self._shown}
            (found[some],) = answers(self._decoder, "IF-Nets+", feeds)[0]
        return found


def _decimated(mesh: Mesh) -> Mesh:
    import open3d as o3d

    if len(mesh.faces) <= _FACES:
        return mesh
    given: Any = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(mesh.vertices), o3d.utility.Vector3iVector(mesh.faces)
    )
    smaller = given.simplify_quadric_decimation(target_number_of_triangles=_FACES)
    return Mesh(np.asarray(smaller.vertices), np.asarray(smaller.triangles), source=mesh.source)


def smoothed(mesh: Mesh, alpha: float = _ALPHA, beta: float = _BETA, rounds: int = _ROUNDS) -> Mesh:
    """A surface without its small bumps, which keeps its volume better than by plain averaging.

    Source: Vollmer, Mencl, Mueller, "Improved Laplacian smoothing of noisy surface meshes", 1999:
    after each averaging a vertex goes back by what it and its neighbours were moved.

    Args:
        mesh: The surface.
        alpha: Share of the first positions in what a vertex is called back to.
        beta: Share of a vertex' own move in what it goes back by; the rest is its neighbours'.
        rounds: How often.
    """
    from scipy.sparse import coo_matrix, diags

    first, second = edges_of(mesh.faces).ends.T
    count = len(mesh.vertices)
    joined = coo_matrix((np.ones(len(first)), (first, second)), shape=(count, count))
    joined = (joined + joined.T).tocsr()
    mean = diags(1.0 / np.maximum(np.asarray(joined.sum(axis=1)).ravel(), 1.0)) @ joined
    given, vertices = mesh.vertices, mesh.vertices
    for _ in range(rounds):
        before = vertices
        vertices = mean @ before
        moved = vertices - (alpha * given + (1.0 - alpha) * before)
        vertices = vertices - (beta * moved + (1.0 - beta) * (mean @ moved))
    return Mesh(vertices, mesh.faces, source=mesh.source)

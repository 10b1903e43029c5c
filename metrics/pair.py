"""Two meshes, read once, and what several protocols ask of them, made once."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from harness.core.arrays import Floats, Ints, box_of
from harness.core.camera import Camera
from harness.core.errors import DataError
from harness.core.files.hashing import derive_seed
from harness.core.mesh import Mesh
from harness.core.protocol_stages import UNALIGNED, Aligned, Alignment, Frame
from harness.core.settings import MetricProtocol
from harness.core.units import MM_PER_METRE
from harness.geometry.coinciding import merged_positions
from harness.geometry.similarity import similarity_of_pictures
from harness.geometry.surface import SurfaceIndex, SurfacePoints, raycasting_scene, search_nearest
from metrics.distance import (
    NearestPoints,
    Sampling,
    morton_codes,
    nearest_samples,
    sample_surface,
)
from metrics.normals import face_cosines, facing_faces
from metrics.rendered_normals import Portraits, Window


class EdgeIndex:
    """The edges of all faces of a surface, and the faces that are large enough to count whole.

    Args:
        surface: In metres.
        below_m2: Faces of at least this area count whole.
    """

    def __init__(self, surface: SurfaceIndex, below_m2: float) -> None:
        mesh = surface.mesh
        corners, count = mesh.faces.T.astype(np.int64), len(mesh.vertices)
        sides = [(corners[k - 1], corners[k]) for k in range(3)]
        keys = [np.minimum(*side) * count + np.maximum(*side) for side in sides]
        first, second = np.divmod(np.unique(np.concatenate(keys)), count)
        large = mesh.faces[surface.face_areas >= below_m2]
        # An edge is a triangle of which two corners are one: the search is exact on it.
        pieces = np.concatenate([np.stack([first, second, second], axis=1), large])
        self._mesh, self._pieces, self._centre = mesh, pieces, surface.centre
        self._scene: Any = raycasting_scene(mesh, self._centre, pieces)

    def distances(self, points: Floats) -> Floats:
        """(N,) metres from (N, 3) points to the nearest edge or large face."""
        pieces, barycentric = search_nearest(self._scene, points - self._centre)
        corners = self._mesh.vertices[self._pieces[pieces]]
        nearest = np.einsum("nk,nkc->nc", barycentric, corners)
        return np.sqrt(((points - nearest) ** 2).sum(axis=1))


#: So many vertices, about, tell what an alignment took away.
_LOOKED_AT = 5000


def aligned(predicted: SurfaceIndex, truth: SurfaceIndex, how: Alignment) -> Aligned:
    """What an alignment does to a prediction; the identity where nothing is aligned.

    Args:
        predicted: Metres, as given.
        truth: In the same frame.
        how: See ``Alignment``.

    Raises:
        DataError: the prediction is too far off to be moved.
    """
    if how.by == "none":
        return UNALIGNED
    mesh = predicted.mesh
    rounds, vertices = 0, mesh.vertices[mesh.faces[:, 0]]
    if how.by == "icp":
        vertices = readers_vertices(mesh, predicted.positions)
        matrix, rounds = icp(vertices, readers_vertices(truth.mesh, truth.positions), how)
    else:
        matrix = _box_onto_box(mesh.bounds, truth.mesh.bounds, heights=how.by == "height")
    return _told(how.by, matrix, rounds, mesh, truth, vertices)


def aligned_by_cameras(
    predicted: Mesh, truth: SurfaceIndex, found: Sequence[Camera], known: Sequence[Camera]
) -> Aligned:
    """The Sim(3) by which a prediction's cameras show what true ones do, never by its surface.

    Args:
        predicted: In the world of ``found``.
        truth: In that of ``known``.
        found: Estimated cameras.
        known: True ones of the same photos.

    Raises:
        MethodError: cameras that do not stand as the true ones do, or are mirrored.
    """
    matrix = similarity_of_pictures(found, known).matrix
    vertices = readers_vertices(predicted, merged_positions(predicted.vertices))
    return _told("sim3-cameras", matrix, 0, predicted, truth, vertices)


def _told(
    by: str, matrix: Floats, rounds: int, predicted: Mesh, truth: SurfaceIndex, vertices: Floats
) -> Aligned:
    """What a matrix does to a prediction and takes away."""
    if not np.isfinite(matrix).all():
        raise DataError(f"{predicted.source} cannot be aligned", got=str(matrix.tolist()))
    turned = np.linalg.det(matrix[:3, :3])
    some = vertices[:: max(1, len(vertices) // _LOOKED_AT)]
    moved = some @ matrix[:3, :3].T + matrix[:3, 3]
    return Aligned(
        by=by,
        matrix=tuple(tuple(map(float, row)) for row in matrix),
        scale=float(np.cbrt(abs(turned))),
        mirrored=bool(turned < 0),
        rounds=rounds,
        before_mm=float(truth.closest(some)[1].mean()) * MM_PER_METRE,
        after_mm=float(truth.closest(moved)[1].mean()) * MM_PER_METRE,
    )


def readers_vertices(mesh: Mesh, positions: Ints) -> Floats:
    """(V, 3) vertices as trimesh reads them: used ones, one at each position.

    At a seam of the texture each side has its own, which therefore counts twice in an alignment.

    Args:
        mesh: Whose.
        positions: (V,) a number for each position, as ``merged_positions`` gives it.
    """
    if mesh.uv is None or mesh.face_uv is None:
        one = np.full(int(positions.max()) + 1, -1)
        used = mesh.faces.ravel()
        one[positions[used]] = used
        return mesh.vertices[one[one >= 0]]
    group = positions[mesh.faces].ravel().astype(np.int64)
    coordinates = merged_positions(mesh.uv)[mesh.face_uv].ravel().astype(np.int64)
    pairs = group * (int(coordinates.max()) + 1) + coordinates
    corners = np.unique(pairs, return_index=True)[1]
    return mesh.vertices[mesh.faces.ravel()[corners]]


def icp(moving: Floats, fixed: Floats, how: Alignment) -> tuple[Floats, int]:
    """The (4, 4) matrix that iterative closest points find from the given place, and the rounds.

    As trimesh does it: every moving point goes with its nearest fixed one, both sets weigh evenly,
    and the search stops when the mean squared distance improves by less than the threshold.

    Args:
        moving: (N, 3).
        fixed: (M, 3).
        how: Whether size and handedness may change, and when to stop.
    """
    nearest, matrix, cost, rounds = NearestPoints(fixed), np.eye(4), np.inf, 0
    # Neighbours one after the other are found faster.
    moving = moving[np.argsort(morton_codes(moving))]
    while rounds < how.iterations:
        targets = fixed[nearest(moving)[1]]
        step = similarity(moving, targets, scale=how.scale, reflection=how.reflection)
        moving = moving @ step[:3, :3].T + step[:3, 3]
        matrix = step @ matrix
        rounds += 1
        before, cost = cost, _squares(targets - moving) / len(moving)
        if before - cost < how.threshold:
            break
    return matrix, rounds


def similarity(moving: Floats, fixed: Floats, *, scale: bool, reflection: bool) -> Floats:
    """The (4, 4) matrix that brings (N, 3) points onto (N, 3) others, by trimesh's Procrustes.

    Its scale is the ratio of the two sizes, not the one of least squares.
    """
    middle, target = moving.mean(axis=0), fixed.mean(axis=0)
    moving, fixed = moving - middle, fixed - target
    left, _, right = np.linalg.svd(fixed.T @ moving)
    if not reflection:
        left[:, 2] *= np.linalg.det(left @ right)
    size = np.sqrt(_squares(fixed) / _squares(moving)) if scale else 1.0
    matrix = np.eye(4)
    matrix[:3, :3] = size * (left @ right)
    matrix[:3, 3] = target - matrix[:3, :3] @ middle
    return matrix


def _squares(vectors: Floats) -> float:
    return float(np.einsum("ij,ij->", vectors, vectors))


def _box_onto_box(mine: Floats, true: Floats, *, heights: bool) -> Floats:
    sides = [bounds[1] - bounds[0] for bounds in (mine, true)]
    size = sides[1][1] / sides[0][1] if heights else sides[1].max() / sides[0].max()
    matrix = np.diag([size, size, size, 1.0])
    matrix[:3, 3] = true.mean(axis=0) - size * mine.mean(axis=0)
    return matrix


T = TypeVar("T")
#: A person's height in the field's device coordinates, and metres of that person to one of them.
_PERSON_M, _METRES_PER_UNIT = 1.8, 1.024


class _Once:
    """Keeps what was made, by what it was made from."""

    def __init__(self) -> None:
        self._made: dict[Hashable, Any] = {}

    def once(self, key: Hashable, make: Callable[[], T]) -> T:
        """What the key stands for, made now or before."""
        if key not in self._made:
            self._made[key] = make()
        found: T = self._made[key]
        return found


class Side(_Once):
    """One of the two surfaces, and whose random stream draws the points on it."""

    def __init__(self, index: SurfaceIndex, role: str) -> None:
        super().__init__()
        self.index, self.role = index, role
        self._edges: dict[int, EdgeIndex] = {}

    def samples(self, protocol: MetricProtocol) -> SurfacePoints:
        """The points of a protocol."""
        count, sampling, seed = _drawn(protocol)
        stream = derive_seed(seed, self.role)
        return self.once(
            (count, sampling, seed), lambda: sample_surface(self.index, count, sampling, stream)
        )

    def smooth(self, *, seams: bool) -> SurfaceIndex:
        """The surface with smooth normals that end at texture seams, or do not."""
        seams = seams and self.index.mesh.uv is not None
        return self.once(("smooth", seams), lambda: self.index.smooth_at(seams=seams))

    def edges(self, below_m2: float) -> EdgeIndex:
        """Its edges, and the faces of at least this area."""
        large = int((self.index.face_areas >= below_m2).sum())
        if large not in self._edges:
            self._edges[large] = EdgeIndex(self.index, below_m2)
        return self._edges[large]

    def thinned(self, protocol: MetricProtocol, cell_m: float) -> Floats:
        """The points of a protocol, those in one cell of a grid replaced by their mean."""
        return self.once(
            ("thinned", cell_m, _drawn(protocol)),
            lambda: thinned(self.samples(protocol).points, cell_m),
        )

    def portraits(self, window: Window) -> Portraits:
        """Its pictures in a window."""
        return self.once(("portraits", window), lambda: Portraits(self.index, window))

    def copy(self) -> Side:
        """A perfect copy of it as a prediction."""
        twin = Side(self.index, "predicted")
        twin._edges = self._edges
        return twin


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """Prediction and truth in the frame of a protocol, the prediction aligned.

    Attributes:
        mine, true: Both in metres.
        per_metre: Units of the frame to a metre.
        alignment: What was done to the prediction.
        kept: What was found between the two.
    """

    mine: Side
    true: Side
    per_metre: float
    alignment: Aligned
    kept: _Once

    def sides(self, *, back: bool) -> tuple[Side, Side]:
        """Where points are drawn, and what they are measured to."""
        return (self.true, self.mine) if back else (self.mine, self.true)

    def closest(self, protocol: MetricProtocol, *, back: bool) -> tuple[SurfacePoints, Floats]:
        """The closest points of the other surface to the drawn ones, and how far they are, metres.

        Args:
            protocol: Which points.
            back: Whether those on the truth.
        """
        sampled, other = self.sides(back=back)
        return self.kept.once(
            ("closest", back, _drawn(protocol)),
            lambda: other.index.closest(sampled.samples(protocol).points),
        )

    def nearest(self, protocol: MetricProtocol, *, back: bool) -> tuple[Floats, Ints]:
        """How far the nearest sample of the other surface is from the drawn ones, and which."""
        sampled, other = self.sides(back=back)
        return self.kept.once(
            ("nearest", back, _drawn(protocol)),
            lambda: nearest_samples(
                sampled.samples(protocol).points, other.samples(protocol).points
            ),
        )

    def to_edges(self, protocol: MetricProtocol, *, back: bool) -> Floats:
        """(N,) metres from the drawn points to the other surface's edges."""
        sampled, other = self.sides(back=back)
        edges = other.edges(protocol.edges_below / self.per_metre**2)
        return self.kept.once(
            ("edges", back, id(edges), _drawn(protocol)),
            lambda: edges.distances(sampled.samples(protocol).points),
        )

    def cosines(self, protocol: MetricProtocol, *, back: bool, of_samples: bool) -> Floats:
        """(N,) absolute cosines of the drawn points' face normals and those nearest to them."""
        sampled, other = self.sides(back=back)
        drawn = sampled.samples(protocol)
        if of_samples:
            there = other.samples(protocol).faces[self.nearest(protocol, back=back)[1]]
        else:
            closest, _ = self.closest(protocol, back=back)
            there = facing_faces(other.index, closest, drawn.points)
        return face_cosines(
            sampled.index.face_vectors[drawn.faces], other.index.face_vectors[there]
        )


class Pair(_Once):
    """A prediction and a truth.

    Args:
        predicted: Reconstruction, in metres, world frame.
        truth: The true surface, in the same frame and unit.
    """

    def __init__(self, predicted: Mesh, truth: Mesh) -> None:
        super().__init__()
        with ThreadPoolExecutor(max_workers=2) as pool:
            mine, true = pool.submit(_searched, predicted), pool.submit(_searched, truth)
        self.mine, self.true = Side(mine.result(), "predicted"), Side(true.result(), "truth")

    def placed(self, protocol: MetricProtocol) -> Placed:
        """Both in the frame of a protocol, the prediction aligned.

        Raises:
            DataError: nothing of the truth is left above a cut, or an alignment fails.
        """
        key = protocol.frame.cut_below_m, protocol.alignment
        kept, mine, true, alignment = self.once(key, lambda: self._moved(protocol))
        return Placed(mine, true, per_metre(true.index, protocol.frame), alignment, kept)

    def _moved(self, protocol: MetricProtocol) -> tuple[_Once, Side, Side, Aligned]:
        mine, true, low = self.mine, self.true, protocol.frame.cut_below_m
        if low is not None:
            true = Side(SurfaceIndex(cut_below(true.index.mesh, low)), true.role)
        alignment = aligned(mine.index, true.index, protocol.alignment)
        if alignment.by != "none":
            mine = Side(mine.index.moved(np.array(alignment.matrix)), mine.role)
        return _Once(), mine, true, alignment

    def copied(self, protocol: MetricProtocol) -> Placed:
        """The truth as a perfect copy of itself, in the frame of a protocol."""
        true = self.placed(protocol).true
        kept, twin = self.once(("copy", protocol.frame.cut_below_m), lambda: (_Once(), true.copy()))
        return Placed(twin, true, per_metre(true.index, protocol.frame), UNALIGNED, kept)


def _searched(mesh: Mesh) -> SurfaceIndex:
    """The index of a mesh, its search made."""
    index = SurfaceIndex(mesh)
    index.closest(index.centre[None])
    return index


def per_metre(truth: SurfaceIndex, frame: Frame) -> float:
    """Units of a frame to a metre."""
    if frame.unit == "person":
        return _PERSON_M / float(truth.extent[1]) / _METRES_PER_UNIT
    return 2.0 / float(truth.extent.max()) if frame.unit == "box" else 1.0


def cut_below(mesh: Mesh, low_m: float) -> Mesh:
    """What of a mesh lies above a height; faces are cut at it.

    Raises:
        DataError: nothing does.
    """
    vertices, faces = mesh.vertices, mesh.faces
    above = vertices[faces][..., 1] > low_m
    pieces = [vertices[faces[above.all(axis=1)]]]
    for kept in (1, 2):
        chosen = np.flatnonzero(above.sum(axis=1) == kept)
        # The corner that is alone on its side comes first, the others in their order.
        alone = (above[chosen] if kept == 1 else ~above[chosen]).argmax(axis=1)
        a, b, c = (vertices[faces[chosen, (alone + k) % 3]] for k in range(3))
        ab, ac = (
            a + ((low_m - a[:, 1]) / (end[:, 1] - a[:, 1]))[:, None] * (end - a) for end in (b, c)
        )
        triangles = [(a, ab, ac)] if kept == 1 else [(ab, b, c), (ab, c, ac)]
        pieces += [np.stack(corners, axis=1) for corners in triangles]
    corners = np.concatenate(pieces).reshape(-1, 3)
    return Mesh(
        vertices=corners,
        faces=np.arange(len(corners)).reshape(-1, 3),
        source=f"{mesh.source}, cut at {low_m:g} m",
    )


def thinned(points: Floats, cell_m: float) -> Floats:
    """(M, 3) means of (N, 3) points over the cells of a grid about them, as Open3D thins."""
    low, high = box_of(points)
    low -= cell_m / 2
    cells = np.floor((points - low) / cell_m).astype(np.int64)
    wide = np.floor((high - low) / cell_m).astype(np.int64) + 1
    _, group = np.unique(
        (cells[:, 0] * wide[1] + cells[:, 1]) * wide[2] + cells[:, 2], return_inverse=True
    )
    counts = np.bincount(group)
    return np.stack([np.bincount(group, axis) / counts for axis in points.T], axis=1)


def _drawn(protocol: MetricProtocol) -> tuple[int, Sampling, int]:
    return protocol.samples, protocol.sampling, protocol.seed

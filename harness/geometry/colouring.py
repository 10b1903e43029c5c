"""Colour a surface from photos: which photo, how bright, how smooth."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from harness.core.arrays import AnyInts, Floats, Ints, Mask, Singles
from harness.core.errors import DataError
from harness.core.mesh import Mesh
from harness.files.coloured_mesh import ColouredMesh
from harness.geometry.coinciding import components, edges_of, merged_positions
from harness.geometry.images import srgb_from_linear
from harness.geometry.occlusion import Sight, linear_light, sight_of
from harness.geometry.photo import Photo
from harness.geometry.raycast import Raycaster
from harness.geometry.surface import vertex_normals

#: Vertices are put together in cells of this share of the wanted width.
_CELL_SHARE = 1.0 / 3.0


@dataclass(frozen=True, eq=False)
class _Cells:
    """Vertices put together, by place and by the direction that the surface faces."""

    of_vertex: Ints
    spread: Any
    count: int
    steps: int
    fine_steps: int


class SurfaceGraph:
    """The vertices of a mesh and the edges between them; vertices at one place are one.

    Attributes:
        mesh: The surface.
        place: (V,) the number of the place of each vertex; there are ``count``.
    """

    def __init__(self, mesh: Mesh) -> None:
        from scipy.sparse import coo_array

        self.mesh = mesh
        self.place = merged_positions(mesh.vertices)
        self.count = int(self.place.max()) + 1
        ends = edges_of(self.place[mesh.faces]).ends
        ends = ends[ends[:, 0] != ends[:, 1]]
        self.ends = ends
        both = np.concatenate([ends, ends[:, ::-1]])
        ones = np.ones(len(both), dtype=np.float32)
        shape = (self.count, self.count)
        self.neighbours = coo_array((ones, (both[:, 0], both[:, 1])), shape=shape).tocsr()
        self.positions = np.empty((self.count, 3))
        self.positions[self.place] = mesh.vertices
        self.normals = np.empty((self.count, 3))
        self.normals[self.place] = vertex_normals(mesh)
        self._cells: dict[float, _Cells] = {}

    def spread(self, values: Singles, width_m: float) -> Singles:
        """(count, C) values averaged along the surface, about as by a Gaussian.

        Args:
            values: (count, C), one row for each place.
            width_m: Its standard deviation, metres.
        """
        cells = self._cells_of(width_m)
        sums = np.stack(
            [np.bincount(cells.of_vertex, column, cells.count) for column in values.T], axis=1
        )
        held = np.bincount(cells.of_vertex, minlength=cells.count)[:, None]
        # Weighted by how much surface a cell holds, so that a sliver counts little.
        top, below = sums.astype(np.float32), held.astype(np.float32)
        for _ in range(cells.steps):
            top, below = cells.spread @ top, cells.spread @ below
        fine = (top / below)[cells.of_vertex]
        degree = 1.0 + np.diff(self.neighbours.indptr)[:, None].astype(np.float32)
        for _ in range(cells.fine_steps):
            fine = (self.neighbours @ fine + fine) / degree
        return fine

    def filled(self, values: Floats, known: Mask) -> Floats:
        """(count, C) values, continued harmonically from the known places to the others.

        A piece of the surface without any known place gets the mean of all known values.
        """
        from scipy.sparse import diags_array
        from scipy.sparse.linalg import splu

        result = values.copy()
        if not known.any() or known.all():
            return result
        result[~known] = values[known].mean(axis=0)
        pieces = components(self.count, self.ends[:, 0], self.ends[:, 1])
        has_known = np.zeros(int(pieces.max()) + 1, dtype=bool)
        has_known[pieces[known]] = True
        sought = np.flatnonzero(~known & has_known[pieces])
        if not len(sought):
            return result
        rows = self.neighbours[sought].astype(np.float64)
        laplacian = diags_array(rows.sum(axis=1)) - rows[:, sought]
        given = rows[:, np.flatnonzero(known)] @ values[known]
        options = {"SymmetricMode": True}
        solver = splu(laplacian.tocsc(), permc_spec="MMD_AT_PLUS_A", options=options)
        result[sought] = solver.solve(given)
        return result

    def _cells_of(self, width_m: float) -> _Cells:
        if width_m not in self._cells:
            self._cells[width_m] = self._made_cells(width_m)
        return self._cells[width_m]

    def _made_cells(self, width_m: float) -> _Cells:
        from scipy.sparse import coo_array

        cell_m = _CELL_SHARE * width_m
        axis = np.abs(self.normals).argmax(axis=1)
        turned = np.take_along_axis(self.normals, axis[:, None], 1)[:, 0] < 0
        where = np.floor(self.positions / cell_m)
        of_vertex = merged_positions(np.column_stack([where, axis + 3.0 * turned]))
        count = int(of_vertex.max()) + 1
        ends = of_vertex[self.ends]
        itself = np.repeat(np.arange(count)[:, None], 2, axis=1)
        pairs = np.unique(np.concatenate([ends, ends[:, ::-1], itself]), axis=0)
        share = 1.0 / np.bincount(pairs[:, 1], minlength=count)
        spread = coo_array(
            (share[pairs[:, 1]].astype(np.float32), (pairs[:, 0], pairs[:, 1])),
            shape=(count, count),
        )
        apart = self.positions[self.ends[:, 0]] - self.positions[self.ends[:, 1]]
        edge_m = float(np.median(np.linalg.norm(apart, axis=1)))
        return _Cells(
            of_vertex,
            spread.tocsr(),
            count,
            # A step to one of about six neighbours, or none, adds 3/7 of its squared length.
            steps=max(1, round(7 / 3 / _CELL_SHARE**2)),
            fine_steps=min(16, max(1, round(7 / 3 * (0.5 * cell_m / edge_m) ** 2))),
        )


#: Places that two photos must share before they say anything of each other's exposure.
_LEAST_SHARED = 30
#: So many of them are compared.
_MOST_SHARED = 20_000
#: Corrections and blends vary along the surface no faster than this, metres.
_WIDTH_M = 0.03
#: Where photos differ by more than this factor's logarithm, they do not show the same surface.
_MOST = 0.5
#: Weighs gains towards 0, so that photos that share nothing stay as they are.
_RIDGE = 1e-3


def gains(sights: Sequence[Sight]) -> Floats:
    """(S, 3) what to add to each photo's light so that all agree as well as gains can; mean 0.

    Least squares over all pairs of photos of the weighted median of the differences at the places
    that both show.
    """
    count = len(sights)
    normal = np.eye(count) * _RIDGE
    right = np.zeros((count, 3))
    for first in range(count):
        for second in range(first + 1, count):
            found = _difference(sights[first], sights[second])
            if found is None:
                continue
            difference, weight = found
            normal[[first, second], [first, second]] += weight
            normal[[first, second], [second, first]] -= weight
            right[first] += weight * difference
            right[second] -= weight * difference
    solved = np.linalg.solve(normal, right)
    return solved - solved.mean(axis=0)


def _difference(first: Sight, second: Sight) -> tuple[Floats, float] | None:
    """(3,) median by which the second photo is brighter, and the square root of how many tell."""
    shared, one, other = np.intersect1d(
        first.places, second.places, assume_unique=True, return_indices=True
    )
    if len(shared) < _LEAST_SHARED:
        return None
    step = -(-len(shared) // _MOST_SHARED)
    one, other = one[::step], other[::step]
    apart = second.light[other] - first.light[one]
    weight = np.minimum(first.worth[one], second.worth[other])
    middle = [_weighted_median(apart[:, channel], weight) for channel in range(3)]
    return np.array(middle), float(np.sqrt(len(shared)))


def _weighted_median(values: Singles, weights: Singles) -> float:
    order = np.argsort(values)
    total = np.cumsum(weights[order], dtype=np.float64)
    return float(values[order[np.searchsorted(total, 0.5 * total[-1])]])


def blended(
    sights: Sequence[Sight], lights: Sequence[Singles], weights: Sequence[Singles], count: int
) -> tuple[Floats, Floats]:
    """(count, 3) weighted mean of the photos' light at each place, and (count,) total weight.

    Args:
        sights: Which places each photo shows.
        lights: (N, 3) of each photo.
        weights: (N,) of each photo.
        count: Number of places.
    """
    total = np.zeros(count)
    sums = np.zeros((count, 3))
    for sight, light, weight in zip(sights, lights, weights, strict=True):
        total[sight.places] += weight
        sums[sight.places] += light * weight[:, None]
    return sums / np.where(total > 0, total, 1.0)[:, None], total


def corrections(
    sights: Sequence[Sight], lights: Sequence[Singles], graph: SurfaceGraph
) -> list[Singles]:
    """(N, 3) smooth fields that bring each photo's light to the blend of all.

    The blend weighs a photo less towards the border of what it shows, so that no seam is in it;
    what a photo's light lacks to it is spread along the surface among the places that it shows.

    Args:
        sights: What each photo shows.
        lights: (N, 3) of each photo, with its gain.
        graph: The surface.
    """
    inner = [sight.worth * _innerness(sight.places, graph) for sight in sights]
    target, _ = blended(sights, lights, inner, graph.count)
    return [
        _spread_among(sight, np.clip(target[sight.places] - light, -_MOST, _MOST), graph)
        for sight, light in zip(sights, lights, strict=True)
    ]


def _innerness(places: Ints, graph: SurfaceGraph) -> Singles:
    """(N,) 1 well within the places, near 0 at their border, never 0."""
    shown = np.zeros((graph.count, 1), dtype=np.float32)
    shown[places] = 1.0
    share = graph.spread(shown, _WIDTH_M)[places, 0]
    return np.clip(2.0 * share - 1.0, 1e-3, 1.0)


def _spread_among(sight: Sight, values: Floats, graph: SurfaceGraph) -> Singles:
    """(N, 3) values spread along the surface among the places of a sight, by their worth."""
    held = np.zeros((graph.count, 4), dtype=np.float32)
    worth = sight.worth / sight.worth.max(initial=1e-6)
    held[sight.places, :3] = values * worth[:, None]
    held[sight.places, 3] = worth
    spread = graph.spread(held, _WIDTH_M)[sight.places]
    spread[:, :3] /= np.maximum(spread[:, 3:], 1e-9)
    return spread[:, :3]


#: The power of a photo's worth in the blend: high takes the best, low the mean.
_SHARPNESS = 6.0
#: How far a photo's light may be from the others', as a logarithm, before it is doubted.
_DOUBT = 0.25
_ROUNDS = 4
#: Colour of a mesh that no photo shows, linear.
_GREY = 0.2


def coloured(mesh: Mesh, photos: Sequence[Photo]) -> ColouredMesh:
    """The mesh with a colour for each vertex, in the photos' mean exposure.

    Args:
        mesh: World metres, wound outward.
        photos: Any number, of any sizes; their cameras see the same world.

    Raises:
        DataError: no photo.
    """
    if not photos:
        raise DataError(f"{mesh.source} cannot be coloured without photos", expected="at least one")
    colouring = Colouring(mesh, photos)
    return colouring.from_photos(range(len(photos)))


class Colouring:
    """A mesh and what each of some photos shows of it: colours from any choice of the photos."""

    def __init__(self, mesh: Mesh, photos: Sequence[Photo]) -> None:
        self.mesh = mesh
        self.graph = SurfaceGraph(mesh)
        self.caster = Raycaster(mesh.geometry())
        self.sights = tuple(
            sight_of(photo, self.caster, self.graph.positions, self.graph.normals)
            for photo in photos
        )

    def from_photos(self, chosen: Sequence[int]) -> ColouredMesh:
        """The mesh with colours from some of the photos, by their index."""
        sights = [self.sights[index] for index in chosen]
        light, total = _light(sights, self.graph)
        seen = total > 0
        colours = srgb_from_linear(
            linear_light(light) if seen.any() else np.full_like(light, _GREY)
        )
        colours = self.graph.filled(colours, seen)
        pixels = np.round(255.0 * np.clip(colours, 0.0, 1.0)).astype(np.uint8)
        return ColouredMesh(self.mesh, pixels[self.graph.place], seen[self.graph.place])


def _light(sights: Sequence[Sight], graph: SurfaceGraph) -> tuple[Floats, Floats]:
    """(count, 3) logarithm of light at each place, and (count,) weight: 0 where no photo shows."""
    added = gains(sights)
    levelled: list[Singles] = [
        sight.light + gain.astype(np.float32) for sight, gain in zip(sights, added, strict=True)
    ]
    smooth = corrections(sights, levelled, graph)
    lights = [light + change for light, change in zip(levelled, smooth, strict=True)]
    believed = _believed(sights, lights, graph.count)
    best = np.zeros(graph.count, dtype=np.float32)
    for sight, worth in zip(sights, believed, strict=True):
        best[sight.places] = np.maximum(best[sight.places], worth)
    sharp = [
        (worth / best[sight.places]) ** _SHARPNESS
        for sight, worth in zip(sights, believed, strict=True)
    ]
    return blended(sights, lights, sharp, graph.count)


def _believed(sights: Sequence[Sight], lights: Sequence[Singles], count: int) -> list[Singles]:
    """(N,) the worth of each photo at each place, less where it is alone with its colour.

    A photo in which something else lies before the place, because the surface is not exactly where
    it should be, shows another colour than the others do.
    """
    believed = [sight.worth for sight in sights]
    for _ in range(_ROUNDS):
        middle, _ = blended(sights, lights, believed, count)
        believed = []
        for sight, light in zip(sights, lights, strict=True):
            apart = np.abs(light - middle[sight.places]).max(axis=1)
            trust = 1.0 / (1.0 + (apart / _DOUBT) ** 2) ** 2
            believed.append((sight.worth * trust).astype(np.float32))
    return believed


def finer(mesh: Mesh, edge_m: float, most_vertices: int) -> Mesh:
    """The same surface with each face cut into four, and again, until edges are short enough.

    A closed surface stays closed. Texture is dropped.

    Args:
        mesh: World metres.
        edge_m: Wanted median edge. A cut halves it, so that it ends between 0.7 and 1.4 times as
            long, or is shorter because it was.
        most_vertices: The surface is not cut again where it would have more.
    """
    vertices, faces = mesh.vertices, mesh.faces
    while True:
        edges = edges_of(faces)
        if (
            len(vertices) + len(edges.ends) > most_vertices
            or _median(vertices, edges.ends) <= edge_m
        ):
            return Mesh(vertices, faces, source=mesh.source)
        ab, bc, ca = (edges.of_side + len(vertices)).T
        a, b, c = faces.T
        vertices = np.concatenate([vertices, vertices[edges.ends].mean(axis=1)])
        corners = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
        faces = np.concatenate([np.stack(each, axis=1) for each in corners])


def _median(vertices: Floats, ends: AnyInts) -> float:
    return float(np.median(np.linalg.norm(vertices[ends[:, 0]] - vertices[ends[:, 1]], axis=1)))

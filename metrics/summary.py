"""The summary stage: a protocol's columns as numbers with their unit and standard error."""

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from harness.core.arrays import Floats, Ints, Mask, box_of
from harness.core.errors import DataError, HarnessError
from harness.core.files.hashing import derive_seed
from harness.core.protocol_stages import Column
from harness.core.records import MetricValue
from harness.core.settings import MetricProtocol
from harness.core.truth import FaceRegions
from harness.core.units import Unit
from harness.geometry.coinciding import half_edges
from harness.geometry.surface import SurfaceIndex
from metrics.distance import (
    harmonic_mean,
    mean_of_directions,
    near_samples,
    sample_mean,
)
from metrics.normals import angles_deg, compared, normals_at, weighted
from metrics.pair import Placed
from metrics.rendered_normals import Window, rendered_distance

_POINTS, _BATCH = 1_000_000, 250_000
#: So many cells, about, part the space around a surface, and so many at most along an axis.
_CELLS, _MOST_ALONG, _ROUNDED = 2_000_000, 512, 1e-3
#: Along no axis of a scan or a grid, so that a ray meets edges by chance only.
_DIRECTION = np.array([0.3713, 0.8127, 0.4489]) / np.linalg.norm([0.3713, 0.8127, 0.4489])


def volume_iou(predicted: SurfaceIndex, truth: SurfaceIndex, seed: int) -> MetricValue:
    """Volume that two closed surfaces share over the volume of either, from a million points.

    A point is inside where the surface winds around it: where the crossings of a ray out of the
    surface and into it do not cancel.

    Raises:
        DataError: a surface with a hole has no volume.
    """
    for surface in (predicted, truth):
        check_closed(surface)
    low = np.minimum(predicted.bounds[0], truth.bounds[0])
    high = np.maximum(predicted.bounds[1], truth.bounds[1])
    points = low + np.random.default_rng(seed).random((_POINTS, 3)) * (high - low)
    mine, true = inside(predicted, points), inside(truth, points)
    either = int((mine | true).sum())
    share = float((mine & true).sum() / either) if either else 0.0
    error = float(np.sqrt(share * (1 - share) / either)) if either else 0.0
    return MetricValue(share, Unit.ratio.value, either, error)


def inside(surface: SurfaceIndex, points: Floats) -> Mask:
    """(N,) whether the winding number of a closed surface around (N, 3) points is not 0.

    It is the same all over a room of cells that no face touches: one ray tells. Only points in
    cells with faces need rays of their own.
    """
    room_of, first, cell_m = _rooms(surface)
    within, cells = np.ones(len(points), dtype=bool), np.zeros(len(points), dtype=np.int64)
    # By component: rows of three are slow to go through.
    for along, low, high, count in zip(points.T, *surface.bounds, room_of.shape, strict=True):
        along = np.ascontiguousarray(along)
        within &= (along >= low) & (along <= high)
        cells = cells * count + ((along - low) / cell_m).astype(np.int64)
    room = room_of.ravel()[np.where(within, cells, 0)]
    middles = np.stack(np.unravel_index(first, room_of.shape), axis=1) + 0.5
    found = _wound(surface, surface.bounds[0] + middles * cell_m)[room] & within
    near = np.flatnonzero((room == 0) & within)
    found[near] = _wound(surface, points[near])
    return found


def _rooms(surface: SurfaceIndex) -> tuple[Ints, Ints, float]:
    """Cells around a surface: the room that each is in, from 1, and 0 where a face touches it.

    Also a cell of each room, by its place among all, and the side of a cell, metres.
    """
    from scipy.ndimage import label

    extent = surface.extent
    cell_m = max(np.cbrt(extent.prod() / _CELLS), float(extent.max()) / _MOST_ALONG)
    free = np.ones(tuple((extent / cell_m + _ROUNDED).astype(np.int64) + 1), dtype=bool)
    corners = np.ascontiguousarray(surface.mesh.faces.T)
    cells, low, span = np.zeros(len(corners[0]), dtype=np.int64), [], []
    for along, start, count in zip(
        surface.mesh.vertices.T, surface.bounds[0], free.shape, strict=True
    ):
        along = (along - start) / cell_m
        # A little more than a face's box, for rays round.
        least = np.maximum(along - _ROUNDED, 0).astype(np.int32)
        most = (along + _ROUNDED).astype(np.int32)
        low.append(np.minimum.reduce([least[corner] for corner in corners]))
        span.append(np.maximum.reduce([most[corner] for corner in corners]) - low[-1])
        cells = cells * count + low[-1]
    flat = free.ravel()
    flat[cells] = False
    # A face across a border between cells is in both; across two borders, in all four.
    steps, over = (free.shape[1] * free.shape[2], free.shape[2], 1), [each == 1 for each in span]
    for axes in ([0], [1], [2], [0, 1], [0, 2], [1, 2], [0, 1, 2]):
        both = np.logical_and.reduce([over[axis] for axis in axes])
        flat[cells[both] + sum(steps[axis] for axis in axes)] = False
    wide = np.flatnonzero(np.maximum.reduce(span) > 1)
    boxes = (np.stack(each, axis=1)[wide] for each in (low, span))
    for (x, y, z), (right, up, ahead) in zip(*boxes, strict=True):
        free[x : x + right + 1, y : y + up + 1, z : z + ahead + 1] = False
    labelled: Any = label(free)
    rooms: Ints = labelled[0].ravel()
    first = np.zeros(labelled[1] + 1, dtype=np.int64)
    first[rooms[::-1]] = np.arange(len(rooms))[::-1]
    return labelled[0], first, cell_m


def _wound(surface: SurfaceIndex, points: Floats) -> Mask:
    """(N,) whether the crossings of a ray from each point, out and in, do not cancel."""
    found = np.zeros(len(points), dtype=bool)
    for chosen in np.array_split(np.arange(len(points)), -(-len(points) // _BATCH)):
        ray, _, faces, _ = surface.crossings(points[chosen], _DIRECTION)
        outwards = np.sign(surface.face_vectors[faces] @ _DIRECTION)
        found[chosen] = np.bincount(ray, outwards, len(chosen)).round() != 0
    return found


def check_closed(surface: SurfaceIndex) -> None:
    """Refuse a surface with an open edge.

    Raises:
        DataError: the message counts them.
    """
    start, end = half_edges(surface.corners)
    count = int(start.max()) + 1
    there, back = start * count + end, end * count + start
    along, against = np.sort(there[start < end]), np.sort(back[start > end])
    if np.array_equal(along, against):
        return
    _, which = np.unique(np.concatenate([along, against]), return_inverse=True)
    sides = np.repeat([1, -1], [len(along), len(against)])
    raise DataError(
        f"{surface.mesh.source} has no volume",
        expected="a closed surface",
        got=f"{int((np.bincount(which, sides) != 0).sum())} open edges",
        hint="Distances need no closed surface",
    )


def box_iou(predicted: Floats, truth: Floats) -> float:
    """Intersection over union of two (2, 3) boxes, which some papers print as "IoU"."""
    low, high = np.maximum(predicted[0], truth[0]), np.minimum(predicted[1], truth[1])
    shared = float(np.maximum(high - low, 0.0).prod())
    both = sum(float((box[1] - box[0]).prod()) for box in (predicted, truth))
    return shared / (both - shared + 1e-11)


#: Quantities whose two directions share their points, so that they err together.
_TOGETHER = frozenset({"samples", "sample_cosine", "thinned"})
_LENGTHS = frozenset({"surface", "edges", "samples", "thinned"})
#: Where the largest of some sampled values would be by chance: from it to the tenth largest.
_NEXT = 10


#: Parts of a person that X-Avatar measures apart, by the labels of their true faces.
_PARTS = {"hand": ("hands",), "face": ("head", "eyes")}


def part_numbers(
    placed: Placed, protocol: MetricProtocol, regions: FaceRegions
) -> dict[str, MetricValue]:
    """A protocol's columns over hands and over the face alone, as ``hand_cd_mean``.

    A predicted point is of the part that its closest true face is of. A part of which either side
    has no point has no numbers; X-Avatar's program stops there.
    """
    found = {}
    drawn = placed.mine.samples(protocol), placed.true.samples(protocol)
    faces = placed.closest(protocol, back=False)[0].faces, drawn[1].faces
    for part, names in _PARTS.items():
        labels = [regions.names.index(name) for name in names if name in regions.names]
        of_part = tuple(np.isin(regions.of_face[each], labels) for each in faces)
        if not all(each.any() for each in of_part):
            continue
        for column in protocol.columns:
            if column.of == "boxes":
                boxes = [box_of(side.points[on]) for side, on in zip(drawn, of_part, strict=True)]
                number = MetricValue(box_iou(boxes[0], boxes[1]), column.unit, 2, 0.0)
            else:
                number = measured(placed, protocol, column, of_part)
            found[f"{part}_{column.key}"] = number
    return found


def measured(
    placed: Placed,
    protocol: MetricProtocol,
    column: Column,
    chosen: tuple[Mask, ...] | None = None,
) -> MetricValue:
    """One number of a protocol's summary, of all points or of chosen predicted and true ones.

    Raises:
        DataError: nothing to measure: no normals, no distance near enough, a volume with a hole.
    """
    if column.of in ("boxes", "volume", "pictures"):
        return _of_both(placed, protocol, column)
    of_direction = partial(_of_direction, placed, protocol, column, chosen)
    if column.way in ("to_truth", "to_prediction"):
        return of_direction(back=column.way == "to_prediction")
    there, back = of_direction(back=False), of_direction(back=True)
    if column.way == "harmonic":
        return harmonic_mean(there, back)
    return mean_of_directions(there, back, together=column.of in _TOGETHER)


def _of_both(placed: Placed, protocol: MetricProtocol, column: Column) -> MetricValue:
    """A number that is of no points of either side."""
    mine, true = placed.mine.index, placed.true.index
    if column.of == "boxes":
        return MetricValue(box_iou(mine.bounds, true.bounds), column.unit, 2, 0.0)
    if column.of == "volume":
        found = volume_iou(mine, true, derive_seed(protocol.seed, "volume"))
        return replace(found, unit=column.unit)
    if protocol.pictures is None:
        raise HarnessError(f"protocol {protocol.name} does not say how its pictures are made")
    window = Window(float(true.centre[1]), placed.per_metre)
    how = protocol.pictures
    portraits = placed.mine.portraits(window), placed.true.portraits(window)
    value = placed.kept.once(("pictures", window, how), lambda: rendered_distance(*portraits, how))
    return MetricValue(value, column.unit, 4, 0.0)


def _of_direction(
    placed: Placed,
    protocol: MetricProtocol,
    column: Column,
    chosen: tuple[Mask, ...] | None,
    *,
    back: bool,
) -> MetricValue:
    values = _values(placed, protocol, column, back=back)
    values = values if chosen is None else values[chosen[back]]
    factor = column.factor
    if column.of in _LENGTHS:
        factor *= placed.per_metre
        threshold = column.threshold / placed.per_metre
        if protocol.drop_beyond:
            values = _near(values, protocol.drop_beyond / placed.per_metre)
        if column.take in ("below", "within"):
            within = values <= threshold if column.take == "within" else values < threshold
            values, factor = within.astype(np.float64), column.factor
    if column.take == "max":
        largest = np.sort(values * factor)[::-1]
        beside = largest[min(_NEXT, len(largest)) - 1]
        error = float(largest[0] - beside)
        return MetricValue(float(largest[0]), column.unit, len(values), error)
    return sample_mean(values * factor, column.unit, protocol.sampling)


def _values(placed: Placed, protocol: MetricProtocol, column: Column, *, back: bool) -> Floats:
    """(N,) metres, degrees or cosines at the points of one direction."""
    if column.of == "surface":
        return placed.closest(protocol, back=back)[1]
    if column.of == "edges":
        return placed.to_edges(protocol, back=back)
    if column.of == "samples":
        return placed.nearest(protocol, back=back)[0]
    if column.of == "thinned":
        cell_m = column.threshold / placed.per_metre / 2
        points, targets = (side.thinned(protocol, cell_m) for side in placed.sides(back=back))
        is_share = column.take in ("below", "within")
        within = column.threshold / placed.per_metre if is_share else np.inf
        return near_samples(points, targets, within)
    if column.of == "angle":
        return compared(normal_angles(placed, protocol, back=back))
    return placed.cosines(protocol, back=back, of_samples=column.of == "sample_cosine")


def normal_angles(placed: Placed, protocol: MetricProtocol, *, back: bool) -> Floats:
    """(N,) degrees between the smooth normals of the drawn points and of their closest points.

    NaN where one has no direction and the protocol leaves such points out.
    """
    sampled, other = (
        side.smooth(seams=protocol.texture_seams == "split") for side in placed.sides(back=back)
    )
    drawn = placed.sides(back=back)[0].samples(protocol)
    # The published evaluator looks at the prediction alone; what it lacks cannot have its mistake.
    closest = weighted(
        placed.closest(protocol, back=back)[0],
        "barycentric" if back else protocol.normal_weights,
    )
    cancelled = protocol.cancelled_normals
    return placed.kept.once(
        ("angles", back, protocol),
        lambda: angles_deg(
            normals_at(sampled, drawn, cancelled), normals_at(other, closest, cancelled)
        ),
    )


def _near(values: Floats, farthest: float) -> Floats:
    near = values[values < farthest]
    if not len(near):
        raise DataError(
            "there is no distance to average",
            expected=f"points nearer than {farthest * 1000:g} mm to the other surface",
            got=f"{values.min() * 1000:g} mm at least",
        )
    return near

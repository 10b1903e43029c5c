"""Surfaces of a page, small enough to send."""

from __future__ import annotations

import base64
import gzip
import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import AnyInts, Floats, Ints
from harness.core.errors import DataError
from harness.core.mesh import Mesh

#: Grows when the form changes, so that no page reads an older file.
COMPACT_VERSION = 1

_STEPS = 65535
_COMPRESSION = 6


@dataclass(frozen=True, slots=True, eq=False)
class ScalarColumn:
    """One number per vertex that the page can show as a colour.

    Attributes:
        id: Such as ``distance``.
        values: (V,) not negative; a vertex that has none is NaN.
        step: Values are rounded to multiples of it, and end at 65534 of them.
    """

    id: str
    values: Floats
    step: float


@dataclass(frozen=True, slots=True)
class CompactScalar:
    """How a stored column becomes numbers again: ``step`` times the integer; 65535 is none."""

    id: str
    step: float


@dataclass(frozen=True, slots=True)
class CompactMesh:
    """A mesh in the compact form.

    Attributes:
        vertices, faces: How many there are.
        low: (x, y, z) of the grid's origin, metres.
        step_m: The grid's step: no coordinate is off by more than half of it.
        scalars: The columns after the mesh, in order.
        payload: The byte planes, compressed and in base64.
    """

    vertices: int
    faces: int
    low: tuple[float, float, float]
    step_m: float
    scalars: tuple[CompactScalar, ...] = field(default_factory=tuple)
    payload: str = ""

    @classmethod
    def of(cls, mesh: Mesh, columns: tuple[ScalarColumn, ...] = ()) -> CompactMesh:
        """The compact form of the vertices that faces use; equal meshes give equal bytes.

        Raises:
            DataError: a column that is not of the mesh, has a step that is not positive, or has a
                negative value.
        """
        for column in columns:
            _check(column, mesh)
        order, corners = _by_first_use(mesh.faces)
        positions = mesh.vertices[order]
        low = positions.min(axis=0)
        step_m = float((positions.max(axis=0) - low).max()) / _STEPS or 1.0
        grid = np.round((positions - low) / step_m).astype(np.int32)
        folded = _folded(np.diff(grid, axis=0, prepend=0))
        planes = [
            *(_planes(folded[:, axis].astype("<u2")) for axis in range(3)),
            _planes(_below_next(corners).astype("<u4")),
            *(_planes(_steps(column, order)) for column in columns),
        ]
        packed = gzip.compress(b"".join(planes), compresslevel=_COMPRESSION, mtime=0)
        return cls(
            vertices=len(order),
            faces=len(mesh.faces),
            low=(float(low[0]), float(low[1]), float(low[2])),
            step_m=step_m,
            scalars=tuple(CompactScalar(column.id, column.step) for column in columns),
            payload=base64.b64encode(packed).decode("ascii"),
        )

    def decoded(self) -> tuple[Mesh, Mapping[str, Floats]]:
        """The mesh and its columns by id, as the page's own code decodes them."""
        data = gzip.decompress(base64.b64decode(self.payload))
        count, corners = self.vertices, 3 * self.faces
        place = 0
        columns: list[NDArray[np.int64]] = []
        for size, width in [(count, 2)] * 3 + [(corners, 4)] + [(count, 2)] * len(self.scalars):
            columns.append(_joined(data[place : place + size * width], size, width))
            place += size * width
        grid = np.stack([np.cumsum(_unfolded(column)) % 65536 for column in columns[:3]], axis=1)
        vertices = np.asarray(self.low, dtype=np.float64) + grid * np.float64(self.step_m)
        mesh = Mesh(vertices, _from_next(columns[3]).reshape(-1, 3), source="compact mesh")
        values = {
            scalar.id: np.where(stored == _STEPS, np.nan, stored * scalar.step)
            for scalar, stored in zip(self.scalars, columns[4:], strict=True)
        }
        return mesh, values


def _check(column: ScalarColumn, mesh: Mesh) -> None:
    expected = (len(mesh.vertices),)
    if column.values.shape != expected or not (column.step > 0 and math.isfinite(column.step)):
        raise DataError(
            f"the column '{column.id}' does not fit {mesh.source}",
            expected=f"shape {expected} and a positive step",
            got=f"shape {column.values.shape} and step {column.step:g}",
        )
    if (column.values < 0).any() or np.isinf(column.values).any():
        raise DataError(
            f"the column '{column.id}' of {mesh.source} has values that no colour stands for",
            expected="finite and not negative, or NaN",
        )


def _by_first_use(faces: AnyInts) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(U,) the old numbers of the used vertices in their new order, and (3F,) new corners."""
    flat = faces.ravel().astype(np.int64)
    used, first, inverse = np.unique(flat, return_index=True, return_inverse=True)
    rank = np.argsort(first, kind="stable")
    new = np.empty(len(used), dtype=np.int64)
    new[rank] = np.arange(len(used))
    return used[rank], new[inverse.ravel()]


def _below_next(corners: NDArray[np.int64]) -> NDArray[np.int64]:
    """(3F,) how far each corner lies below the first number that was not used before it."""
    following = np.maximum.accumulate(corners) + 1
    before = np.concatenate([[0], following[:-1]])
    return before - corners


def _from_next(codes: NDArray[np.int64]) -> NDArray[np.int64]:
    is_new = codes == 0
    return np.cumsum(is_new) - is_new - codes


def _folded(differences: NDArray[np.int32]) -> NDArray[np.int32]:
    """0, -1, 1, -2, ... as 0, 1, 2, 3, ..., of differences modulo 65536."""
    wrapped = (differences + 32768) % 65536 - 32768
    return np.where(wrapped < 0, -2 * wrapped - 1, 2 * wrapped)


def _unfolded(folded: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.where(folded % 2, -(folded + 1) // 2, folded // 2)


def _steps(column: ScalarColumn, order: NDArray[np.int64]) -> NDArray[np.uint16]:
    values = column.values[order]
    stored = np.full(len(values), _STEPS, dtype="<u2")
    known = ~np.isnan(values)
    stored[known] = np.minimum(np.round(values[known] / column.step), _STEPS - 1)
    return stored


def _planes(column: NDArray[np.unsignedinteger]) -> bytes:
    """All lowest bytes, then all bytes above them, and so on."""
    return np.ascontiguousarray(column).view(np.uint8).reshape(len(column), -1).T.tobytes()


def _joined(data: bytes, size: int, width: int) -> NDArray[np.int64]:
    planes = np.frombuffer(data, dtype=np.uint8).reshape(width, size).astype(np.int64)
    return sum((planes[k] << (8 * k) for k in range(width)), np.zeros(size, dtype=np.int64))


#: About how many faces a coarse mesh has.
COARSE_FACES = 25_000
#: A mesh with fewer faces than this many times as many is drawn as it is.
_WORTH = 2.0
#: How many lattices are tried before the one that is taken.
_TRIALS = 2


def coarse_mesh(
    mesh: Mesh, columns: tuple[ScalarColumn, ...] = (), about: int = COARSE_FACES
) -> CompactMesh | None:
    """A mesh of fewer faces with the columns' means; None where that would not save half of them.

    Args:
        mesh: Any, open ones as well.
        columns: By vertex of the mesh; a vertex that has no value has no part in a mean.
        about: How many faces are wanted.
    """
    if len(mesh.faces) < _WORTH * about:
        return None
    used = np.zeros(len(mesh.vertices), dtype=bool)
    used[mesh.faces.ravel()] = True
    points, corners = mesh.vertices[used], (np.cumsum(used) - 1)[mesh.faces]
    cell = float(np.ptp(points, axis=0).max()) / math.sqrt(about)
    for _ in range(_TRIALS):
        # The number of faces falls with the square of the cell's side.
        count = len(_joined_coarse_mesh(corners, _cells(points, cell)))
        cell *= math.sqrt(max(count, 1) / about)
    cells = _cells(points, cell)
    faces = _joined_coarse_mesh(corners, cells)
    if not 0 < len(faces) <= len(mesh.faces) / _WORTH:
        return None
    return CompactMesh.of(
        Mesh(np.stack([_means(axis, cells) for axis in points.T], axis=1), faces),
        tuple(ScalarColumn(c.id, _means(c.values[used], cells), c.step) for c in columns),
    )


def _cells(points: Floats, cell: float) -> Ints:
    """(V,) the number of each point's cell, without gaps."""
    place = np.floor((points - points.min(axis=0)) / cell).astype(np.int64)
    sides = place.max(axis=0) + 1
    return np.unique(np.ravel_multi_index(tuple(place.T), tuple(sides)), return_inverse=True)[1]


def _joined_coarse_mesh(corners: Ints, cells: Ints) -> Ints:
    """(F, 3) the faces that have corners in three cells, in their order."""
    joined = cells[corners]
    a, b, c = joined.T
    return joined[(a != b) & (b != c) & (a != c)]


def _means(values: Floats, cells: Ints) -> Floats:
    """The mean of each cell's values; NaN for a cell without any."""
    known = ~np.isnan(values)
    size = int(cells.max()) + 1
    total = np.bincount(cells[known], values[known], size)
    count = np.bincount(cells[known], minlength=size)
    return np.divide(total, count, out=np.full(size, np.nan), where=count > 0)

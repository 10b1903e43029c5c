"""Meshes in a compact form that a browser decodes fast: about 6 bytes a triangle, errors included.

The form, before ``gzip`` and ``base64``, is a row of byte planes: all lowest bytes of a column,
then all bytes above them. Planes of slowly changing numbers compress well.

1. Positions: three columns of 16-bit steps of one grid. Each number is the difference from the
   vertex before, folded so that small differences of both signs are small numbers.
2. Corners: one column of 32-bit numbers. Vertices are numbered in the order in which faces first
   use them. A corner is ``next - index``, where ``next`` is the first number that was not used yet;
   it grows by one at each 0.
3. Scalars: one column of 16-bit steps for each.
"""

from __future__ import annotations

import base64
import gzip
import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import AnyInts, Floats
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

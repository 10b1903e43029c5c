"""The triangle mesh that every room passes around."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import AnyInts, Floats, box_of
from harness.core.errors import DataError

_SAFE_COORDINATE = 1e100
_FEW_FACES = 1000


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """A triangle mesh that was checked when it was made.

    Texture coordinates have their own indices, as in OBJ, so that a texture seam does not split
    vertices and vertex normals stay smooth across it.

    Attributes:
        vertices: (V, 3) positions; metres in the world frame unless the holder says otherwise.
        faces: (F, 3) vertex indices, counter-clockwise seen from outside; held as int32.
        uv: (T, 2) texture coordinates, origin at the bottom left, or None.
        face_uv: (F, 3) indices into ``uv``, or None.
        texture: Image file of the texture, or None.
        source: What the mesh is called in messages, usually its file.

    Raises:
        DataError: no vertices or faces, a non-finite vertex, an index that is not a whole number
            or out of range, no surface.
    """

    vertices: Floats
    faces: AnyInts
    uv: Floats | None = None
    face_uv: AnyInts | None = None
    texture: Path | None = None
    source: str = "mesh"

    def __post_init__(self) -> None:
        self._hold("vertices", "uv", dtype=np.float64)
        self._check_shapes()
        self._check_values()
        self._check_indices()
        # Not before the check: the cast would wrap an index that is out of range.
        self._hold("faces", "face_uv", dtype=np.int32)
        if not self._has_measurable_surface():
            raise DataError(
                f"{self.source} has no measurable surface",
                expected="a positive area",
                got=f"{len(self.faces)} faces of total area {self.area:g}",
            )

    def _hold(self, *names: str, dtype: type[np.generic]) -> None:
        for name in names:
            array = getattr(self, name)
            if array is not None:
                object.__setattr__(self, name, np.ascontiguousarray(array, dtype=dtype))

    def _check_shapes(self) -> None:
        if self.faces.ndim != 2 or self.faces.shape[1] != 3 or len(self.faces) == 0:
            raise DataError(
                f"{self.source} has no faces",
                expected="at least one triangle",
                got=f"faces of shape {self.faces.shape} on {len(self.vertices)} vertices",
                hint="A point cloud has to be meshed before it can be measured",
            )
        if self.vertices.ndim != 2 or self.vertices.shape[1] != 3 or len(self.vertices) == 0:
            raise DataError(
                f"{self.source} has no usable vertices",
                expected="an array (V, 3)",
                got=str(self.vertices.shape),
            )
        if (self.uv is None) != (self.face_uv is None):
            raise DataError(f"{self.source} has texture coordinates without their indices")
        if self.uv is not None and (self.uv.ndim != 2 or self.uv.shape[1] != 2):
            raise DataError(
                f"{self.source} has no usable texture coordinates",
                expected="an array (T, 2)",
                got=str(self.uv.shape),
            )
        if self.face_uv is not None and self.face_uv.shape != self.faces.shape:
            raise DataError(
                f"{self.source} has faces without texture coordinates",
                expected=str(self.faces.shape),
                got=str(self.face_uv.shape),
            )

    def _check_values(self) -> None:
        for name, kind, points in (
            ("vertices", "vertex", self.vertices),
            ("texture coordinates", "texture coordinate", self.uv),
        ):
            if points is None:
                continue
            finite = np.isfinite(points).all(axis=1)
            if not finite.all():
                first = int(np.argmin(finite))
                raise DataError(
                    f"{self.source} has {int((~finite).sum())} non-finite {name}",
                    expected="finite coordinates",
                    got=f"{kind} {first} = {points[first].tolist()}",
                    hint="Repair or remove them; they are never skipped in silence",
                )

    def _check_indices(self) -> None:
        for name, indices, target in (
            ("vertex", self.faces, self.vertices),
            ("texture", self.face_uv, self.uv),
        ):
            if indices is None or target is None:
                continue
            if not np.issubdtype(indices.dtype, np.integer):
                raise DataError(f"{self.source} has a {name} index that is not a whole number")
            low, high = int(indices.min()), int(indices.max())
            if low < 0 or high >= len(target):
                raise DataError(
                    f"{self.source} has a {name} index out of range",
                    expected=f"0 to {len(target) - 1}",
                    got=str(low if low < 0 else high),
                )

    def _has_measurable_surface(self) -> bool:
        """Whether the total area is positive and finite; a few faces usually tell."""
        # The squared coordinates of any face stay finite below this, and so does the sum of areas.
        if np.abs(self.vertices).max() < _SAFE_COORDINATE:
            few = _face_vectors(self.vertices, self.faces[:_FEW_FACES])
            if np.linalg.norm(few, axis=1).sum() > 0:
                return True
        return 0 < self.area < np.inf

    @property
    def bounds(self) -> Floats:
        """(2, 3) lower and upper corner of the bounding box of the vertices that faces use."""
        is_used = np.zeros(len(self.vertices), dtype=bool)
        is_used[self.faces] = True
        used = self.vertices[is_used]
        return box_of(used)

    @property
    def extent(self) -> Floats:
        """(3,) side lengths of the bounding box."""
        low, high = self.bounds
        return high - low

    def face_normals(self) -> Floats:
        """(F, 3) face normals times twice the area; zero for a degenerate face."""
        return _face_vectors(self.vertices, self.faces)

    def face_areas(self) -> Floats:
        """(F,) triangle areas."""
        with np.errstate(over="ignore"):
            return 0.5 * np.linalg.norm(self.face_normals(), axis=1)

    @property
    def area(self) -> float:
        """Total surface area."""
        return float(self.face_areas().sum())

    @property
    def signed_volume(self) -> float:
        """Enclosed volume if closed; negative when the faces are wound inside out."""
        centred = self.vertices - self.vertices.mean(axis=0)
        a, b, c = (centred[self.faces[:, corner]] for corner in range(3))
        return float((a * np.cross(b, c)).sum() / 6.0)

    def transformed(self, transform: Floats) -> Mesh:
        """The mesh moved by a (4, 4) similarity transform."""
        moved = self.vertices @ transform[:3, :3].T + transform[:3, 3]
        return replace(self, vertices=moved)

    def submesh(self, keep: NDArray[np.bool_]) -> Mesh:
        """The faces where ``keep`` (F,) is true, with the vertices that they use."""
        faces = self.faces[keep]
        used = np.unique(faces)
        renumbered = np.zeros(len(self.vertices), dtype=np.int32)
        renumbered[used] = np.arange(len(used), dtype=np.int32)
        face_uv = None if self.face_uv is None else self.face_uv[keep]
        return replace(self, vertices=self.vertices[used], faces=renumbered[faces], face_uv=face_uv)

    def geometry(self) -> Mesh:
        """The same surface without texture."""
        return replace(self, uv=None, face_uv=None, texture=None)


def _face_vectors(vertices: Floats, faces: AnyInts) -> Floats:
    """(F, 3) cross products of two edges of each face."""
    a, b, c = (vertices.take(faces[:, corner], axis=0) for corner in range(3))
    u, w = b - a, c - a
    vectors = np.empty_like(u)
    # Coordinates too large to be squared give an area that is infinite, which is refused. By
    # component, this is the same to the last bit as numpy's cross product and twice as fast.
    with np.errstate(over="ignore", invalid="ignore"):
        for axis, (p, q) in enumerate(((1, 2), (2, 0), (0, 1))):
            vectors[:, axis] = u[:, p] * w[:, q] - u[:, q] * w[:, p]
    return vectors

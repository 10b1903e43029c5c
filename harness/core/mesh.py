"""The triangle mesh that every room passes around."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from harness.core.errors import DataError

__all__ = ["Mesh"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int32]


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """A triangle mesh that was checked when it was made.

    Texture coordinates have their own indices, as in OBJ, so that a texture seam does not split
    vertices and vertex normals stay smooth across it.

    Attributes:
        vertices: (V, 3) positions; metres in the world frame unless the holder says otherwise.
        faces: (F, 3) vertex indices, counter-clockwise seen from outside.
        uv: (T, 2) texture coordinates, origin at the bottom left, or None.
        face_uv: (F, 3) indices into ``uv``, or None.
        texture: Image file of the texture, or None.
        source: What the mesh is called in messages, usually its file.

    Raises:
        DataError: no vertices or faces, a non-finite vertex, an index out of range, no surface.
    """

    vertices: Floats
    faces: Indices
    uv: Floats | None = None
    face_uv: Indices | None = None
    texture: Path | None = None
    source: str = "mesh"

    def __post_init__(self) -> None:
        for name, kind in (
            ("vertices", np.float64),
            ("uv", np.float64),
            ("faces", np.int32),
            ("face_uv", np.int32),
        ):
            array = getattr(self, name)
            if array is not None:
                object.__setattr__(self, name, np.ascontiguousarray(array, dtype=kind))
        self._check_shapes()
        self._check_values()

    def _check_shapes(self) -> None:
        if self.vertices.ndim != 2 or self.vertices.shape[1] != 3 or len(self.vertices) == 0:
            raise DataError(
                f"{self.source} has no usable vertices",
                expected="an array (V, 3)",
                got=str(self.vertices.shape),
            )
        if self.faces.ndim != 2 or self.faces.shape[1] != 3 or len(self.faces) == 0:
            raise DataError(
                f"{self.source} has no faces",
                expected="at least one triangle",
                got=f"faces of shape {self.faces.shape} on {len(self.vertices)} vertices",
                hint="A point cloud has to be meshed before it can be measured",
            )
        if (self.uv is None) != (self.face_uv is None):
            raise DataError(f"{self.source} has texture coordinates without their indices")
        if self.face_uv is not None and self.face_uv.shape != self.faces.shape:
            raise DataError(
                f"{self.source} has faces without texture coordinates",
                expected=str(self.faces.shape),
                got=str(self.face_uv.shape),
            )

    def _check_values(self) -> None:
        finite = np.isfinite(self.vertices).all(axis=1)
        if not finite.all():
            raise DataError(
                f"{self.source} has {int((~finite).sum())} non-finite vertices",
                expected="finite coordinates",
                got=f"vertex {int(np.argmin(finite))} = {self.vertices[int(np.argmin(finite))]}",
                hint="Repair or remove them; they are never skipped in silence",
            )
        for indices, target, name in (
            (self.faces, self.vertices, "vertex"),
            (self.face_uv, self.uv, "texture"),
        ):
            if indices is None or target is None:
                continue
            low, high = int(indices.min()), int(indices.max())
            if low < 0 or high >= len(target):
                raise DataError(
                    f"{self.source} has a {name} index out of range",
                    expected=f"0 to {len(target) - 1}",
                    got=f"{low if low < 0 else high}",
                )
        if not self.area > 0:
            raise DataError(
                f"{self.source} has no surface: all {len(self.faces)} faces have zero area"
            )

    @property
    def bounds(self) -> Floats:
        """(2, 3) lower and upper corner of the bounding box of the vertices that faces use."""
        used = self.vertices[np.unique(self.faces)]
        return np.stack([used.min(axis=0), used.max(axis=0)])

    @property
    def extent(self) -> Floats:
        """(3,) side lengths of the bounding box."""
        low, high = self.bounds
        return high - low

    def face_normals(self) -> Floats:
        """(F, 3) face normals times twice the area; zero for a degenerate face."""
        a, b, c = (self.vertices[self.faces[:, corner]] for corner in range(3))
        return np.cross(b - a, c - a)

    def face_areas(self) -> Floats:
        """(F,) triangle areas."""
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
        return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)

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

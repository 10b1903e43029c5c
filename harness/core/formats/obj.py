"""Wavefront OBJ: fast to read with numpy, texture indices kept apart from vertex indices."""

from __future__ import annotations

import re
import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from harness.core.errors import DataError
from harness.core.files import atomic_path
from harness.core.mesh import Mesh

__all__ = ["read_obj", "write_obj"]

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


def read_obj(path: Path, *, texture: bool) -> Mesh:
    """The mesh of an OBJ file; polygons are cut into fans, ``vn`` records are ignored.

    Args:
        path: The ``.obj`` file.
        texture: Whether the texture is wanted; then its image file must exist.

    Raises:
        DataError: unreadable numbers, mixed face layouts, several materials or no image although
            a texture is wanted.
    """
    text = path.read_bytes().replace(b"\r", b"").replace(b"\\\n", b" ")
    vertices = _numbers(re.findall(rb"^v[ \t]+(.*)$", text, re.MULTILINE), path, "v", np.float64)
    corners = _Corners(re.findall(rb"^f[ \t]+(.*)$", text, re.MULTILINE), path)
    faces = corners.triangles(0, len(vertices))
    if not texture:
        return Mesh(vertices=vertices[:, :3], faces=faces, source=str(path))
    uv = _numbers(re.findall(rb"^vt[ \t]+(.*)$", text, re.MULTILINE), path, "vt", np.float64)
    if len(uv) == 0 or corners.layout not in ("v/vt", "v/vt/vn"):
        raise DataError(
            f"{path} has no texture coordinates",
            expected="vt records and faces of the form v/vt",
            got=f"{len(uv)} vt records, faces of the form {corners.layout}",
        )
    return Mesh(
        vertices=vertices[:, :3],
        faces=faces,
        uv=uv[:, :2],
        face_uv=corners.triangles(1, len(uv)),
        texture=_texture_image(path, text),
        source=str(path),
    )


def _numbers(lines: list[bytes], path: Path, record: str, kind: type) -> NDArray[np.float64]:
    """(lines, columns) of the numbers in equal-length lines."""
    if not lines:
        return np.zeros((0, 3), dtype=kind)
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)
        try:
            values = np.fromstring(b" ".join(lines), dtype=kind, sep=" ")
        except (DeprecationWarning, ValueError):
            values = np.zeros(0)
    columns, rest = divmod(len(values), len(lines))
    if rest or columns < 2 + (record == "v"):
        raise DataError(
            f"{path} has a '{record}' line that is not numbers",
            expected="the same count of numbers on every such line",
            got=_first_odd_line(lines),
        )
    return values.reshape(len(lines), columns)


def _first_odd_line(lines: list[bytes]) -> str:
    usual = len(lines[0].split())
    for line in lines:
        words = line.split()
        try:
            [float(word) for word in words]
        except ValueError:
            return repr(line.decode(errors="replace"))
        if len(words) != usual:
            return repr(line.decode(errors="replace"))
    return repr(lines[0].decode(errors="replace"))


class _Corners:
    """The corners of all faces as one table of indices, with how many corners each face has."""

    def __init__(self, lines: list[bytes], path: Path) -> None:
        self.path = path
        joined = b" ".join(lines)
        first = lines[0].split()[0] if lines and lines[0].split() else b""
        self.layout = {0: "v", 1: "v/vt", 2: "v//vn" if b"//" in first else "v/vt/vn"}.get(
            first.count(b"/"), "unknown"
        )
        per_corner = {"v": 1, "v/vt": 2, "v//vn": 2, "v/vt/vn": 3}.get(self.layout, 0)
        self.counts = np.fromiter(
            map(len, map(bytes.split, lines)), dtype=np.int64, count=len(lines)
        )
        slashes = joined.count(b"/")
        table = _numbers([joined.replace(b"/", b" ")], path, "f", np.int64) if lines else None
        corners = int(self.counts.sum())
        if lines and (
            table is None
            or self.counts.min() < 3
            or table.size != corners * per_corner
            or slashes != corners * first.count(b"/")
        ):
            raise DataError(
                f"{path} has a face that cannot be read",
                expected=f"at least three corners of the form {self.layout} on every f line",
                got=f"{corners} corners in {len(lines)} faces of mixed or broken form",
            )
        self.table = np.zeros((0, 1), np.int64) if table is None else table.reshape(-1, per_corner)

    def triangles(self, column: int, available: int) -> Integers:
        """(F, 3) zero-based indices of one column; negative ones count from the end."""
        indices = self.table[:, column]
        if len(indices) and int(np.abs(indices).min()) == 0:
            raise DataError(f"{self.path} has a face index 0; OBJ counts from 1")
        indices = np.where(indices > 0, indices - 1, indices + available)
        if len(self.counts) == 0 or (self.counts == 3).all():
            return indices.reshape(-1, 3)
        starts = np.concatenate([[0], np.cumsum(self.counts)[:-1]])
        fans = self.counts - 2
        first = np.repeat(starts, fans)
        step = np.arange(int(fans.sum())) - np.repeat(np.cumsum(fans) - fans, fans)
        return indices[np.stack([first, first + step + 1, first + step + 2], axis=1)]


def _texture_image(path: Path, text: bytes) -> Path:
    """The image of the OBJ's only textured material."""
    libraries = [name.decode().strip() for name in re.findall(rb"^mtllib[ \t]+(.*)$", text, re.MULTILINE)]
    images: list[str] = []
    for library in libraries:
        material_file = path.parent / library
        if not material_file.is_file():
            raise DataError(
                f"{path} names a material file that is not there", expected=str(material_file)
            )
        content = material_file.read_text(encoding="utf-8", errors="replace")
        images += [
            # Options such as -s 1 1 1 may stand before the file's name, which comes last.
            line.split(maxsplit=1)[1].split(" -")[-1].strip()
            for line in content.splitlines()
            if line.strip().lower().startswith("map_kd")
        ]
    distinct = sorted(set(images))
    if len(distinct) != 1:
        raise DataError(
            f"{path} cannot be textured",
            expected="one map_Kd image in its material files",
            got=", ".join(distinct) or "none",
        )
    image = path.parent / distinct[0]
    if not image.is_file():
        raise DataError(
            f"the texture of {path} is missing",
            expected=str(image),
            hint="Copy the image next to the mesh, as it is in the dataset's archive",
        )
    return image


def write_obj(path: Path, mesh: Mesh, *, material: str = "material0") -> None:
    """Write an OBJ atomically; with texture coordinates it refers to ``material0.mtl``.

    The material file and image are the caller's: the OBJ only names them.
    """
    lines = ["v {:.6f} {:.6f} {:.6f}".format(*vertex) for vertex in mesh.vertices.tolist()]
    if mesh.uv is not None and mesh.face_uv is not None:
        lines.insert(0, f"mtllib {material}.mtl")
        lines += ["vt {:.6f} {:.6f}".format(*uv) for uv in mesh.uv.tolist()]
        lines.append(f"usemtl {material}")
        corners = np.stack([mesh.faces, mesh.face_uv], axis=-1).reshape(len(mesh.faces), 6) + 1
        lines += ["f {}/{} {}/{} {}/{}".format(*face) for face in corners.tolist()]
    else:
        lines += ["f {} {} {}".format(*face) for face in (mesh.faces + 1).tolist()]
    with atomic_path(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="ascii")

"""Wavefront OBJ: fast to read with numpy, texture indices kept apart from vertex indices."""

import codecs
import re
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Bytes, Floats, Ints
from harness.core.errors import DataError
from harness.core.files.atomic import atomic_path
from harness.core.mesh import Mesh
from harness.files.coloured_mesh import FileColours
from harness.files.mtl import decoded, texture_image
from harness.files.polygons import cut_polygons

Number = TypeVar("Number", np.float64, np.int64)

_NEWLINE, _SPACE, _TAB, _SLASH, _POINT, _MINUS = b"\n \t/.-"
#: Whole numbers with this many digits, and 10 to this power, are exact in float64.
_EXACT_DIGITS, _MOST_SHOWN = 15, 100
#: Surfaces that are no polygons, other files, and keywords that only other programs write.
_REFUSED = (b"surf", b"call", b"fo", b"F", b"V")
#: What else than a letter lines start with: comments, and what programs write as such.
_MARKS, _LAST_DIGIT, _DELETE = b"#$!%&;/", ord("9"), 127


def read_obj(path: Path, *, texture: bool, seams: bool = False) -> Mesh:
    """The mesh of an OBJ file; polygons become triangles, ``vn`` records are ignored.

    Args:
        path: The ``.obj`` file.
        texture: Whether the texture is wanted; then its image file must exist.
        seams: Whether texture coordinates are wanted if there are any, with no image.

    Raises:
        DataError: unreadable numbers, mixed face layouts, several materials or no image although
            a texture is wanted.
    """
    return _ObjFile(path).mesh(texture=texture, seams=seams)


def read_obj_colours(path: Path) -> FileColours:
    """The mesh of an OBJ file with the names of its materials and the colours of its vertices.

    Name 0 is empty: that of faces before any ``usemtl``.

    Raises:
        DataError: as ``read_obj``; no colours in the numbers after coordinates.
    """
    file = _ObjFile(path)
    part = file.records.count_before(b"usemtl", b"f")
    return FileColours(
        file.mesh(texture=False, seams=True),
        np.repeat(part, file.corners.counts - 2),
        ("", *file.records.texts(b"usemtl")),
        _vertex_colours(file.vertices[:, 3:], path),
    )


def _vertex_colours(columns: Floats, path: Path) -> Bytes | None:
    """(V, 3) uint8 of what follows coordinates, from 0 to 1 or 0 to 255; None if nothing does."""
    width = columns.shape[1]
    if width in (0, 1):
        return None
    whole = 255 if columns.max() > 1 else 1
    # Seven numbers have a weight before the colour, or an opacity after it.
    first, last = (columns[:, end] for end in (0, -1))
    if width == 4 and (first == 1).all() != (last == whole).all():
        columns = columns[:, 1:] if (first == 1).all() else columns[:, :3]
        whole = 255 if columns.max() > 1 else 1
    is_sound = columns.shape[1] == 3 and columns.min() >= 0 and columns.max() <= whole
    if not is_sound or (whole > 1 and (columns % 1 != 0).any()):
        raise DataError(
            f"{path} has vertices with {width} numbers after x, y, z that are no colours",
            expected="red, green and blue, all from 0 to 1 or all whole numbers from 0 to 255",
            got=f"{columns.min():g} to {columns.max():g}",
        )
    return np.round(columns * (255 / whole)).astype(np.uint8)


class _ObjFile:
    """An OBJ file with its vertices (V, 3 or more) and corners."""

    def __init__(self, path: Path) -> None:
        self.path, self.records = path, _Records(path.read_bytes())
        for keyword in _REFUSED:
            if self.records.are(keyword).any():
                raise DataError(
                    f"{path} has '{keyword.decode()}' records, which are not read",
                    expected="v, vt and f records in small letters, and all of them in this file",
                    hint="Export it again as a mesh of polygons",
                )
        if odd := self.records.first_odd():
            raise DataError(f"{path} has a line that is no record of the format", got=odd)
        self.vertices = _numbers(self.records.lines(b"v"), path, "v")
        self.corners = _Corners(self.records, path)

    def mesh(self, *, texture: bool, seams: bool) -> Mesh:
        corners, path = self.corners, self.path
        faces = corners.indices(0, b"v")
        try:
            cut = cut_polygons(self.vertices[:, :3], faces, corners.counts)
        except DataError as error:
            raise error.located(path) from error
        geometry = Mesh(self.vertices[:, :3], faces[cut], source=str(path))
        has_coordinates = corners.layout in ("v/vt", "v/vt/vn")
        if not texture and not (seams and has_coordinates):
            return geometry
        uv = _numbers(self.records.lines(b"vt"), path, "vt")
        if len(uv) == 0 or not has_coordinates:
            raise DataError(
                f"{path} has no texture coordinates",
                expected="vt records and faces of the form v/vt",
                got=f"{len(uv)} vt records, faces of the form {corners.layout}",
            )
        mapped = replace(geometry, uv=uv[:, :2], face_uv=corners.indices(1, b"vt")[cut])
        return replace(mapped, texture=texture_image(path)) if texture else mapped


class _Records:
    """An OBJ file's lines by their keyword, found with array operations instead of one by one."""

    def __init__(self, text: bytes) -> None:
        text = text.removeprefix(codecs.BOM_UTF8)
        if b"\r" in text:
            text = text.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
        if b"\\\n" in text:
            text = text.replace(b"\\\n", b" ")
        if b"\n " in text or b"\n\t" in text or text[:1].isspace():
            text = re.sub(rb"^[ \t]+", b"", text, flags=re.MULTILINE)
        self._text: Bytes = np.frombuffer(text if text.endswith(b"\n") else text + b"\n", np.uint8)
        ends = np.flatnonzero(self._text == _NEWLINE) + 1
        self._starts = np.concatenate([[0], ends[:-1]])
        self._lengths = ends - self._starts
        self._first = self._text[self._starts]

    def lines(self, keyword: bytes) -> Bytes:
        """The bytes of all lines of a keyword, which is blanked; each line ends with a newline."""
        chosen = self.are(keyword)
        lengths = self._lengths[chosen]
        if len(lengths) and chosen[(first := int(np.argmax(chosen))) :][: len(lengths)].all():
            # Usually one block, which is copied faster in one piece.
            start = self._starts[first]
            found = self._text[start : start + lengths.sum()].copy()
        else:
            found = self._text[np.repeat(chosen, self._lengths)]
        heads = np.cumsum(lengths) - lengths
        for offset in range(len(keyword)):
            found[heads + offset] = _SPACE
        return found

    def texts(self, keyword: bytes) -> list[str]:
        """The text after a keyword, line by line."""
        return [decoded(line).strip() for line in self.lines(keyword).tobytes().splitlines()]

    def first_odd(self) -> str:
        """The first line that may be a part of the surface, and has no keyword; empty if none."""
        first = self._first
        second = self._text[np.minimum(self._starts + 1, len(self._text) - 1)]
        odd = ((first <= _LAST_DIGIT) | (first >= _DELETE)) & (first != _NEWLINE)
        odd &= ~np.isin(first, np.frombuffer(_MARKS, np.uint8))
        odd |= ((first == ord("v")) | (first == ord("f"))) & (
            (second <= _LAST_DIGIT) & (second != _SPACE) & (second != _TAB) | (second >= _DELETE)
        )
        if not odd.any():
            return ""
        start = int(self._starts[np.argmax(odd)])
        return _first_odd_line(self._text[start : start + _MOST_SHOWN + 1], lambda _: False)

    def count_before(self, keyword: bytes, later: bytes) -> Ints:
        """How many lines of a keyword come before each line of another one."""
        return np.cumsum(self.are(keyword), dtype=np.int64)[self.are(later)]

    def are(self, keyword: bytes) -> NDArray[np.bool_]:
        """Which lines have a keyword."""
        chosen = self._first == keyword[0]
        starts, last = self._starts[chosen], len(self._text) - 1
        after = self._text[np.minimum(starts + len(keyword), last)]
        are = (after == _SPACE) | (after == _TAB)
        for offset, letter in enumerate(keyword[1:], 1):
            are &= self._text[np.minimum(starts + offset, last)] == letter
        chosen[chosen] = are
        return chosen


class _Words:
    """Where the words of lines start and end; a line starts with the blank that was its keyword."""

    def __init__(self, lines: Bytes) -> None:
        is_word = lines > _SPACE
        borders = np.flatnonzero(is_word[1:] != is_word[:-1]) + 1
        self.starts, self.ends = borders[0::2], borders[1::2]
        newlines = np.flatnonzero(lines == _NEWLINE)
        self.per_line: Ints = np.diff(np.searchsorted(self.starts, newlines), prepend=0)


def _slashes_per_word(lines: Bytes, words: _Words) -> Ints:
    slashes = np.flatnonzero(lines == _SLASH)
    return np.diff(np.searchsorted(slashes, np.append(words.starts, len(lines))))


def _parsed(text: bytes, kind: type[Number]) -> NDArray[Number]:
    """All numbers in a text, or none if it contains anything else."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)
        try:
            return np.fromstring(text, dtype=kind, sep=" ")
        except (DeprecationWarning, ValueError):
            return np.zeros(0, dtype=kind)


def _parsed_decimals(lines: Bytes, words: _Words) -> NDArray[np.float64] | None:
    """The numbers if all are plain decimals such as -0.125, else None; three times as fast.

    A quotient of two whole numbers that float64 holds exactly is rounded as the decimal would be.
    """
    text = lines.tobytes()
    points = np.flatnonzero(lines == _POINT)
    if (
        len(points) == 0
        or len(points) != len(words.starts)
        or text.translate(None, b"0123456789.- \t\n")
    ):
        return None
    has_sign = lines[words.starts] == _MINUS
    digits = words.ends - words.starts - has_sign - 1
    if (
        (points < words.starts).any()
        or (points >= words.ends).any()
        or np.count_nonzero(has_sign) != text.count(b"-")
        or not 1 <= digits.min() <= digits.max() <= _EXACT_DIGITS
    ):
        return None
    return _parsed(text.replace(b".", b""), np.int64) / 10.0 ** (words.ends - points - 1)


def _numbers(lines: Bytes, path: Path, keyword: str) -> NDArray[np.float64]:
    """(lines, columns) of the numbers in lines of equal length."""
    if len(lines) == 0:
        return np.zeros((0, 3))
    words = _Words(lines)
    counts = words.per_line
    values = _parsed_decimals(lines, words)
    if values is None:
        values = _parsed(lines.tobytes(), np.float64)
    columns = int(counts[0])
    if (
        (counts != columns).any()
        or values.size != columns * len(counts)
        or columns < 2 + (keyword == "v")
    ):
        raise DataError(
            f"{path} has a '{keyword}' line that is not numbers",
            expected="the same count of numbers on every such line",
            got=_first_odd_line(lines, lambda words: len(words) == columns and _are_numbers(words)),
        )
    return values.reshape(len(counts), columns)


def _first_odd_line(lines: Bytes, is_sound: Callable[[list[bytes]], bool]) -> str:
    """The first line with a word that cannot be read, to be shown in the error message."""
    texts = lines.tobytes().splitlines()
    odd = next((text for text in texts if not is_sound(text.split())), texts[0]).strip()
    return repr(odd[:_MOST_SHOWN].decode(errors="replace")) + "..." * (len(odd) > _MOST_SHOWN)


def _are_numbers(words: list[bytes]) -> bool:
    try:
        _ = [float(word) for word in words]
    except ValueError:
        return False
    return True


class _Corners:
    """The corners of all faces as one table of indices, with how many corners each face has."""

    def __init__(self, records: _Records, path: Path) -> None:
        self.path = path
        self._records = records
        lines = records.lines(b"f")
        words = _Words(lines)
        self.counts = words.per_line
        first = lines[words.starts[0] : words.ends[0]].tobytes() if len(words.starts) else b""
        slashes = first.count(b"/")
        self.layout = {0: "v", 1: "v/vt", 2: "v//vn" if b"//" in first else "v/vt/vn"}.get(
            slashes, "unknown"
        )
        per_corner = {"v": 1, "v/vt": 2, "v//vn": 2, "v/vt/vn": 3}.get(self.layout, 1)
        table = _parsed(lines.tobytes().replace(b"/", b" "), np.int64)
        if len(lines) and (
            self.counts.min() < 3
            or table.size != len(words.starts) * per_corner
            or (_slashes_per_word(lines, words) != slashes).any()
        ):
            raise DataError(
                f"{path} has a face that cannot be read",
                expected=f"at least three corners of the form {self.layout} on every f line",
                got=_first_odd_line(
                    lines,
                    lambda corners: (
                        len(corners) >= 3
                        and all(
                            corner.count(b"/") == slashes
                            and corner.translate(None, b"/-").isdigit()
                            for corner in corners
                        )
                    ),
                ),
            )
        self.table = table.reshape(-1, per_corner)

    def indices(self, column: int, keyword: bytes) -> Ints:
        """(C,) zero-based indices of one column into the records of a keyword."""
        indices = self.table[:, column]
        if len(indices) and int(np.abs(indices).min()) == 0:
            raise DataError(f"{self.path} has a face index 0; OBJ counts from 1")
        if len(indices) and int(indices.min()) < 0:
            # Negative ones count back from the last record before their face.
            end = np.repeat(self._records.count_before(keyword, b"f"), self.counts)
            return np.where(indices < 0, indices + end, indices - 1)
        return indices - 1


def write_obj(path: Path, mesh: Mesh, *, material: str = "material0") -> None:
    """Write an OBJ atomically; with texture coordinates it refers to ``material0.mtl``.

    The caller writes the material file and the image; the OBJ only names them.
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

"""A whole method in one file: numpy alone, any Python from 3.8 on, nothing of the harness.

It carves a block of voxels with the silhouettes and contours what is left.

    python run.py --photos FOLDER --out mesh.ply --voxel 0.02

FOLDER has ``images/*.png`` (RGBA, alpha is coverage) and nerfstudio's ``transforms.json``.
"""

from __future__ import annotations

import argparse
import json
import struct
import zlib
from pathlib import Path
from typing import NamedTuple

import numpy as np

#: Half of the block that is carved, metres: a person stands in its middle.
HALF_M = (0.9, 1.15, 0.9)


class Photo(NamedTuple):
    """Coverage (H, W), world to camera (3, 4) with OpenCV axes, intrinsics (3, 3) in pixels."""

    coverage: np.ndarray
    world_to_camera: np.ndarray
    intrinsics: np.ndarray


def read_alpha(path: Path) -> np.ndarray:
    """(H, W) coverage in [0, 1] of an 8-bit RGBA PNG that is not interlaced."""
    data = path.read_bytes()
    place, packed, size = 8, b"", (0, 0)
    while place < len(data):
        (length,) = struct.unpack(">I", data[place : place + 4])
        kind, body = data[place + 4 : place + 8], data[place + 8 : place + 8 + length]
        if kind == b"IHDR":
            width, height, depth, colours, _, _, interlaced = struct.unpack(">IIBBBBB", body)
            if (depth, colours, interlaced) != (8, 6, 0):
                raise SystemExit(f"{path} is no 8-bit RGBA picture")
            size = (height, width)
        elif kind == b"IDAT":
            packed += body
        place += 12 + length
    rows = np.frombuffer(zlib.decompress(packed), np.uint8).reshape(size[0], 1 + 4 * size[1])
    alpha = np.zeros(size, np.uint8)
    above = np.zeros(size[1], np.uint8)
    for row in range(size[0]):
        # A filter works on each channel by itself, so that colours need not be looked at.
        above = alpha[row] = unfiltered(rows[row, 0], rows[row, 4::4], above)
    return alpha / 255.0


def unfiltered(kind: int, line: np.ndarray, above: np.ndarray) -> np.ndarray:
    """(W,) a channel of a row, from what the PNG stores and the row above."""
    if kind == 0:
        return line
    if kind == 1:
        return np.cumsum(line, dtype=np.uint8)
    if kind == 2:
        return line + above
    found, left, corner = [], 0, 0
    for value, up in np.stack([line, above], axis=1).tolist():
        if kind == 3:
            guess = (left + up) // 2
        else:
            across, down, both = abs(up - corner), abs(left - corner), abs(left + up - 2 * corner)
            guess = left if across <= down and across <= both else up if down <= both else corner
        left, corner = (value + guess) & 255, up
        found.append(left)
    return np.array(found, np.uint8)


def read_photos(folder: Path) -> list[Photo]:
    """All photos of a folder."""
    photos = []
    for frame in json.loads((folder / "transforms.json").read_text())["frames"]:
        pose = np.array(frame["transform_matrix"]) @ np.diag([1.0, -1.0, -1.0, 1.0])
        intrinsics = np.array(
            [[frame["fl_x"], 0, frame["cx"]], [0, frame["fl_y"], frame["cy"]], [0, 0, 1]]
        )
        coverage = read_alpha(folder / frame["file_path"])
        photos.append(Photo(coverage, np.linalg.inv(pose)[:3], intrinsics))
    return photos


def sampled(coverage: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """(N,) coverage at points (N, 2) in pixels, bilinear; 0 outside the photo."""
    padded = np.pad(coverage, 1)
    most = np.array(padded.shape[::-1]) - 1.001
    # The middle of the first pixel is at 0.5.
    x, y = np.clip(pixels + 0.5, 0.0, most).T
    column, row = x.astype(int), y.astype(int)
    right, down = x - column, y - row
    upper = padded[row, column] * (1 - right) + padded[row, column + 1] * right
    lower = padded[row + 1, column] * (1 - right) + padded[row + 1, column + 1] * right
    return upper * (1 - down) + lower * down


def carve(photos: list[Photo], voxel_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Least coverage over the photos at each point of a lattice, and the lattice's first point."""
    counts = [2 * int(np.ceil(half / voxel_m)) + 1 for half in HALF_M]
    axes = [(np.arange(count) - count // 2) * voxel_m for count in counts]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    least = np.ones(len(points))
    for photo in photos:
        inside = np.flatnonzero(least > 0)
        seen = points[inside] @ photo.world_to_camera[:, :3].T + photo.world_to_camera[:, 3]
        pixels = seen @ photo.intrinsics.T
        ahead = np.where(pixels[:, 2:] > 1e-6, pixels[:, 2:], np.inf)
        least[inside] = np.minimum(least[inside], sampled(photo.coverage, pixels[:, :2] / ahead))
    least = least.reshape(counts)
    # The outermost points are outside, so that the surface is closed.
    closed = np.zeros_like(least)
    closed[1:-1, 1:-1, 1:-1] = least[1:-1, 1:-1, 1:-1]
    return closed, np.array([axis[0] for axis in axes])


def without_checkers(field: np.ndarray, level: float = 0.5) -> np.ndarray:
    """The field without squares of the lattice whose inside points touch at a corner alone.

    There, four faces would meet at one edge. One of the two points is put outside, which may make
    another such square; points only ever leave, so that it ends.
    """
    field = field.copy()
    found = True
    while found:
        found = False
        for axis in range(3):
            first, second = [other for other in range(3) if other != axis]
            corner = {}
            for a in (0, 1):
                for b in (0, 1):
                    part = [slice(None)] * 3
                    part[first] = slice(a, field.shape[first] - 1 + a)
                    part[second] = slice(b, field.shape[second] - 1 + b)
                    corner[a, b] = field[tuple(part)]
            for b in (0, 1):
                pair, rest = (corner[0, b], corner[1, 1 - b]), (corner[0, 1 - b], corner[1, b])
                touch = (np.minimum(*pair) > level) & (np.maximum(*rest) <= level)
                found = found or bool(touch.any())
                pair[0][touch] = 0.0
    return field


def contour(field: np.ndarray, level: float = 0.5) -> tuple[np.ndarray, np.ndarray]:
    """Vertices in lattice units and triangles of a level: one vertex in each cell it crosses."""
    inside = field > level
    cells = tuple(count - 1 for count in field.shape)
    total, number = np.zeros((*cells, 3)), np.zeros(cells)
    for axis in range(3):
        low = [slice(None)] * 3
        high = [slice(None)] * 3
        low[axis], high[axis] = slice(None, -1), slice(1, None)
        a, b = field[tuple(low)], field[tuple(high)]
        crosses = inside[tuple(low)] != inside[tuple(high)]
        share = np.where(crosses, (level - a) / np.where(crosses, b - a, 1.0), 0.0)
        others = [other for other in range(3) if other != axis]
        for first in (0, 1):
            for second in (0, 1):
                edge = [slice(None)] * 3
                edge[others[0]] = slice(first, first + cells[others[0]])
                edge[others[1]] = slice(second, second + cells[others[1]])
                found, where = crosses[tuple(edge)], share[tuple(edge)]
                number += found
                total[..., axis] += where
                total[..., others[0]] += first * found
                total[..., others[1]] += second * found
    used = number > 0
    index = np.full(cells, -1)
    index[used] = np.arange(used.sum())
    vertices = np.argwhere(used) + total[used] / number[used][:, None]
    return vertices, np.concatenate([quads(inside, index, axis) for axis in range(3)])


def quads(inside: np.ndarray, index: np.ndarray, axis: int) -> np.ndarray:
    """(F, 3) triangles across the lattice edges along an axis, outside first."""
    first, second = (axis + 1) % 3, (axis + 2) % 3
    low = [slice(1, -1)] * 3
    high = [slice(1, -1)] * 3
    low[axis], high[axis] = slice(None, -1), slice(1, None)
    start, end = inside[tuple(low)], inside[tuple(high)]
    corners = []
    for back in ((1, 1), (0, 1), (0, 0), (1, 0)):
        place = [slice(None)] * 3
        place[first] = slice(1 - back[0], index.shape[first] - back[0])
        place[second] = slice(1 - back[1], index.shape[second] - back[1])
        corners.append(index[tuple(place)])
    around = np.stack(corners, axis=-1)
    outward = around[start & ~end]
    inward = around[end & ~start][:, ::-1]
    both = np.concatenate([outward, inward])
    return np.concatenate([both[:, [0, 1, 2]], both[:, [0, 2, 3]]])


def write_ply(path: Path, vertices: np.ndarray, faces: np.ndarray) -> None:
    """A binary PLY file."""
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n"
        "property double x\nproperty double y\nproperty double z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    rows = np.empty(len(faces), np.dtype([("count", "u1"), ("corners", "<i4", (3,))]))
    rows["count"], rows["corners"] = 3, faces
    path.write_bytes(header.encode() + vertices.astype("<f8").tobytes() + rows.tobytes())


def reconstructed(photos: Path, voxel_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (metres, the world of the cameras) and triangles of the surface in a folder."""
    field, origin = carve(read_photos(photos), voxel_m)
    if not (field > 0.5).any():
        raise SystemExit("no point is inside all silhouettes")
    vertices, faces = contour(without_checkers(field))
    return origin + voxel_m * vertices, faces


def main() -> None:
    """Read the folder, write the mesh."""
    parser = argparse.ArgumentParser(description="Voxel carving.")
    parser.add_argument("--photos", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--voxel", type=float, default=0.02)
    asked = parser.parse_args()
    vertices, faces = reconstructed(asked.photos, asked.voxel)
    write_ply(asked.out, vertices, faces)
    print(f"{len(faces)} triangles")


if __name__ == "__main__":
    main()

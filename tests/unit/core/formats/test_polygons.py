"""Polygons with notches, holes and crossings, whose areas are known."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from harness.core.errors import DataError
from harness.files.mesh_files import load_mesh
from harness.files.polygons import cut_polygons

NOTCHED = {
    "arrow": ([(0, 0), (2, 0), (0.5, 0.5), (0, 2)], 1.0),
    "arrow from its tip": ([(2, 0), (0.5, 0.5), (0, 2), (0, 0)], 1.0),
    "U": ([(0, 0), (3, 0), (3, 3), (2, 3), (2, 1), (1, 1), (1, 3), (0, 3)], 7.0),
    "comb": ([(0, 0), (5, 0), (5, 2), (4, 1), (3, 2), (2, 1), (1, 2), (0, 1)], 7.5),
    "hole joined by a bridge": (
        [(0, 0), (4, 0), (4, 4), (0, 4), (0, 0), (1, 1), (1, 3), (3, 3), (3, 1), (1, 1)],
        12.0,
    ),
    "corner twice": ([(0, 0), (1, 0), (1, 1), (1, 1)], 0.5),
    "corners along a side": ([(0, 0), (1, 0), (2, 0), (3, 0), (0, 3)], 4.5),
}


def surface(outline, tilt: float = 0.3) -> np.ndarray:
    """An outline as points on a tilted plane."""
    flat = np.column_stack([np.asarray(outline, float), np.zeros(len(outline))])
    turn = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    return flat @ turn.T + (5.0, -7.0, 2.0)


def triangle_vectors(points: np.ndarray) -> np.ndarray:
    counts = np.array([len(points)])
    a, b, c = np.moveaxis(points[cut_polygons(points, np.arange(len(points)), counts)], 1, 0)
    return np.cross(b - a, c - a) / 2


@pytest.mark.parametrize("name", NOTCHED)
@pytest.mark.parametrize("backwards", [False, True])
def test_a_notch_is_not_covered_and_no_triangle_is_turned_over(name: str, backwards: bool) -> None:
    outline, area = NOTCHED[name]
    vectors = triangle_vectors(surface(outline[::-1] if backwards else outline))

    assert np.linalg.norm(vectors, axis=1).sum() == pytest.approx(area)
    assert np.linalg.norm(vectors.sum(axis=0)) == pytest.approx(area)
    assert len(vectors) == len(outline) - 2


@pytest.mark.parametrize("seed", range(40))
def test_random_outlines_are_covered_once(seed: int) -> None:
    rng = np.random.default_rng(seed)
    angles = np.linspace(0, 2 * np.pi, rng.integers(5, 40), endpoint=False)
    radii = rng.uniform(0.1, 1, len(angles))
    outline = np.roll(np.column_stack([np.cos(angles), np.sin(angles)]) * radii[:, None], 3, axis=0)
    x, y = outline.T
    area = (x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2

    vectors = triangle_vectors(surface(outline, tilt=seed))
    assert np.linalg.norm(vectors, axis=1).sum() == pytest.approx(area)


def test_a_convex_polygon_is_a_fan_from_its_first_corner() -> None:
    angles = np.linspace(0, 2 * np.pi, 6, endpoint=False)
    hexagon = surface(np.column_stack([np.cos(angles), np.sin(angles)]))
    triangles = cut_polygons(hexagon, np.arange(6), np.array([6]))
    assert triangles.tolist() == [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]]


def test_a_quad_that_is_not_flat_is_cut_where_its_plane_says() -> None:
    outline, _ = NOTCHED["arrow from its tip"]
    bent = np.add(surface(outline), [[0, 0, 0], [0, 0, 0.1], [0, 0, -0.1], [0, 0, 0.1]])
    # From the notch, so that both triangles look the same way.
    assert cut_polygons(bent, np.arange(4), np.array([4])).tolist() == [[1, 2, 3], [1, 3, 0]]


STAR = [(np.cos(a), np.sin(a)) for a in np.arange(5) * 4 * np.pi / 5]
LOOP = [
    ((0.5 + np.cos(a)) * np.cos(a), (0.5 + np.cos(a)) * np.sin(a))
    for a in np.linspace(0, 2 * np.pi, 41, endpoint=False)
]


@pytest.mark.parametrize(
    "outline",
    [
        [(0, 0), (1, 1), (1, 0), (0, 1)],
        [(0, 0), (2, 1), (2, 0), (0, 1.5)],
        [(0, 0), (3, 0), (3, 3), (1, -1), (0, 3)],
        STAR,
        LOOP,
        LOOP[20:] + LOOP[:20],
    ],
    ids=["bow tie", "uneven bow tie", "through a side", "star", "inner loop", "from inside"],
)
def test_an_outline_that_crosses_itself_is_refused(outline) -> None:
    with pytest.raises(DataError, match=rf"face 1, of {len(outline)} corners, crosses itself"):
        triangle_vectors(surface(outline))


def test_many_corners_take_little_time_or_are_refused() -> None:
    angles = np.linspace(0, 2 * np.pi, 300_000, endpoint=False)
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    start = time.process_time()
    assert np.linalg.norm(triangle_vectors(surface(circle)), axis=1).sum() == pytest.approx(np.pi)
    with pytest.raises(DataError, match="of 300000 corners, has notches"):
        triangle_vectors(surface(circle * (1 + 0.3 * np.cos(40 * angles[:, None]))))
    assert time.process_time() - start < 10


def test_the_area_is_the_same_in_every_format(tmp_path: Path) -> None:
    outline, area = NOTCHED["U"]
    points, count = surface(outline), len(outline)
    rows = "\n".join(" ".join(map(repr, point.tolist())) for point in points)
    corners = " ".join(map(str, range(count)))
    texts = {
        "obj": "v " + rows.replace("\n", "\nv ") + "\nf " + " ".join(map(str, range(1, count + 1))),
        "off": f"OFF\n{count} 1 0\n{rows}\n{count} {corners}\n",
        "ply": f"ply\nformat ascii 1.0\nelement vertex {count}\nproperty double x\nproperty double "
        "y\nproperty double z\nelement face 1\nproperty list int int vertex_indices\nend_header\n"
        f"{rows}\n{count} {corners}\n",
    }
    for suffix, text in texts.items():
        path = tmp_path / f"mesh.{suffix}"
        path.write_text(text)
        assert load_mesh(path).area == pytest.approx(area), suffix
        path.write_text(text.replace(rows.splitlines()[2], rows.splitlines()[6]))
        with pytest.raises(DataError, match=f"mesh.{suffix}: face 1, of 8 corners, crosses itself"):
            load_mesh(path)

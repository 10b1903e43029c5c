"""One surface written in ways that part its vertices, or say its faces twice, has one normal."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from harness.core.mesh import Mesh
from harness.geometry.coinciding import coinciding_positions, doubles_of, merged_positions
from harness.geometry.surface import SurfaceIndex
from metrics.distance import sample_surface
from metrics.normals import angles_deg
from tests.spheres import icosphere

Change = Callable[[Mesh, np.random.Generator], Mesh]


def bumpy(seed: int = 0) -> Mesh:
    """A closed surface as large as a person, with bumps, off the origin."""
    sphere = icosphere(1.0, 4)
    waves = np.sin(sphere.vertices @ np.random.default_rng(seed).normal(size=(3, 3)) * 4)
    size = (0.3, 0.9, 0.2) + 0.05 * waves
    return Mesh(sphere.vertices * size + (0.1, 0.9, -0.3), sphere.faces, source="bumpy")


def soup(mesh: Mesh, rng: np.random.Generator) -> Mesh:
    return Mesh(mesh.vertices[mesh.faces].reshape(-1, 3), np.arange(mesh.faces.size).reshape(-1, 3))


def moved(size: float) -> Change:
    def change(mesh: Mesh, rng: np.random.Generator) -> Mesh:
        parted = soup(mesh, rng)
        return Mesh(parted.vertices + rng.uniform(-size, size, parted.vertices.shape), parted.faces)

    return change


def rounded_in_nodes(mesh: Mesh, rng: np.random.Generator) -> Mesh:
    """Two halves, each stored in float32 in axes of its own, as nodes of a GLB have it."""
    upper = mesh.vertices[mesh.faces].mean(axis=1)[:, 1] > 0.85
    parts = []
    for faces, origin in ((mesh.faces[upper], (0.3, 1.7, 0.2)), (mesh.faces[~upper], (1, 0, 0.1))):
        turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        local = ((mesh.vertices - origin) @ turn * 100).astype(np.float32)
        parts.append((local.astype(np.float64) / 100 @ turn.T + origin, faces))
    vertices = np.concatenate([part[0] for part in parts])
    return Mesh(vertices, np.concatenate([parts[0][1], parts[1][1] + len(mesh.vertices)]))


def in_float32(mesh: Mesh, rng: np.random.Generator) -> Mesh:
    near = rng.random(mesh.faces.shape) < 0.5
    corners = mesh.vertices[mesh.faces]
    single = corners.astype(np.float32).astype(np.float64)
    return Mesh(
        np.where(near[..., None], corners, single).reshape(-1, 3),
        np.arange(mesh.faces.size).reshape(-1, 3),
    )


@pytest.mark.parametrize(
    "change",
    [soup, moved(1e-9), moved(1e-8), moved(2e-7), in_float32, rounded_in_nodes],
    ids=["soup", "1e-9", "1e-8", "2e-7", "float32", "nodes"],
)
@pytest.mark.parametrize("seed", range(2))
def test_parted_vertices_smooth_as_one(change: Change, seed: int) -> None:
    mesh = bumpy(seed)
    parted = change(mesh, np.random.default_rng(seed))
    assert off_deg(parted, mesh) < 0.05
    found = coinciding_positions(parted.vertices, parted.faces)
    used = np.unique(parted.faces)
    assert len(np.unique(found[used])) == len(mesh.vertices)


def off_deg(changed: Mesh, mesh: Mesh) -> float:
    """The mean angle between normals of two surfaces at points on the second, in degrees."""
    surface, other = SurfaceIndex(mesh), SurfaceIndex(changed)
    where = sample_surface(surface, 4000, "stratified", 1)
    normals = other.normals(other.closest(where.points)[0])
    return float(angles_deg(normals, surface.normals(where)).mean())


def test_what_does_not_coincide_stays_as_it_is() -> None:
    mesh = bumpy()
    # Slivers: a vertex half a micrometre from another of the same piece.
    near = mesh.vertices.copy()
    first, second = mesh.faces[7, :2]
    near[second] = near[first] + 4e-7
    for vertices in (mesh.vertices, near):
        found = coinciding_positions(vertices, mesh.faces)
        np.testing.assert_array_equal(found, merged_positions(vertices))
        doubles = doubles_of(found[mesh.faces], mesh.face_normals(), vertices[mesh.faces[:, 0]])
        assert not doubles.extra.any()
        np.testing.assert_array_equal(doubles.vectors, mesh.face_normals())
    # All of it is smaller than a far vertex lets it round.
    far = np.vstack([mesh.vertices, [[1e7, 0, 0], [1e7, 1, 0], [1e7, 0, 1]]])
    faces = np.vstack([mesh.faces, len(far) - np.arange(1, 4)])
    np.testing.assert_array_equal(coinciding_positions(far, faces), merged_positions(far))


def twice(turn: bool, order: str = "after", size: float = 0.0, share: float = 1.0) -> Change:
    """The faces of a mesh and a copy of the first ones, perhaps turned, perhaps a little off."""

    def change(mesh: Mesh, rng: np.random.Generator) -> Mesh:
        heights = mesh.vertices[mesh.faces].mean(axis=1)[:, 1]
        chosen = mesh.faces[heights <= np.quantile(heights, share)]
        copy = (chosen[:, ::-1] if turn else chosen) + (len(mesh.vertices) if size else 0)
        vertices = mesh.vertices
        if size:
            vertices = np.vstack([vertices, vertices + rng.uniform(-size, size, vertices.shape)])
        pair = (mesh.faces, copy) if order == "after" else (copy, mesh.faces)
        faces = np.concatenate(pair)
        return Mesh(vertices, rng.permutation(faces) if order == "mixed" else faces)

    return change


DOUBLED = {
    "turned after": twice(True),
    "turned before": twice(True, "before"),
    "turned in any order": twice(True, "mixed"),
    "turned, off by rounding": twice(True, size=1e-8),
    "turned, off, in any order": twice(True, "mixed", 1e-7),
    "the same again": twice(False),
    "the same again, off by rounding": twice(False, "mixed", 1e-8),
    "half of it turned": twice(True, share=0.5),
    "half of it, before and turned": twice(True, "before", share=0.5),
    "a third of it again": twice(False, "mixed", share=1 / 3),
    "three times": lambda mesh, rng: twice(True, "mixed")(twice(False)(mesh, rng), rng),
}


@pytest.mark.parametrize("name", DOUBLED)
def test_faces_that_are_there_twice_turn_no_normal(name: str) -> None:
    mesh = bumpy()
    changed = DOUBLED[name](mesh, np.random.default_rng(3))
    # At the border of a copy a few vertices weigh their faces otherwise.
    assert off_deg(changed, mesh) < (0.05 if len(changed.faces) >= 2 * len(mesh.faces) else 0.2)
    doubles = SurfaceIndex(changed).doubles
    assert doubles.extra.sum() == len(changed.faces) - len(mesh.faces)
    assert doubles.turned.any() == ("turned" in name or name == "three times")


def test_two_faces_alone_among_others_cancel() -> None:
    mesh = bumpy()
    flap = Mesh(mesh.vertices, np.vstack([mesh.faces, mesh.faces[7:8], mesh.faces[7:8, ::-1]]))
    doubles = SurfaceIndex(flap).doubles
    assert (doubles.extra.sum(), doubles.turned.sum()) == (2, 1)
    assert off_deg(flap, mesh) < 0.05


def test_both_sides_of_an_open_sheet_stay() -> None:
    vertices = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]])
    one = np.array([[0, 1, 2], [0, 2, 3]])
    sheet = SurfaceIndex(Mesh(vertices, np.vstack([one, one[:, ::-1]])))
    assert sheet.doubles.turned.tolist() == [False, False, True, True]
    np.testing.assert_array_equal(sheet.doubles.vectors, sheet.face_vectors)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 1e-9, 1e-8, 1e-7]))
def test_any_mixture_of_copies_has_the_normals_of_the_mesh(seed: int, size: float) -> None:
    rng = np.random.default_rng(seed)
    mesh = icosphere(0.5, 2, centre=rng.uniform(-1, 1, 3))
    ways = [mesh.faces[:, ::-1], np.roll(mesh.faces, 1, axis=1)]
    copies = [mesh.faces, *(ways[rng.integers(2)] for _ in range(rng.integers(3)))]
    faces = rng.permutation(np.concatenate(copies))
    corners = mesh.vertices[faces].reshape(-1, 3)
    corners = corners + rng.uniform(-size, size, corners.shape)
    changed = Mesh(corners, np.arange(len(corners)).reshape(-1, 3))
    assert off_deg(changed, mesh) < 0.05

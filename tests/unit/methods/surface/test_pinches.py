"""Folds that touch along an edge, cut apart; and the count that says so."""

from __future__ import annotations

import numpy as np
import pytest

from harness.core.mesh import Mesh
from harness.geometry.coinciding import largest_piece, open_edges
from methods.surface.fusion import one_piece, without_pinches

CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
FACES = np.array(
    [
        *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ]
)


@pytest.fixture
def cube() -> Mesh:
    return Mesh(CORNERS, FACES)


@pytest.fixture
def touching_cubes() -> Mesh:
    """Two cubes that share the edge x = y = 1, vertices 6 and 7 of the first."""
    second = FACES + 8
    second[FACES == 0], second[FACES == 1] = 6, 7
    return Mesh(
        np.concatenate([CORNERS, CORNERS + np.array([1.0, 1, 0])]), np.concatenate([FACES, second])
    )


def test_a_cube_is_closed_and_stays_as_it_is(cube):
    assert open_edges(cube) == 0
    same, cut = without_pinches(cube)
    assert same is cube
    assert cut == 0


def test_open_flipped_and_shared_edges_are_counted(cube, touching_cubes):
    without_one = Mesh(cube.vertices, cube.faces[1:])
    assert open_edges(without_one) == 6  # its three edges, once in each direction
    flipped = cube.faces.copy()
    flipped[0] = flipped[0, ::-1]
    assert open_edges(Mesh(cube.vertices, flipped)) > 0
    assert open_edges(touching_cubes) > 0


def test_touching_cubes_are_cut_apart_with_solid_on_each_side(touching_cubes):
    apart, cut = without_pinches(touching_cubes)
    assert cut == 1
    assert open_edges(apart) == 0
    middle = apart.vertices[-2:]
    # Each middle went into its own cube, which lost a sliver.
    np.testing.assert_allclose(np.sort(middle[:, 0]), [0.95, 1.05])
    np.testing.assert_allclose(middle[:, 0], middle[:, 1])
    assert 1.9 < apart.signed_volume < 2.0


def test_faces_back_to_back_go(cube):
    fin = np.array([[0, 1, 8], [1, 0, 8]])
    finned = Mesh(np.concatenate([cube.vertices, [[-1.0, 0, 0.5]]]), np.concatenate([FACES, fin]))
    assert open_edges(finned) > 0
    clean, _ = without_pinches(finned)
    assert open_edges(clean) == 0
    assert clean.signed_volume == pytest.approx(1.0)


def test_the_largest_piece_is_kept_whole(cube):
    small = Mesh(np.concatenate([CORNERS, CORNERS[:4] + 5]), np.concatenate([FACES, FACES[:2] + 8]))
    kept = largest_piece(small)
    assert len(kept.faces) == 12
    np.testing.assert_allclose(kept.extent, cube.extent)


def test_a_crumb_that_hung_on_by_a_fin_goes_with_it(cube):
    crumb, fin = FACES + 8, np.array([[0, 1, 8], [1, 0, 8]])
    together = Mesh(
        np.concatenate([CORNERS, 0.1 * CORNERS + 2]), np.concatenate([FACES, crumb, fin])
    )
    assert len(largest_piece(together).faces) == len(together.faces)
    piece = one_piece(together)
    assert open_edges(piece) == 0
    assert piece.signed_volume == pytest.approx(cube.signed_volume)

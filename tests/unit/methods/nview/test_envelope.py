"""A surface is cut to the outlines of photos, however far it bulges."""

from __future__ import annotations

import numpy as np
import pytest

from harness.core.errors import MethodError
from harness.core.mesh import Mesh
from harness.geometry.coinciding import concatenated, open_edges
from methods.closed.lattices import cut_to_outlines, remeshed


@pytest.fixture
def outlines(ball, ring, views_of):
    return [view.outline for view in views_of(ball, ring(8))]


@pytest.mark.nightly
def test_a_balloon_beside_the_subject_is_cut_off(ball, outlines):
    balloon = Mesh(ball.vertices + np.array([0.0, -0.2, 0.1]), ball.faces)
    both = remeshed(concatenated([ball, balloon]), 0.006)
    assert np.linalg.norm(both.vertices, axis=1).max() > 0.35
    cut = cut_to_outlines(both, outlines, 0.004)
    assert open_edges(cut) == 0
    away = np.linalg.norm(cut.vertices, axis=1)
    # The hull of eight level views is pointed above and below.
    assert away.max() < 0.23
    level = np.abs(cut.vertices[:, 1]) < 0.05
    assert np.percentile(away[level], 95) < 0.205


def test_what_is_inside_all_outlines_stays(ball, outlines):
    smaller = Mesh(0.9 * ball.vertices, ball.faces)
    cut = cut_to_outlines(smaller, outlines, 0.004)
    np.testing.assert_allclose(np.linalg.norm(cut.vertices, axis=1), 0.18, atol=0.001)


def test_one_photo_leaves_its_own_depth(ball, ring, views_of):
    (front,) = [view.outline for view in views_of(ball, ring(8))][:1]
    longer = Mesh(ball.vertices * np.array([1.5, 1.0, 1.5]), ball.faces)
    cut = cut_to_outlines(longer, [front], 0.004)
    # A cone is wider further from its camera.
    assert np.abs(cut.vertices[:, 0]).max() < 0.24
    assert np.abs(cut.vertices[:, 2]).max() > 0.25


def test_a_surface_outside_all_outlines_is_told(ball, outlines):
    elsewhere = Mesh(ball.vertices + np.array([0.0, 0.6, 0.0]), ball.faces)
    with pytest.raises(MethodError, match="is empty"):
        cut_to_outlines(elsewhere, outlines, 0.01)

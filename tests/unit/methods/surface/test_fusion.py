"""Open sheets fused to one closed surface, against a closed form."""

from __future__ import annotations

import numpy as np
import pytest

from harness.core.errors import DataError, MethodError
from harness.core.mesh import Mesh
from harness.geometry.coinciding import concatenated, open_edges
from methods.surface import fusion
from methods.surface.fusion import FusionParameters, fused

RADIUS, CENTRE = 0.4, np.array([0.2, -0.1, 5.0])


@pytest.fixture(scope="module")
def caps() -> list[Mesh]:
    """The front, the back and the rim of a sphere, with gaps of 2 cm between them."""
    polar, around = np.linspace(0.02, np.pi - 0.02, 120), np.arange(160) * 2 * np.pi / 160
    v, u = np.meshgrid(polar, around, indexing="ij")
    points = np.stack([np.sin(v) * np.sin(u), np.sin(v) * np.cos(u), np.cos(v)], -1) * RADIUS
    index = np.arange(v.size).reshape(v.shape)
    right = np.roll(index, -1, axis=1)
    a, b, c, d = (part.ravel() for part in (index[:-1], right[:-1], right[1:], index[1:]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    whole = Mesh(points.reshape(-1, 3) + CENTRE, faces)
    height = points.reshape(-1, 3)[:, 2]
    return [
        whole.submesh(keep[faces].all(axis=1))
        for keep in (height > 0.1, height < -0.1, np.abs(height) < 0.08)
    ]


@pytest.fixture(scope="module")
def ball(caps) -> Mesh:
    return fused(caps, FusionParameters(depth=7))


def test_the_fused_surface_is_the_sphere_in_its_place(ball):
    radius = np.linalg.norm(ball.vertices - CENTRE, axis=1)
    assert np.abs(radius - RADIUS).max() < 0.006
    assert open_edges(ball) == 0
    assert ball.signed_volume == pytest.approx(4 / 3 * np.pi * RADIUS**3, rel=0.01)


def test_equal_input_gives_equal_output(caps, ball):
    again = fused(caps, FusionParameters(depth=7))
    np.testing.assert_array_equal(again.vertices, ball.vertices)
    np.testing.assert_array_equal(again.faces, ball.faces)


def test_a_bulge_that_reaches_the_octrees_wall_gets_a_larger_octree(caps, monkeypatch):
    """A bowl: nothing says where it ends below."""
    bowl, rules = caps[:1], FusionParameters(depth=6)
    closed = fused(bowl, rules)
    assert open_edges(closed) == 0
    above = closed.vertices[closed.vertices[:, 2] > CENTRE[2] + 0.15]
    assert np.abs(np.linalg.norm(above - CENTRE, axis=1) - RADIUS).max() < 0.02
    monkeypatch.setattr(fusion, "OCTREES", fusion.OCTREES[:1])
    with pytest.raises(MethodError, match="not closed"):
        fused(bowl, rules)


def test_decimation_keeps_it_closed(caps):
    small = fused(caps, FusionParameters(depth=7, faces=2000))
    assert 1500 < len(small.faces) <= 2000
    assert open_edges(small) == 0
    assert np.abs(np.linalg.norm(small.vertices - CENTRE, axis=1) - RADIUS).max() < 0.008


def test_sheets_that_face_inwards_are_refused(caps):
    inwards = [Mesh(cap.vertices, cap.faces[:, ::-1]) for cap in caps]
    with pytest.raises(MethodError, match="fused surface (is not closed|faces inwards)"):
        fused(inwards, FusionParameters(depth=6))


def test_parts_keep_their_faces_when_put_together(caps):
    both = concatenated(caps)
    assert len(both.faces) == sum(len(cap.faces) for cap in caps)
    start, end = np.cumsum([len(cap.vertices) for cap in caps[:2]])
    np.testing.assert_array_equal(both.vertices[start:end], caps[1].vertices)
    assert both.area == pytest.approx(sum(cap.area for cap in caps))


def test_parameters_out_of_range_are_refused():
    with pytest.raises(DataError, match="depth 4 to 12"):
        FusionParameters(depth=40)

"""What is lent of the scan under ``oracle_normals``, to whom, and of which views."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from harness.core.camera import Camera
from harness.core.errors import MethodError
from harness.core.mesh import Mesh
from harness.core.protocols import MethodInfo, Privilege
from harness.core.rigs import RingRig
from harness.run.cell import lent_to
from harness.run.oracle_normals import OracleNormals


def plate() -> Mesh:
    """A closed wedge of 1 m x 1 m whose front leans back by 45 degrees."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.1, 0.1)])
    corners[[3, 7], 2] -= 1.0  # the upper front edge
    corners[[2, 6], 2] -= 1.0  # the upper back edge
    faces = [
        *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ]
    return Mesh(corners, np.array(faces))


@pytest.fixture
def cameras() -> tuple[Camera, ...]:
    return RingRig().cameras(90, 160)


def test_both_sides_in_the_map_frame(cameras):
    oracle = OracleNormals(plate(), cameras[:1])
    window = cameras[0].cropped(20, 40, 60, 80).resized(120, 160)
    near, far = oracle(window), oracle(window, side="far")
    assert near.shape == (160, 120, 3)
    slope = 0.5**0.5
    # Corners that meet share a normal, so that the faces are not quite flat.
    np.testing.assert_allclose(near[80, 60], (0, slope, slope), atol=0.06)
    np.testing.assert_allclose(far[80, 60], (0, -slope, -slope), atol=0.06)
    assert (near[0, 0] == 0).all()


def test_other_views_are_not_shown(cameras):
    oracle = OracleNormals(plate(), cameras[:1])
    with pytest.raises(MethodError, match="a view that the method is not given"):
        oracle(cameras[4])
    with pytest.raises(MethodError, match="a view that the method is not given"):
        oracle(cameras[0].turned(np.diag([-1.0, 1.0, -1.0])))


def test_only_those_who_declare_it_get_it(cameras):
    capture = SimpleNamespace(cameras=cameras)

    def lent(*privileges: str, views: tuple[int, ...] | None = None):
        info = MethodInfo("m", "M", views=views, privileges=tuple(map(Privilege, privileges)))
        return lent_to(info, capture, plate())  # type: ignore[arg-type]

    assert lent("known_cameras") == {}
    assert set(lent("oracle_normals", "ground_truth_mesh")) == {
        "oracle_normals",
        "ground_truth_mesh",
    }
    two = lent("oracle_normals", views=(0, 4))["oracle_normals"]
    assert callable(two)
    assert two(cameras[4]).any()
    with pytest.raises(MethodError):
        two(cameras[1])
    everywhere = lent("oracle_normals")["oracle_normals"]
    assert callable(everywhere)
    assert everywhere(cameras[1]).any()

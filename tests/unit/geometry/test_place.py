"""Where a subject stands, from silhouettes whose answer is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from harness.core.errors import MethodError
from harness.core.mesh import Mesh
from harness.core.rigs import RingRig
from harness.geometry.outline import Outline
from harness.geometry.place import MEAN_HEIGHT_M, place_of
from harness.geometry.raycast import Raycaster

CAMERAS = RingRig().cameras(270, 480)


def post(centre, height_m: float) -> Mesh:
    """A thin upright box."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    faces = np.array(
        [
            *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
            *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
        ]
    )
    return Mesh(corners * (0.1, height_m / 2, 0.1) + centre, faces)


def outlines(mesh: Mesh, views) -> list[Outline]:
    caster = Raycaster(mesh)
    return [Outline(CAMERAS[view], caster.mask(CAMERAS[view]).astype(float)) for view in views]


@pytest.mark.parametrize("views", [range(8), (0, 4), (0, 2), (1, 3, 4)])
def test_two_or_more_views_tell_the_place_and_the_size(views):
    centre = np.array([0.1, 0.05, -0.12])
    place = place_of(outlines(post(centre, 1.5), views))
    np.testing.assert_allclose(place.centre, centre, atol=0.02)
    assert place.half_height_m == pytest.approx(0.75, rel=0.06)
    assert place.depth_is_known


def test_one_view_takes_the_mean_height():
    place = place_of(outlines(post((0.0, 0.0, 0.0), MEAN_HEIGHT_M / 2), [0]))
    # Half as high as people are: seen as if twice as far away.
    assert not place.depth_is_known
    assert place.distance_m(CAMERAS[0]) == pytest.approx(6.0, rel=0.05)


def test_the_place_moves_with_the_cameras():
    seen = outlines(post((0.1, 0.0, 0.0), 1.6), range(8))
    here = place_of(seen)
    shift = np.eye(4)
    shift[:3, 3] = (-0.4, 0.3, 1.2)
    there = place_of([replace(each, camera=each.camera.in_frame(shift)) for each in seen])
    np.testing.assert_allclose(there.centre - here.centre, (-0.4, 0.3, 1.2), atol=1e-6)


def test_an_empty_mask_is_refused():
    seen = outlines(post((0.0, 0.0, 0.0), 1.6), (0, 1))
    seen[1] = replace(seen[1], coverage=np.zeros_like(seen[1].coverage))
    with pytest.raises(MethodError, match="no subject"):
        place_of(seen)

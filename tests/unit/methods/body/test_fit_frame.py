"""The frame of the fit: what turns and moves with the cameras, and the way back."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from methods.body.fitting import fit_frame, in_frame, out_of_frame


@pytest.mark.parametrize("first", [0, 3])
def test_the_first_camera_stands_in_front_and_the_subject_at_the_origin(make_views, first):
    ring = make_views.ring(8)
    views = make_views([ring[first], ring[(first + 2) % 8]], centre=(0.1, 0.2, -0.3))
    moved = in_frame(views, fit_frame(views))
    position = moved.views[0].camera.position
    assert position[2] > 2.5
    assert position[0] == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(moved.views[0].place.centre, 0.0, atol=1e-12)
    # Up stays up.
    np.testing.assert_allclose(fit_frame(views)[:3, 1], (0.0, 1.0, 0.0), atol=1e-12)


def test_the_frame_is_the_same_wherever_the_worlds_is(make_views):
    centre = np.array([0.1, 0.2, -0.3])
    views = make_views(make_views.ring(8)[1:3], centre=centre)
    world = np.eye(4)
    world[:3, :3] = Rotation.from_euler("y", 77, degrees=True).as_matrix()
    world[:3, 3] = (5.0, -1.0, 2.0)
    elsewhere = in_frame(views, world)
    for here, there in zip(
        in_frame(views, fit_frame(views)).views,
        in_frame(elsewhere, fit_frame(elsewhere)).views,
        strict=True,
    ):
        np.testing.assert_allclose(
            here.camera.world_to_camera, there.camera.world_to_camera, atol=1e-9
        )


def test_a_body_comes_back_to_the_world(anny, person, make_views):
    parameters, posed, _ = person
    views = make_views(make_views.ring(8)[3:4], centre=(0.2, 0.1, 0.4))
    frame = fit_frame(views)
    back = out_of_frame(parameters, frame)
    with torch.no_grad():
        found = anny.posed(back).vertices[0].double().numpy()
    expected = (posed.vertices[0].double().numpy() - frame[:3, 3]) @ frame[:3, :3]
    np.testing.assert_allclose(found, expected, atol=1e-5)

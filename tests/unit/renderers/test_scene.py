"""Blender's scene as data: the camera formula of Blender against our own projection."""

import json
from dataclasses import replace

import numpy as np
import pytest

from harness.core.camera import Camera, look_at
from harness.core.camera_frames import BLENDER_TO_WORLD
from harness.core.errors import DataError
from harness.core.rigs import RingRig
from harness.core.typed_json import from_json, to_json
from renderers.blender.scene import BlenderCamera, Scene, describe, vertices_in_blender


def blender_projection(camera, width, height, points):
    """Pixels (N, 2) by the rules of Blender: sensor fitted to the width, y up from the bottom."""
    matrix = np.array(camera.matrix_world)
    x, y, z = ((points - matrix[:3, 3]) @ matrix[:3, :3]).T
    # Normalised by the picture's width; Blender's cameras look along -Z.
    share = 1 / camera.width_m if camera.width_m else camera.lens_mm / camera.sensor_mm / -z
    u, v = share * x - camera.shift_x, share * y - camera.shift_y
    return np.stack([width / 2 + u * width, height / 2 - v * width], axis=1)


@pytest.mark.parametrize("kind", ["perspective", "orthographic"])
@pytest.mark.parametrize("principal", [(54.0, 96.0), (40.25, 120.5)])
def test_the_blender_camera_has_the_same_rays(principal, kind):
    K = np.array([[266.7, 0, principal[0]], [0, 266.7, principal[1]], [0, 0, 1.0]])
    camera = Camera(K, look_at((1.0, 0.7, 2.5), (0.1, 0.0, 0.0)), 108, 192, kind)
    points = np.random.default_rng(1).uniform(-0.5, 0.5, (50, 3))
    in_blender = points @ BLENDER_TO_WORLD[:3, :3]
    pixels = blender_projection(BlenderCamera.from_camera(camera), 108, 192, in_blender)
    assert pixels == pytest.approx(camera.project(points)[0], abs=1e-9)


def test_a_camera_that_blender_lacks_is_refused():
    camera = RingRig().cameras(108, 192)[0]
    K = camera.K.copy()
    K[1, 1] *= 1.01
    with pytest.raises(DataError, match="square pixels"):
        BlenderCamera.from_camera(replace(camera, K=K))


def test_the_scene_survives_json(figure, recipe):
    scene = describe(figure, recipe)
    again = from_json(Scene, json.loads(json.dumps(to_json(scene))), "the job", "a scene")
    assert again == scene
    assert again.views[1].border == scene.views[1].border
    assert [view.file for view in again.views] == ["rgb/00.png", "rgb/01.png", "rgb/02.png"]


def test_every_view_has_its_own_seed_and_zero_is_a_seed(figure, recipe):
    seeds = [view.seed for view in describe(figure, recipe).views]
    others = [view.seed for view in describe(figure, replace(recipe, seed=1)).views]
    assert len({*seeds, *others}) == 6
    assert all(0 <= seed < 2**31 for seed in (*seeds, *others))
    assert seeds == [view.seed for view in describe(figure, recipe).views]


def test_no_key_light_when_its_strength_is_zero(figure, recipe):
    scene = describe(figure, replace(recipe, key_light_strength=0.0))
    assert all(view.key_light is None for view in scene.views)
    lit = describe(figure, replace(recipe, key_light_strength=2.0)).views[0].key_light
    single = describe(figure, replace(recipe, key_light_strength=1.0)).views[0].key_light
    assert lit.power_w == pytest.approx(2 * single.power_w)


def test_the_key_light_shines_on_the_subject(figure, recipe):
    for view in describe(figure, recipe).views:
        matrix = np.array(view.key_light.matrix_world)
        position, axis = matrix[:3, 3], -matrix[:3, 2]
        assert np.linalg.norm(np.cross(position, axis)) < 1e-9, "its axis meets the origin"
        assert position @ axis < 0, "and it looks at it"


def test_the_border_holds_the_subject(figure, recipe):
    for view, camera in zip(describe(figure, recipe).views, recipe.cameras(), strict=True):
        left, bottom, right, top = view.border
        pixels, _ = camera.project(figure.vertices)
        share = pixels / (camera.width, camera.height)
        assert left < share[:, 0].min() < share[:, 0].max() < right
        assert 1 - top < share[:, 1].min() < share[:, 1].max() < 1 - bottom
        assert (right - left) * (top - bottom) < 0.7, "and saves time"


def test_the_mesh_in_blenders_world_stands_up(figure):
    vertices = vertices_in_blender(figure)
    assert vertices[:, 2] == pytest.approx(figure.vertices[:, 1], abs=1e-6)  # up
    assert -vertices[:, 1] == pytest.approx(figure.vertices[:, 2], abs=1e-6)  # facing -Y
    assert vertices[:, 0] == pytest.approx(figure.vertices[:, 0], abs=1e-6)  # its left

"""What the views ask of each face."""

from __future__ import annotations

import numpy as np
import pytest

from harness.core.errors import DataError, HarnessError, MethodError
from harness.core.mesh import Mesh
from harness.core.rigs import RingRig
from harness.core.settings import overridden
from harness.geometry.coinciding import concatenated
from methods.closed.surfaces import Surface
from methods.nview.settings import FusionSettings
from methods.nview.system import fused_targets, sightings, trust
from methods.nview.views import NormalTargets, checked_views

SETTINGS = FusionSettings(body="off")


def test_exact_maps_of_all_views_give_the_faces_their_own_normals(ball, ring, views_of):
    surface = Surface(ball)
    targets = fused_targets(surface, views_of(ball, ring()), SETTINGS, 9)
    seen = targets.confidence > 0.3
    cosine = np.einsum("ij,ij->i", targets.normals, surface.face_normals)
    # Half of a face's own curvature is within a pixel.
    assert np.degrees(np.arccos(cosine[seen].min())) < 3
    assert targets.phantom.max() == 0
    # Only the poles are seen by nobody: eight cameras see everything else well.
    assert seen[np.abs(surface.centroids[:, 1]) < 0.16].all()


def test_what_is_behind_something_is_not_asked_for(ball, ring, views_of):
    small = Mesh(0.3 * ball.vertices + [0, 0, 0.6], ball.faces)  # between the ball and camera 0
    both = Surface(concatenated([ball, small]))
    seen = sightings(both, views_of(both.mesh, ring()[:1]), 2.0, 0.0)
    on_ball = seen.faces[seen.faces < len(ball.faces)]
    centres = both.centroids[on_ball]
    shadow = 0.06 * (1.5 - centres[:, 2]) / 0.9
    assert (np.hypot(centres[:, 0], centres[:, 1]) > 0.95 * shadow).all()
    assert len(on_ball) > 500


def test_one_view_that_disagrees_is_outvoted(ball, ring, views_of):
    surface = Surface(ball)
    views = views_of(ball, ring())
    given = views[0].targets
    turn = np.radians(50)
    tilt = np.array([[1, 0, 0], [0, np.cos(turn), -np.sin(turn)], [0, np.sin(turn), np.cos(turn)]])
    tilted = NormalTargets(given.camera, (given.normals_world @ tilt).astype(np.float32))
    targets = fused_targets(surface, [views[0].with_targets(tilted), *views[1:]], SETTINGS, 9)
    middle = np.abs(surface.centroids[:, 1]) < 0.12
    cosine = np.einsum("ij,ij->i", targets.normals, surface.face_normals)[middle]
    assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).mean() < 8


def test_views_that_contradict_a_face_make_it_phantom(ball, ring, views_of):
    """All normals look upward on a surface that stands upright."""
    up = np.array([0.0, 2.0, 0.0])

    def lifted(maps):
        shown = maps.any(axis=2, keepdims=True)
        turned = maps + up * shown
        return turned / np.maximum(np.linalg.norm(turned, axis=2, keepdims=True), 1e-9)

    surface = Surface(ball)
    targets = fused_targets(surface, views_of(ball, ring(), normals=lifted), SETTINGS, 0)
    side = np.abs(surface.centroids[:, 1]) < 0.01  # asked to turn by 63 degrees
    assert targets.phantom[side].min() > 0.9
    assert targets.phantom[surface.centroids[:, 1] > 0.15].max() == 0


def test_without_normals_nothing_is_asked_for(ball, ring, views_of):
    views = [view.with_targets(None) for view in views_of(ball, ring())]
    targets = fused_targets(Surface(ball), views, SETTINGS, 0)
    assert not targets.confidence.any()
    assert not targets.normals.any()


def test_maps_are_of_their_cameras_size(ring):
    camera = ring()[0]
    with pytest.raises(MethodError, match="map of normals is not of its camera's size"):
        NormalTargets(camera, np.zeros((480, 361, 3), dtype=np.float32))
    with pytest.raises(MethodError, match="map of weights is not of its camera's size"):
        NormalTargets(
            camera, np.zeros((480, 360, 3), np.float32), np.zeros((10, 10), dtype=np.float32)
        )


def test_a_mirrored_camera_is_no_camera():
    camera = RingRig(1).cameras(10, 10)[0]
    mirrored = np.array(camera.world_to_camera)
    mirrored[0] *= -1
    with pytest.raises(DataError, match="not rigid"):
        type(camera)(camera.K, mirrored, 10, 10)


def test_too_many_views_are_refused(ball, ring, views_of):
    views = views_of(ball, ring(3))
    with pytest.raises(MethodError, match="expected 3 to 64 views; got 65"):
        checked_views([views[0]] * 65)


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"voxel_m": "0.2"}, "0.002 to 0.05 metres"),
        ({"rounds": "-1"}, "setting 'rounds'"),
        ({"body": "maybe"}, "on or off"),
        ({"normals": "body", "body": "off"}, "where setting 'body' is 'off'"),
        ({"normals": "onnx"}, "normals_model"),
        ({"normals": "off", "normals_model": "mine"}, "not used where 'normals' is 'off'"),
        ({"voxel": "0.006"}, "Did you mean 'voxel_m'"),
    ],
)
def test_settings_that_cannot_be_are_refused(settings, said):
    with pytest.raises(HarnessError, match=said):
        overridden(FusionSettings(), settings)


def test_trust_falls_with_the_variance():
    expected_deg = np.array([[0.0, 10.0, 20.0, 30.0, 90.0]])
    shown = np.array([[True, True, True, False, False]])
    # Of those that are shown 10 degrees are the median.
    np.testing.assert_allclose(trust(expected_deg, shown, 10.0)[0, :4], [2.0, 1.0, 0.4, 0.2])


def test_pixels_that_are_said_to_be_off_lose_to_those_that_are_right(ball, ring, views_of):
    """The left half of every map is tilted, and says so; each face is in some right half."""
    surface = Surface(ball)
    views = views_of(ball, ring())
    turn = np.radians(25)
    tilt = np.array([[1, 0, 0], [0, np.cos(turn), -np.sin(turn)], [0, np.sin(turn), np.cos(turn)]])

    def off_deg(trusted_deg):
        told = []
        for view in views:
            maps = view.targets.normals_world
            left = np.zeros(maps.shape[:2], bool)
            left[:, : maps.shape[1] // 2] = True
            given = np.where(left[..., None], maps @ tilt, maps).astype(np.float32)
            weights = None
            if trusted_deg:
                expected_deg = np.where(left, 25.0, 2.0)
                weights = trust(expected_deg, maps.any(axis=2), trusted_deg).astype(np.float32)
            told.append(view.with_targets(NormalTargets(view.camera, given, weights)))
        targets = fused_targets(surface, told, SETTINGS, 9)
        middle = np.abs(surface.centroids[:, 1]) < 0.12
        cosine = np.einsum("ij,ij->i", targets.normals, surface.face_normals)[middle]
        return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))).mean())

    assert off_deg(0.0) > 8.0
    assert off_deg(5.0) < 0.25 * off_deg(0.0)

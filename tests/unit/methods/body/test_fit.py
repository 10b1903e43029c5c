"""Known bodies come back from perfect evidence, whichever cameras look, swapped views or not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from methods.body.fit.jmbo import head_cost, optimise
from methods.body.fit.landmark_fit import average, fit_each_view, fit_jointly, swapped_views
from methods.body.fit.weights import Weights
from methods.body.models.model import box_middle, neutral
from methods.body.photos.detection import MIRRORED


@pytest.fixture(autouse=True)
def _one_thread():
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def errors_mm(anny, parameters, person):
    _, posed, _ = person
    with torch.no_grad():
        found = anny.posed(parameters)
    main = [index for role, index in anny.roles.items() if role != "head"]
    joints = (found.joints - posed.joints)[0, main].norm(dim=1).mean().item() * 1000
    vertices = (found.vertices - posed.vertices)[0].norm(dim=1).mean().item() * 1000
    return joints, vertices


@pytest.fixture(scope="module")
def ring8(anny, make_views):
    """Eight perfect views, and the body that their landmarks give."""
    views = make_views(make_views.ring(8))
    return views, from_landmarks(anny, views)


def from_landmarks(anny, views):
    sparse = anny.sparse()
    start = average(fit_each_view(sparse, views.views, views.detections))
    return fit_jointly(sparse, views.views, views.detections, start)


@pytest.mark.nightly
def test_one_view_gives_the_pose_at_the_rigs_centre(anny, person, make_views):
    views = make_views(make_views.ring(8)[:1])
    found = fit_each_view(anny.sparse(), views.views, views.detections)
    with torch.no_grad():
        seen = anny.landmark_points(anny.posed(found))[0].double().numpy()
    pixels, _ = views.views[0].camera.project(seen)
    error = np.abs(pixels - views.detections.pixels[0][anny.landmarks.landmarks])
    assert np.median(error) < 2.0
    assert abs(found["translation"][0, 2]) < 0.08


def test_grain_of_a_photo_hardly_moves_one_views_body(anny, make_views):
    """Landmarks that are a hundredth of a pixel off are what another processor gives."""
    views = make_views(make_views.ring(8)[:1])
    rng = np.random.default_rng(0)
    moved = views.detections.pixels + 0.01 * rng.normal(size=views.detections.pixels.shape)
    found = [
        anny.posed(fit_each_view(anny.sparse(), views.views, seen)).joints.detach()
        for seen in (views.detections, replace(views.detections, pixels=moved))
    ]
    assert (found[0] - found[1]).norm(dim=2).max() < 1e-3


@pytest.mark.nightly
def test_one_view_of_a_reaching_body_centres_its_box_and_not_its_root(anny, make_views):
    """The world's frame says where the box is: known is the answer for whatever pose and view."""
    parameters = neutral(anny)
    for side in "LR":
        index = [joint.name for joint in anny.free].index(f"upperarm01.{side}")
        parameters["pose"][0, index] = torch.tensor([-1.2, 0.0, 0.0])
    with torch.no_grad():
        box = anny.posed(parameters).vertices[0]
        parameters["translation"] = -(box.amin(0) + box.amax(0))[None] / 2
        truth = anny.posed(parameters)
    root = parameters["translation"][0]
    assert root[2] < -0.1
    ring = make_views.ring(8)
    views = make_views([ring[0], ring[1]], posed=truth)
    found = fit_each_view(anny.sparse(), views.views, views.detections)
    with torch.no_grad():
        posed = anny.posed(found)
    for view in range(2):
        forward = torch.tensor(views.views[view].camera.forward, dtype=torch.float32)
        box = posed.vertices[view]
        assert abs((box.amin(0) + box.amax(0)) @ forward / 2) < 0.02
        assert abs((found["translation"][view] - root) @ forward) < 0.04


@pytest.mark.nightly
def test_a_detectors_metres_do_not_say_how_far_away_one_views_body_is(anny, make_views):
    """They are a mean person's, whoever is seen: shorter limbs in space are no nearer body."""
    seen = make_views(make_views.ring(8)[:1])
    (view,) = seen.views
    alone = (replace(view, place=replace(view.place, depth_is_known=False)),)
    depths_m = []
    for size in (1.0, 0.8):
        points = size * seen.detections.points_camera
        found = fit_each_view(anny.sparse(), alone, replace(seen.detections, points_camera=points))
        with torch.no_grad():
            middle = box_middle(anny.posed(found).vertices)[0].double().numpy()
        depths_m.append(view.camera.forward @ middle)
    assert depths_m[1] == pytest.approx(depths_m[0], abs=1e-3)
    assert depths_m[0] == pytest.approx(0.0, abs=0.1)


def test_the_body_of_one_orthographic_view_stays_at_its_subjects_place(anny, make_views):
    """It looks the same at any depth."""
    seen = make_views([make_views.ring(8)[0].weak_perspective(3.0)])
    (view,) = seen.views
    alone = (replace(view, place=replace(view.place, depth_is_known=False)),)
    found = fit_each_view(anny.sparse(), alone, seen.detections)
    with torch.no_grad():
        middle = box_middle(anny.posed(found).vertices)[0].double().numpy()
    assert view.camera.forward @ middle == pytest.approx(0.0, abs=0.1)


@pytest.mark.nightly
def test_joint_optimisation_of_one_view_does_not_walk_away(anny, person, make_views):
    """Its mask and landmarks fit at many distances; a start that is off by 20 cm must come back."""
    camera = make_views.ring(8)[1]
    views = make_views([camera])
    forward = torch.tensor(camera.forward, dtype=torch.float32)
    start = {**neutral(anny), "translation": 0.2 * forward[None]}
    fit = optimise(anny, views, start, Weights(iterations=20, schedule="ramp"), seed=0)
    with torch.no_grad():
        middle = box_middle(anny.posed(fit.parameters).vertices)[0]
    assert abs(float(middle @ forward)) < 1e-4
    assert min(fit.costs) < fit.costs[0]


@pytest.mark.nightly
@pytest.mark.usefixtures("quick_landmarks")
def test_depth_in_space_counts_where_front_and_back_view_leave_it_open(anny, person, make_views):
    """From pictures that are 3 pixels off, the pictures alone tell this body to 46 mm."""
    ring = make_views.ring(8)
    views = make_views([ring[0], ring[4]])
    pixels = views.detections.pixels
    noise = 3.0 * np.random.default_rng(0).standard_normal(pixels.shape)
    noisy = replace(views, detections=replace(views.detections, pixels=pixels + noise))
    joints, _ = errors_mm(anny, from_landmarks(anny, noisy), person)
    assert joints < 25


@pytest.mark.nightly
@pytest.mark.usefixtures("quick_landmarks")
@pytest.mark.parametrize("rig", ["ring3", "uneven", "pitched"])
def test_landmarks_of_several_views_give_the_body(anny, person, make_views, rig):
    cameras = {
        "ring3": make_views.ring(3),
        "uneven": [make_views.ring(16)[i] for i in (0, 1, 3, 9)],
        "pitched": make_views.ring(4, pitch_deg=30.0),
    }[rig]
    joints, vertices = errors_mm(anny, from_landmarks(anny, make_views(cameras)), person)
    assert joints < 25
    assert vertices < 30


@pytest.mark.nightly
def test_landmarks_of_eight_views_give_the_body(anny, person, ring8):
    joints, vertices = errors_mm(anny, ring8[1], person)
    assert joints < 25
    assert vertices < 30


@pytest.mark.nightly
@pytest.mark.usefixtures("quick_landmarks")
@pytest.mark.parametrize("swapped", [(4,), (3, 4, 5)])
def test_swapped_views_are_found_and_do_no_harm(anny, ring8, swapped):
    views, clean = ring8
    wrong = np.isin(np.arange(8), swapped)
    broken = views.detections.mirrored(wrong)
    assert not np.array_equal(broken.pixels[4], views.detections.pixels[4])
    spoiled = from_landmarks(anny, replace(views, detections=broken))
    found = swapped_views(anny.sparse(), views.views, broken, spoiled)
    np.testing.assert_array_equal(found, wrong)
    assert not swapped_views(anny.sparse(), views.views, views.detections, clean).any()
    repaired = fit_jointly(anny.sparse(), views.views, broken.mirrored(found), spoiled)
    with torch.no_grad():
        apart = anny.posed(repaired).joints - anny.posed(clean).joints
    assert apart.norm(dim=-1).mean().item() < 0.003


@pytest.mark.nightly
def test_joint_fit_finds_the_unclothed_body(anny, person, make_views, ring8):
    """A sign, a camera or a pixel that is wrong shows here, where no cloth hides it."""
    views = make_views(make_views.ring(4), normals=True)
    fit = optimise(anny, views, ring8[1], Weights(iterations=40, schedule="ramp"), seed=0)
    joints, vertices = errors_mm(anny, fit.parameters, person)
    assert joints < 6
    assert vertices < 6
    assert fit.terms["silhouette"][1] < fit.terms["silhouette"][0]
    # What is left of the cost is the masks' soft edge, which a body of whole pixels cannot match.
    assert min(fit.costs) < 0.8 * fit.costs[0]


@pytest.mark.nightly
def test_equal_seeds_give_equal_bodies_and_batches_see_every_view(anny, person, make_views):
    views = make_views(make_views.ring(4))
    parameters, _, _ = person
    weights = Weights(iterations=6, batch=2)
    first, again = (optimise(anny, views, parameters, weights, seed=5) for _ in range(2))
    other = optimise(anny, views, parameters, weights, seed=6)
    for name, value in first.parameters.items():
        assert torch.equal(value, again.parameters[name])
    assert not torch.equal(first.parameters["pose"], other.parameters["pose"])


@pytest.mark.nightly
def test_a_start_moved_by_a_hair_moves_the_mean_of_iterates_less(anny, person, make_views):
    """Another processor moves it so. Steps of Adam scatter the iterates, and less so their mean."""
    views = make_views(make_views.ring(8), normals=True)
    bent = 0.15 * torch.randn(person[0]["pose"].shape, generator=torch.Generator().manual_seed(9))
    start = {**person[0], "pose": person[0]["pose"] + bent}
    apart = {}
    for keep in ("last", "mean"):
        ends = []
        for hair in (0.0, 1e-6, -1e-6):
            moved = {name: value + hair for name, value in start.items()}
            fit = optimise(anny, views, moved, Weights(keep=keep), seed=0)
            with torch.no_grad():
                ends.append(anny.posed(fit.parameters).joints[0, list(anny.roles.values())])
        apart[keep] = (torch.stack(ends[1:]) - ends[0]).norm(dim=2).mean().item()
    assert apart["mean"] < 0.8 * apart["last"] < 0.01


def test_a_term_that_is_off_does_not_count(anny, person, make_views):
    views = make_views(make_views.ring(2))
    parameters, _, _ = person
    off = Weights(iterations=1, silhouette=0.0, landmark=0.0, normal=0.0, head=1.0)
    fit = optimise(anny, views, parameters, off, seed=0)
    with torch.no_grad():
        head = head_cost(anny, anny.posed(parameters)).item()
    assert fit.costs[0] == pytest.approx(head)


def test_head_cost_is_the_tilt_whichever_way_the_body_faces(anny):
    parameters = neutral(anny)
    assert head_cost(anny, anny.posed(parameters)).item() == pytest.approx(0.0, abs=1e-6)
    index = [joint.name for joint in anny.free].index("head")
    parameters["pose"][0, index, 0] = 0.5
    back = torch.tensor([[-1.0, 0], [0, 1], [0, 0]])
    for orientation in (parameters["orientation"][0], back):
        turned = {**parameters, "orientation": orientation[None]}
        cost = head_cost(anny, anny.posed(turned)).item()
        assert cost == pytest.approx(1 - np.cos(0.5), abs=1e-5)


def test_mirroring_twice_changes_nothing():
    np.testing.assert_array_equal(MIRRORED[MIRRORED], np.arange(33))
    assert MIRRORED[11] == 12
    assert MIRRORED[0] == 0

"""Bodies obey the package that they come from, and the conventions that the fit relies on."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from harness.core.camera import Camera
from methods.body.fit.evidence import Projector
from methods.body.models.model import MAIN_JOINTS, neutral


def test_neutral_body_stands_upright_and_faces_forward(anny):
    vertices, joints = anny(neutral(anny))
    vertices, joints = vertices[0].numpy(), joints[0].numpy()
    role = {name: joints[index] for name, index in anny.roles.items()}
    assert 1.5 < np.ptp(vertices[:, 1]) < 1.9
    assert role["left_shoulder"][0] > 0.1 > -0.1 > role["right_shoulder"][0]
    assert role["head"][1] > role["left_hip"][1] > role["left_knee"][1] > role["left_ankle"][1]
    # The face is in front of the head's joint, the toes in front of the ankles.
    assert vertices[anny.regions["face"], 2].mean() > role["head"][2]
    assert vertices[:, 2][vertices[:, 1] < role["left_ankle"][1]].max() > role["left_ankle"][2]
    assert set(MAIN_JOINTS) < set(anny.roles)


def test_faces_look_outward(anny):
    from harness.core.mesh import Mesh

    vertices, _ = anny(neutral(anny))
    assert 0.04 < Mesh(vertices[0].double().numpy(), anny.faces).signed_volume < 0.12


def test_rotations_are_about_the_worlds_axes(anny):
    """The left arm lifted by a rotation about +Z swings up, on the person's left, +X."""
    parameters = neutral(anny)
    index = [joint.name for joint in anny.free].index("upperarm01.L")
    parameters["pose"][0, index] = torch.tensor([0.0, 0.0, 0.5])
    before, after = anny(neutral(anny))[1][0], anny(parameters)[1][0]
    wrist = anny.roles["left_wrist"]
    assert after[wrist, 1] > before[wrist, 1] + 0.15
    arm = before[wrist] - before[anny.roles["left_shoulder"]]
    turned = after[wrist] - after[anny.roles["left_shoulder"]]
    cos, sin = np.cos(0.5), np.sin(0.5)
    expected = torch.tensor([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]]).float() @ arm
    torch.testing.assert_close(turned, expected, atol=2e-4, rtol=0)


def test_orientation_and_place_are_the_roots(anny):
    parameters = neutral(anny)
    quarter = torch.tensor([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    parameters["orientation"] = quarter[None, :, :2].clone()
    parameters["translation"] = torch.tensor([[0.1, 0.2, 0.3]])
    posed, rest = anny.posed(parameters), anny.posed(neutral(anny))
    torch.testing.assert_close(posed.joints[0, 0], torch.tensor([0.1, 0.2, 0.3]))
    expected = rest.vertices[0] @ quarter.T + torch.tensor([0.1, 0.2, 0.3])
    torch.testing.assert_close(posed.vertices[0], expected, atol=2e-5, rtol=0)
    torch.testing.assert_close(posed.turns[0, anny.roles["head"]], quarter, atol=1e-5, rtol=0)


def test_exported_parameters_make_the_same_body(anny, person):
    import anny as package

    parameters, posed, _ = person
    exported = anny.export(parameters)
    model = package.Anny(topology="anny", skinning_method="lbs").to(torch.float32)
    values = zip(exported["phenotype_names"], exported["phenotype"], strict=True)
    output = model(
        pose_parameters=torch.tensor(exported["pose_parameters"])[None],
        phenotype_kwargs={str(name): float(value) for name, value in values},
    )
    turned = output["vertices"][0].numpy() @ np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
    np.testing.assert_allclose(posed.vertices[0].numpy(), turned, atol=1e-5)
    again = anny.posed_as(
        exported["pose_parameters"],
        dict(
            zip(exported["phenotype_names"].tolist(), exported["phenotype"].tolist(), strict=True)
        ),
    )
    for name in ("vertices", "joints", "turns"):
        torch.testing.assert_close(getattr(again, name), getattr(posed, name), atol=1e-5, rtol=0)


def test_shapes_are_those_of_the_files_and_no_decomposition_of_them(anny):
    """A decomposition rounds, and turns, as the threads of the machine that made it have it."""
    from anny.models import build_model_data
    from anny.models.model_data import RigConfig, TopologyConfig

    files = build_model_data(
        rig=RigConfig.from_string("anny"),
        topology=TopologyConfig.from_string("anny"),
        local_changes="none",
        facial_actions="none",
    )
    shapes = anny._model.blendshapes
    assert shapes.dtype == torch.float32
    assert torch.equal(shapes, files.blendshapes.to(torch.float32))


def test_sparse_body_has_the_same_landmarks(anny, person):
    parameters, _, points = person
    sparse = anny.sparse()
    posed = sparse.posed(parameters)
    assert posed.vertices.shape[1] < 2000
    np.testing.assert_allclose(sparse.landmark_points(posed)[0].numpy(), points, atol=2e-6)
    assert len(anny.faces) > 20000


def test_sparse_body_has_the_same_extent(anny, person):
    parameters, full, _ = person
    few, all_ = (p.vertices[0] for p in (anny.sparse().posed(parameters), full))
    for side in (torch.amin, torch.amax):
        torch.testing.assert_close(side(few, 0), side(all_, 0), atol=0.015, rtol=0)


def test_landmarks_are_where_their_names_say(anny):
    posed = anny.posed(neutral(anny))
    points = dict(
        zip(anny.landmarks.landmarks, anny.landmark_points(posed)[0].numpy(), strict=True)
    )
    for left, role in ((11, "shoulder"), (13, "elbow"), (15, "wrist"), (25, "knee"), (27, "ankle")):
        for landmark, side in ((left, "left"), (left + 1, "right")):
            joint = posed.joints[0, anny.roles[f"{side}_{role}"]].numpy()
            assert np.linalg.norm(points[landmark] - joint) < 0.08, (side, role)
    assert points[0][2] > points[7][2]  # the nose is in front of the ears


def test_regions_are_small_and_apart(anny):
    left, right = anny.regions["left_hand"], anny.regions["right_hand"]
    hands, face, eyes = left | right, anny.regions["face"], anny.regions["eyeballs"]
    assert 0 < eyes.sum() < 400
    assert not (hands & face).any()
    assert not (left & right).any()
    assert left.sum() == right.sum() > 500
    assert face.sum() > 1000


@pytest.mark.parametrize("pitch_deg", [0.0, 30.0])
def test_projection_equals_the_camera(pitched_camera, pitch_deg):
    camera: Camera = pitched_camera(pitch_deg)
    points = np.random.default_rng(0).normal(0, 0.4, (50, 3))
    pixels, _ = camera.project(points)
    np.testing.assert_allclose(Projector(camera)(torch.tensor(points)).numpy(), pixels, atol=1e-9)

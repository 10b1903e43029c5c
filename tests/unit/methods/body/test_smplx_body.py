"""SMPL-X's real loading code, on a file of the right shape that holds no licensed number."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest
import torch

from harness.core.errors import DataError, MissingPart
from methods.body.models.model import neutral
from methods.body.models.smplx_body import SmplxBody


class Planted:
    """Makes a file when it is unpickled."""

    def __init__(self, trap: Path) -> None:
        self.trap = trap

    def __reduce__(self):
        return Path.touch, (self.trap,)


@pytest.fixture(scope="module")
def model_file(tmp_path_factory, smplx_arrays):
    path = tmp_path_factory.mktemp("smplx") / "SMPLX_NEUTRAL.npz"
    np.savez(path, **smplx_arrays)
    return path


@pytest.fixture(scope="module")
def light_arrays(smplx_arrays):
    """The same numbers in a third of the bytes: what is written and read in single precision."""
    blends = smplx_arrays["shapedirs"].astype(np.float32)
    return {**smplx_arrays, "shapedirs": blends, "posedirs": np.zeros((10475, 3, 486), np.float16)}


@pytest.fixture(scope="module")
def body(model_file):
    return SmplxBody(model_file)


def test_exported_parameters_make_the_same_body_in_the_package(body, model_file):
    import smplx

    random = torch.Generator().manual_seed(1)
    parameters = neutral(body)
    parameters["pose"] = 0.3 * torch.randn(1, 21, 3, generator=random)
    parameters["shape"] = torch.randn(1, 10, generator=random)
    parameters["translation"] = torch.tensor([[0.1, -0.2, 0.3]])
    parameters["orientation"] = torch.tensor([[[0.8, 0.0], [0.0, 1.0], [-0.6, 0.0]]])
    posed = body.posed(parameters)
    model = smplx.SMPLX(str(model_file), ext="npz", use_pca=False, flat_hand_mean=True)
    arguments = {name: torch.tensor(value) for name, value in body.export(parameters).items()}
    output = model(**arguments)
    torch.testing.assert_close(output.vertices, posed.vertices, atol=2e-5, rtol=0)
    torch.testing.assert_close(output.joints[:, :55], posed.joints, atol=2e-5, rtol=0)


def test_turns_are_those_of_the_joints(body):
    """A point fixed to a joint moves with that joint's turn."""
    parameters = neutral(body)
    random = torch.Generator().manual_seed(2)
    parameters["pose"] = 0.4 * torch.randn(1, 21, 3, generator=random)
    rest, posed = body.posed(neutral(body)), body.posed(parameters)
    head = body.roles["head"]
    owned = head + 55 * 3
    before = rest.vertices[0, owned] - rest.joints[0, head]
    after = posed.vertices[0, owned] - posed.joints[0, head]
    torch.testing.assert_close(posed.turns[0, head] @ before, after, atol=1e-5, rtol=0)


def test_six_numbers_pose_like_three(body):
    import roma

    parameters = neutral(body)
    parameters["pose"] = 0.3 * torch.randn(1, 21, 3, generator=torch.Generator().manual_seed(3))
    six = {**parameters, "pose": roma.rotvec_to_rotmat(parameters["pose"])[..., :2]}
    torch.testing.assert_close(body(parameters)[0], body(six)[0], atol=1e-5, rtol=0)


def test_expression_jaw_and_hands_are_taken(body):
    parameters = neutral(body)
    moved = {**parameters, "left_hand_pose": torch.full((1, 45), 0.3)}
    change = (body(moved)[0] - body(parameters)[0])[0].norm(dim=1)
    hands = body.regions["left_hand"] | body.regions["right_hand"]
    assert change[hands].max() > 0.005
    assert change[~hands].max() < 1e-6
    smiling = {**parameters, "expression": torch.ones(1, 10)}
    assert (body(smiling)[0] - body(parameters)[0]).abs().max() > 1e-4


def test_gradients_reach_every_parameter_also_from_behind(body):
    parameters = neutral(body, 2)
    parameters["orientation"][1] = torch.tensor([[-1.0, 0], [0, 1], [0, 0]])
    parameters = {name: value.requires_grad_() for name, value in parameters.items()}
    body.landmark_points(body.posed(parameters)).square().sum().backward()
    for value in parameters.values():
        assert torch.isfinite(value.grad).all()
        assert value.grad.abs().max() > 0


def test_a_pickled_model_is_the_same(body, model_file, tmp_path, light_arrays):
    path = tmp_path / "SMPLX_NEUTRAL.pkl"
    path.write_bytes(pickle.dumps(light_arrays))
    torch.testing.assert_close(SmplxBody(path)(neutral(body))[0], body(neutral(body))[0])


@pytest.mark.nightly
def test_what_the_body_does_not_need_is_never_rebuilt(body, tmp_path, light_arrays):
    """Real files hold tables of names as arrays of objects, older ones other packages' objects."""
    trap = tmp_path / "trap"
    names = {"pelvis": 0}
    extra = {"joint2num": np.array(names, dtype=object), "part2num": names, "chumpy": Planted(trap)}
    for name in ("SMPLX_NEUTRAL.npz", "SMPLX_NEUTRAL.pkl"):
        path = tmp_path / name
        if path.suffix == ".npz":
            np.savez(path, **light_arrays, **extra)
        else:
            path.write_bytes(pickle.dumps({**extra, **light_arrays}, protocol=2))
        torch.testing.assert_close(SmplxBody(path)(neutral(body))[0], body(neutral(body))[0])
    assert not trap.exists()
    for name in ("weights.npz", "weights.pkl"):
        path = tmp_path / name
        arrays = {**light_arrays, "weights": Planted(trap)}
        if path.suffix == ".npz":
            np.savez(path, **arrays)
        else:
            path.write_bytes(pickle.dumps(arrays))
        with pytest.raises(DataError, match="is no SMPL-X model .*weights"):
            SmplxBody(path)
    assert not trap.exists()


@pytest.mark.parametrize("name", ["", "absent.npz"])
def test_no_file_says_where_to_get_it(tmp_path, name, parts):
    with pytest.raises(MissingPart, match="smpl-x.is.tue.mpg.de"):
        SmplxBody(tmp_path / name if name else "")


def test_wrong_files_are_refused(tmp_path, light_arrays):
    broken = tmp_path / "SMPLX_NEUTRAL.npz"
    broken.write_bytes(b"PK not a zip")
    with pytest.raises(DataError, match="no SMPL-X model"):
        SmplxBody(broken)
    smaller = {**light_arrays, "weights": np.ones((10475, 24)) / 24}
    other = tmp_path / "other.npz"
    np.savez(other, **smaller)
    with pytest.raises(DataError, match="another model: its weights has another shape"):
        SmplxBody(other)
    astray = tmp_path / "astray.npz"
    np.savez(astray, **{**light_arrays, "f": np.full((20908, 3), 10475)})
    with pytest.raises(DataError, match="is damaged: f points at nothing"):
        SmplxBody(astray)
    text = tmp_path / "model.txt"
    text.write_text("x")
    with pytest.raises(DataError, match=r"an \.npz or \.pkl"):
        SmplxBody(text)

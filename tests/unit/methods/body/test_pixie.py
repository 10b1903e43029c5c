"""PIXIE: the reference architecture's answers, those of its ONNX file, and what they mean."""

from __future__ import annotations

import json

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation
from torch import nn

from harness.core.errors import DataError, MethodError
from methods.body.pixie import network
from methods.body.pixie import network as convert
from methods.body.pixie import start as decode
from methods.body.pixie.network import PixieBody
from methods.body.pixie.start import decoded, six_to_matrices
from methods.parts.conversion import bare, filled, shapes_of
from methods.parts.converted import NETWORK, OUTPUTS, PIXIE
from methods.parts.kind import ImportOptions
from methods.parts.onnx_networks import answers, open_session

#: The vectors' own rounding is 7e-7 and 3e-6; the least mistake moves them by 1.6e-3.
RAW, TURNS = 1e-5, 2e-5
STORED = {
    "body": "raw_body",
    "head": "raw_head_share",
    "left_hand": "raw_left_hand_share",
    "right_hand": "raw_right_hand_share",
}


@pytest.fixture(scope="module")
def golden(reference) -> dict[str, np.ndarray]:
    with np.load(reference("golden_pixie.npz")) as file:
        return dict(file)


@pytest.fixture(scope="module")
def raw(golden) -> dict[str, np.ndarray]:
    return {name: golden[stored][0] for name, stored in STORED.items()}


@pytest.fixture(scope="module")
def numbers(fill) -> dict[str, np.ndarray]:
    return fill(shapes_of(bare(PixieBody)), "hash", 0.8)


@pytest.fixture(scope="module")
def made(numbers) -> PixieBody:
    return filled(bare(PixieBody), numbers)


@pytest.fixture(scope="module")
def picture(golden) -> torch.Tensor:
    return torch.from_numpy(golden["image_u8"] / np.float32(255))[None]


def off(found: dict[str, np.ndarray], raw: dict[str, np.ndarray]) -> float:
    return max(float(np.abs(found[name] - raw[name]).max()) for name in OUTPUTS)


def answered(made: PixieBody, picture: torch.Tensor) -> dict[str, np.ndarray]:
    with torch.no_grad():
        return {name: each[0].numpy() for name, each in zip(OUTPUTS, made(picture), strict=True)}


def test_names_and_shapes_are_those_of_the_checkpoint(reference):
    encoder = json.loads(reference("pixie_encoder_body_keys.json").read_text())
    heads = json.loads(reference("pixie_heads_keys.json").read_text())
    for section, layers in bare(PixieBody).named_children():
        listed = encoder if section == "Encoder_body" else heads[section]
        wanted = {key: tuple(shape) for key, shape in listed.items()}
        found = shapes_of(layers)
        assert {key: wanted[key] for key in found} == found
        assert all(key.endswith(convert._IGNORED) for key in set(wanted) - set(found))


@pytest.mark.nightly
def test_golden_vectors(made, picture, raw):
    assert off(answered(made, picture), raw) < RAW


def upsampled(made: PixieBody, monkeypatch) -> None:
    for layer in made.modules():
        if isinstance(layer, nn.Upsample):
            monkeypatch.setattr(layer, "mode", "bilinear")


def loosened(made: PixieBody, monkeypatch) -> None:
    for layer in made.modules():
        if isinstance(layer, nn.BatchNorm2d):
            monkeypatch.setattr(layer, "eps", 1e-3)


def reordered(made: PixieBody, monkeypatch) -> None:
    encoder = made.Encoder_body.encoder
    joined = torch.cat

    def reverse(features, dim):
        return joined(features[::-1], dim=dim)

    monkeypatch.setattr(torch, "cat", reverse)
    assert encoder is not None


def cut(made: PixieBody, monkeypatch) -> None:
    for block in made.Encoder_body.encoder.conv_layers[1:]:
        monkeypatch.setitem(block._modules, "downsample", nn.Identity())


def exchanged(made: PixieBody, monkeypatch) -> None:
    left, right = made.Extractor_left_hand_share, made.Extractor_right_hand_share
    monkeypatch.setitem(made._modules, "Extractor_left_hand_share", right)
    monkeypatch.setitem(made._modules, "Extractor_right_hand_share", left)


def not_normalised(made: PixieBody, monkeypatch) -> None:
    monkeypatch.setattr(network, "_MEAN", (0.0, 0.0, 0.0))
    monkeypatch.setattr(network, "_DEVIATION", (1.0, 1.0, 1.0))


@pytest.mark.nightly
@pytest.mark.parametrize("change", [upsampled, loosened, reordered, cut, exchanged, not_normalised])
def test_each_mistake_of_the_network_is_seen(made, picture, raw, monkeypatch, change):
    change(made, monkeypatch)
    assert off(answered(made, picture), raw) > 50 * RAW


@pytest.mark.nightly
@pytest.mark.parametrize("mistake", ["BGR", "moved by a pixel", "normalised twice"])
def test_each_mistake_of_the_picture_is_seen(made, picture, raw, mistake):
    if mistake == "BGR":
        picture = picture.flip(1)
    elif mistake == "moved by a pixel":
        picture = picture.roll(1, 3)
    else:
        mean, deviation = (torch.tensor(each)[:, None, None] for each in
                           (network._MEAN, network._DEVIATION))  # fmt: skip
        picture = (picture - mean) / deviation
    assert off(answered(made, picture), raw) > 50 * RAW


@pytest.mark.nightly
def test_an_imported_part_meets_the_golden_vectors(numbers, tmp_path, parts, golden, raw, picture):
    sections: dict[str, dict[str, torch.Tensor]] = {"Encoder_head": {"x": torch.ones(2)}}
    for key, array in numbers.items():
        section, _, name = key.partition(".")
        sections.setdefault(section, {})[name] = torch.from_numpy(array)
    beside = {"MEAN": torch.ones(1, 3, 1, 1), "encoder.bn1.num_batches_tracked": torch.tensor(3)}
    sections["Encoder_body"].update(beside)
    torch.save(sections, tmp_path / "pixie_model.tar")
    PIXIE.add(tmp_path / "pixie_model.tar", ImportOptions())
    session = open_session(PIXIE.find().file(NETWORK))
    feeds = {"picture": np.concatenate([picture.numpy()] * 3)}
    found = dict(zip(OUTPUTS, answers(session, "PIXIE", feeds), strict=True))
    for place in range(3):
        assert off({name: each[place] for name, each in found.items()}, raw) < RAW

    # What the tensors hold does not matter to what is missing: one number each is quickly written.
    for tensors in sections.values():
        tensors.update({name: torch.zeros(()).expand(each.shape) for name, each in tensors.items()})
    del sections["Regressor_body"]["layers.2.bias"]
    torch.save(sections, tmp_path / "cut.tar")
    with pytest.raises(DataError, match="PIXIE's Regressor_body.*none called layers.2.bias"):
        convert.examine(tmp_path / "cut.tar", ImportOptions())
    del sections["Regressor_body"]
    torch.save(sections, tmp_path / "cut.tar")
    with pytest.raises(DataError, match="another checkpoint.*dictionary under Regressor_body"):
        convert.examine(tmp_path / "cut.tar", ImportOptions())


DECODED = {
    "camera": "dec_body_cam",
    "shape": "dec_shape",
    "expression": "dec_exp",
    "orientation": "dec_global_pose",
    "body_pose": "dec_body_pose",
    "jaw": "dec_jaw_pose",
    "left_hand": "dec_left_hand_pose",
    "right_hand": "dec_right_hand_pose",
}


def turns_off(raw: dict[str, np.ndarray], golden: dict[str, np.ndarray]) -> float:
    view = decoded(raw)
    found = {name: getattr(view, name) for name in DECODED}
    return max(
        float(np.abs(found[name] - golden[stored].reshape(found[name].shape)).max())
        for name, stored in DECODED.items()
    )


def test_golden_rotations(raw, golden):
    assert turns_off(raw, golden) < TURNS


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("_MIRRORED", np.ones((3, 3))),
        ("_MOST_HEAD_DEG", (180.0, 180.0, 180.0)),
        ("_ABSOLUTE", {}),
        ("_ABSOLUTE", {15: (12, 9, 6, 3, 0), 20: (18, 16, 13, 9, 6, 3), 21: (19, 17, 14, 9)}),
        ("_from_euler", lambda angles: Rotation.from_euler("xyz", angles).as_matrix()),
        (
            "six_to_matrices",
            lambda six: six_to_matrices(six.reshape(-1, 3, 2).transpose(0, 2, 1).ravel()),
        ),
    ],
)
def test_each_mistake_of_the_meaning_is_seen(raw, golden, monkeypatch, name, value):
    monkeypatch.setattr(decode, name, value)
    assert turns_off(raw, golden) > 100 * TURNS


def test_exchanged_hands_are_seen(raw, golden):
    swapped = {"left_hand": raw["right_hand"], "right_hand": raw["left_hand"]}
    assert turns_off({**raw, **swapped}, golden) > 100 * TURNS


def test_known_rotations():
    wanted = [[0.169031, 0.897085, -0.408248], [0.507093, 0.276027, 0.816497],
              [0.845154, -0.345032, -0.408248]]  # fmt: skip
    np.testing.assert_allclose(six_to_matrices(np.arange(1.0, 7.0))[0], wanted, atol=1e-6)
    jaw = [[0.671212, -0.565354, -0.479426], [0.507082, 0.821954, -0.259343],
           [0.540687, -0.069034, 0.838387]]  # fmt: skip
    np.testing.assert_allclose(decode._from_euler(np.array([0.3, -0.5, 0.7])), jaw, atol=1e-6)


def test_answers_that_cannot_be_used(raw):
    for bad in (raw["body"][:-1], np.full(117, np.nan)):
        with pytest.raises(MethodError, match="PIXIE's answer 'body' cannot be used.*117 finite"):
            decoded({**raw, "body": bad})

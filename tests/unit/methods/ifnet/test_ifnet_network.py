"""IF-Nets+: the reference architecture's answers, and those of its ONNX files."""

from __future__ import annotations

import json

import numpy as np
import pytest
import torch
from torch import nn
from torch.nn import functional

from harness.core.errors import DataError
from methods.ifnet import network
from methods.ifnet import network as convert
from methods.ifnet.network import IfNet
from methods.parts import conversion as torch_layers
from methods.parts.conversion import bare, filled, shapes_of
from methods.parts.converted import DECODER, ENCODER, IFNET
from methods.parts.kind import ImportOptions
from methods.parts.onnx_networks import answers, open_session

#: The vectors' own rounding is 1.1e-3; the least mistake below moves them by 9e-3.
GOLDEN = 2e-3


@pytest.fixture(scope="module")
def golden(reference) -> dict[str, torch.Tensor]:
    with np.load(reference("golden_ifnet.npz")) as file:
        return {name: torch.from_numpy(file[name]).double() for name in file.files}


@pytest.fixture
def filled_network(fill) -> IfNet:
    """In double precision, in which rounding does not matter."""
    numbers = fill(shapes_of(bare(IfNet), convert.PREFIX), "wave")
    return filled(bare(IfNet), numbers, convert.PREFIX).double()


def off(made: IfNet, golden: dict[str, torch.Tensor], points: torch.Tensor | None = None) -> float:
    points = golden["points"] if points is None else points
    with torch.no_grad():
        found = made(golden["depth_voxels"][None], golden["body_voxels"][None], points[None])
    return float((found[0] - golden["occupancy"]).abs().max())


def test_names_and_shapes_are_those_of_the_checkpoint(reference):
    keys = json.loads(reference("ifnet_keys.json").read_text())["keys"]
    found = shapes_of(bare(IfNet), convert.PREFIX)
    assert found == {key: tuple(shape) for key, shape in keys.items()}


def test_golden_vectors(filled_network, golden):
    assert off(filled_network, golden) < GOLDEN


@pytest.mark.nightly
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_mirrored_axis_is_seen(filled_network, golden, axis):
    points = golden["points"].clone()
    points[:, axis] *= -1
    assert off(filled_network, golden, points) > 4 * GOLDEN


@pytest.mark.nightly
@pytest.mark.parametrize("order", [(0, 2, 1), (1, 0, 2), (2, 1, 0), (1, 2, 0)])
def test_exchanged_axes_are_seen(filled_network, golden, order):
    assert off(filled_network, golden, golden["points"][:, list(order)]) > 4 * GOLDEN


def sampled(**changed):
    """``grid_sample`` with other arguments."""
    own = functional.grid_sample
    return lambda *given, **named: own(*given, **{**named, **changed})


def exchanged(made: IfNet) -> None:
    weight = made.conv_0_fusion.weight
    weight.data = torch.cat([weight[:, 16:], weight[:, :16]], 1)


def mirrored(made: IfNet) -> None:
    for layer in made.modules():
        if isinstance(layer, nn.Conv3d):
            layer.weight.data = layer.weight.flip(4)


def padded_with_zeros(made: IfNet) -> None:
    for layer in made.modules():
        if isinstance(layer, nn.Conv3d):
            layer.padding_mode = "zeros"


@pytest.mark.nightly
@pytest.mark.parametrize("change", [exchanged, mirrored, padded_with_zeros])
def test_other_convolutions_are_seen(filled_network, golden, change):
    change(filled_network)
    assert off(filled_network, golden) > 2 * GOLDEN


@pytest.mark.nightly
def test_exchanged_inputs_are_seen(filled_network, golden):
    swapped = {"depth_voxels": golden["body_voxels"], "body_voxels": golden["depth_voxels"]}
    assert off(filled_network, {**golden, **swapped}) > 2 * GOLDEN


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("place", "name", "value"),
    [
        (network, "_normalised", lambda x: functional.relu(torch_layers.instance_normalised(x))),
        (network, "_normalised", functional.relu),
        (torch_layers, "_EPS", 1e-2),
        (network._Attention, "forward", lambda own, x: own.conv(x)),
        (functional, "grid_sample", sampled(align_corners=False)),
    ],
    ids=["normalised before ReLU", "not normalised", "eps", "no attention", "corners not aligned"],
)
def test_another_layer_is_seen(filled_network, golden, monkeypatch, place, name, value):
    monkeypatch.setattr(place, name, value)
    assert off(filled_network, golden) > 2 * GOLDEN


@pytest.mark.nightly
def test_an_imported_part_meets_the_golden_vectors(fill, save_checkpoint, tmp_path, parts, golden):
    numbers = fill(shapes_of(bare(IfNet), convert.PREFIX), "wave")
    beside = {"netG.reconEngine.grid": np.ones(3, np.float32), "netD.x": np.ones(2, np.float32)}
    path = save_checkpoint(tmp_path / "ifnet.ckpt", {**numbers, **beside}, "state_dict", epoch=1)
    IFNET.add(path, ImportOptions())
    part = IFNET.find()
    assert {file.name for file in part.installed.path.iterdir()} == {ENCODER, DECODER, "part.json"}
    given = {name: each.numpy()[None].astype(np.float32) for name, each in golden.items()}
    voxels = {"sheets": given["depth_voxels"], "body": given["body_voxels"]}
    features = answers(open_session(part.file(ENCODER)), "encoder", voxels)
    asked = {
        "points": given["points"],
        "sheets": voxels["sheets"],
        **{f"features_{level}": each for level, each in enumerate(features)},
    }
    (found,) = answers(open_session(part.file(DECODER)), "decoder", asked)
    assert np.abs(found[0] - golden["occupancy"].numpy()).max() < GOLDEN


def test_a_variant_without_a_body_is_refused(fill, save_checkpoint, tmp_path):
    numbers = fill(shapes_of(bare(IfNet), convert.PREFIX))
    del numbers["netG.conv_in_smpl.weight"]
    with pytest.raises(DataError, match="does not hold IF-Nets.*none called netG.conv_in_smpl"):
        convert.examine(save_checkpoint(tmp_path / "i.ckpt", numbers), ImportOptions())

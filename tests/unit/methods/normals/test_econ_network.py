"""ECON's normal networks: the reference architecture's answers, and those of its ONNX files."""

from __future__ import annotations

import json
from collections.abc import Callable

import numpy as np
import pytest
import torch
from torch import nn

from harness.core.errors import DataError
from methods.normals import econ_network as convert
from methods.normals.econ_network import NormalGenerator
from methods.parts import conversion as torch_layers
from methods.parts.conversion import bare, filled, shapes_of
from methods.parts.converted import FILES
from methods.parts.kind import ImportOptions
from methods.parts.onnx_networks import answers, open_session

#: The vectors' own rounding is 2.1e-3; the least mistake moves them by 0.19.
GOLDEN = 5e-3
SIDES = {"netF": "T_normal_F", "netB": "T_normal_B"}
SMALL = 4


def shapes(name: str, width: int = 64) -> dict[str, tuple[int, ...]]:
    return shapes_of(bare(NormalGenerator, width=width), f"netG.{name}.")


@pytest.fixture(scope="module")
def golden(reference) -> dict[str, np.ndarray]:
    with np.load(reference("golden_normalnet.npz")) as file:
        return dict(file)


@pytest.fixture(scope="module")
def network(fill) -> Callable[[str], nn.Module]:
    """``network(name)``: the last one that was filled, as it would be run."""
    last: dict[str, nn.Module] = {}

    def make(name: str) -> nn.Module:
        if name not in last:
            last.clear()
            numbers = fill(shapes(name), "wave")
            last[name] = filled(bare(NormalGenerator), numbers, f"netG.{name}.")
        return last[name]

    return make


def off(network: nn.Module, image: np.ndarray, body: np.ndarray, wanted: np.ndarray) -> float:
    kind = next(network.parameters()).dtype
    with torch.no_grad():
        found = network(*(torch.from_numpy(each[None].copy()).to(kind) for each in (image, body)))
    return float(np.abs(found[0].numpy() - wanted).max())


def test_names_and_shapes_are_those_of_the_checkpoint(reference):
    keys = json.loads(reference("econ_normalnet_keys.json").read_text())["keys"]
    found = {**shapes("netF"), **shapes("netB")}
    assert found == {key: tuple(shape) for key, shape in keys.items()}


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["netB", "netF"])
def test_golden_vectors(network, golden, name):
    """In double precision: some processors' single precision is off by 7e-3."""
    exact = bare(NormalGenerator)
    state = {key: tensor.double() for key, tensor in network(name).state_dict().items()}
    exact.load_state_dict(state, assign=True)
    assert off(exact, golden["image"], golden[SIDES[name]], golden[f"{name}_raw"]) < GOLDEN


#: What a network may be shown instead of photo, front and back of the body.
SHOWN = {
    "body first": lambda image, front, back: (front, image),
    "BGR": lambda image, front, back: (image[::-1], front),
    "from 0 to 1": lambda image, front, back: ((image + 1) / 2, front),
    "left for right": lambda image, front, back: (image[..., ::-1], front[..., ::-1]),
    "the other side's body": lambda image, front, back: (image, back),
}


@pytest.mark.nightly
@pytest.mark.parametrize("mistake", SHOWN)
def test_each_mistake_of_the_input_is_seen(network, golden, mistake):
    sides = (golden[name] for name in ("image", "T_normal_F", "T_normal_B"))
    moved = off(network("netF"), *SHOWN[mistake](*sides), golden["netF_raw"])
    assert moved > 20 * GOLDEN


@pytest.mark.nightly
@pytest.mark.parametrize(
    "mistake",
    ["zero padding", "mirrored kernels", "a missing block", "no ReLU", "not normalised", "eps"],
)
def test_each_mistake_is_seen(network, golden, monkeypatch, mistake):
    image, body = golden["image"], golden["T_normal_F"]
    made = network("netF")
    convolutions = [layer for layer in made.modules() if isinstance(layer, nn.Conv2d)]
    if mistake == "zero padding":
        monkeypatch.setattr(
            nn.ReflectionPad2d, "forward", lambda own, x: nn.functional.pad(x, own.padding)
        )
    elif mistake == "mirrored kernels":
        for layer in convolutions:
            monkeypatch.setattr(layer.weight, "data", layer.weight.flip(3))
    elif mistake == "a missing block":
        monkeypatch.setitem(made.model._modules, "20", nn.Identity())
    elif mistake == "no ReLU":
        monkeypatch.setattr(nn.ReLU, "forward", lambda own, x: x)
    elif mistake == "not normalised":
        monkeypatch.setattr(torch_layers.InstanceNorm, "forward", lambda own, x: x)
    else:
        monkeypatch.setattr(torch_layers, "_EPS", 1e-3)
    moved = off(made, image, body, golden["netF_raw"])
    assert moved > 20 * GOLDEN, mistake


@pytest.mark.nightly
def test_an_imported_part_meets_the_golden_vectors(
    network, fill, save_checkpoint, tmp_path, golden
):
    """The whole way: a checkpoint of the true size, two files, onnxruntime."""
    filled_before = network("netF").state_dict()
    numbers = {f"netG.netF.{key}": tensor.numpy() for key, tensor in filled_before.items()}
    numbers |= fill(shapes("netB"), "wave")
    others = {"netG.netD.0.weight": np.ones((3, 3), np.float32), "loss.weight": np.ones(2)}
    path = save_checkpoint(tmp_path / "normal.ckpt", {**numbers, **others}, "state_dict", epoch=3)
    del numbers
    folder = tmp_path / "out"
    folder.mkdir()
    convert.examine(path, ImportOptions()).write(folder)
    assert {file.name for file in folder.iterdir()} == set(FILES.values())
    for name, file in FILES.items():
        feeds = {"image": golden["image"][None], "body": golden[SIDES[name]][None]}
        (found,) = answers(open_session(folder / file), name, feeds)
        assert np.abs(found[0] - golden[f"{name}_raw"]).max() < GOLDEN


@pytest.mark.nightly
def test_a_small_checkpoint_becomes_files_that_answer_alike(fill, save_checkpoint, tmp_path):
    numbers = {**fill(shapes("netF", SMALL)), **fill(shapes("netB", SMALL))}
    path = save_checkpoint(tmp_path / "normal.ckpt", numbers, "state_dict")
    bare_path = save_checkpoint(tmp_path / "bare.ckpt", numbers)
    random = np.random.default_rng(0)
    feeds = {key: random.random((1, 3, 48, 64), np.float32) for key in ("image", "body")}
    for source in (path, bare_path):
        convert.examine(source, ImportOptions(), width=SMALL).write(tmp_path)
        for name, file in FILES.items():
            (found,) = answers(open_session(tmp_path / file), name, feeds)
            made = filled(bare(NormalGenerator, width=SMALL), numbers, f"netG.{name}.")
            with torch.no_grad():
                wanted = made(*map(torch.from_numpy, feeds.values())).numpy()
            np.testing.assert_allclose(found, wanted, atol=1e-4)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda n: n.pop("netG.netB.model.1.bias"), "netB .*none called netG.netB.model.1.bias"),
        (lambda n: n.update({"netG.netF.model.40.bias": np.ones(3)}), "larger network.*model.40"),
        (
            lambda n: n.update({"netG.netF.model.38.bias": np.ones(4, np.float32)}),
            r"model.38.bias has another shape .expected \(3,\); got \(4,\)",
        ),
        (
            lambda n: n.update({"netG.netF.model.38.bias": np.ones(3, np.int64)}),
            "holds whole numbers",
        ),
        (
            lambda n: n.update({"netG.netF.model.38.bias": np.float32([1, np.nan, 0])}),
            "numbers that are not finite",
        ),
        (lambda n: n.clear(), "none called netG.netF.model.1.weight.*and 53 more"),
    ],
)
def test_a_checkpoint_that_is_not_whole(fill, save_checkpoint, tmp_path, change, message):
    numbers = {**fill(shapes("netF", SMALL)), **fill(shapes("netB", SMALL))}
    change(numbers)
    path = save_checkpoint(tmp_path / "normal.ckpt", numbers, "state_dict")
    with pytest.raises(DataError, match=message):
        convert.examine(path, ImportOptions(), width=SMALL)


def test_the_rule_of_numbers_is_the_one_of_the_vectors(fill):
    (found,) = fill({"a.weight": (2, 3)}).values()
    wanted = [[0.42823684, 0.94268566, -0.5952757], [0.22644962, 0.3415218, 0.62697005]]
    np.testing.assert_allclose(found, wanted, atol=1e-7)

"""LPIPS as an imported part, against a plain re-implementation; the numbers are random ones."""

import numpy as np
import pytest
import torch
from torch import nn

from harness.core.errors import DataError, HarnessError, MissingPart
from harness.geometry.images import save_png
from harness.run.external_meshes import score_views
from methods.parts.kind import ImportOptions
from methods.perceptual import LPIPS, perceptual_distance

VGG = [64, 64, "M", 128, 128, "M", 256, 256, 256, "M", 512, 512, 512, "M", 512, 512, 512]


def features(net):
    """torchvision's ``features``, and after which of its layers the package ``lpips`` looks."""
    if net == "alex":
        layers = [
            nn.Conv2d(3, 64, 11, 4, 2), nn.ReLU(), nn.MaxPool2d(3, 2),
            nn.Conv2d(64, 192, 5, 1, 2), nn.ReLU(), nn.MaxPool2d(3, 2),
            nn.Conv2d(192, 384, 3, 1, 1), nn.ReLU(), nn.Conv2d(384, 256, 3, 1, 1), nn.ReLU(),
            nn.Conv2d(256, 256, 3, 1, 1), nn.ReLU(),
        ]  # fmt: skip
        return nn.Sequential(*layers), [2, 5, 8, 10, 12]
    layers, before = [], 3
    for entry in VGG:
        pool = entry == "M"
        layers += [nn.MaxPool2d(2, 2)] if pool else [nn.Conv2d(before, entry, 3, 1, 1), nn.ReLU()]
        before = before if pool else entry
    return nn.Sequential(*layers), [4, 9, 16, 23, 30]


def state(net):
    """What ``lpips.LPIPS(net=...).state_dict()`` holds."""
    torch.manual_seed(0)
    layers, ends = features(net)
    found = {"scaling_layer.shift": torch.zeros(1, 3, 1, 1)}
    for number, layer in enumerate(layers):
        if isinstance(layer, nn.Conv2d):
            group = 1 + sum(number >= end for end in ends)
            found[f"net.slice{group}.{number}.weight"] = layer.weight.detach()
            found[f"net.slice{group}.{number}.bias"] = layer.bias.detach()
    sizes = {"alex": (64, 192, 384, 256, 256), "vgg": (64, 128, 256, 512, 512)}[net]
    for k, size in enumerate(sizes):
        found[f"lin{k}.model.1.weight"] = torch.rand(1, size, 1, 1)
        found[f"lins.{k}.model.1.weight"] = found[f"lin{k}.model.1.weight"]
    return found, layers, ends


def plain_lpips(numbers, layers, ends, first, second):
    shift, scale = torch.tensor([-0.030, -0.088, -0.188]), torch.tensor([0.458, 0.448, 0.450])
    total, start = 0.0, 0
    values = [
        ((2 * torch.tensor(each).float() - 1 - shift) / scale).permute(2, 0, 1)[None]
        for each in (first, second)
    ]
    with torch.no_grad():
        for k, end in enumerate(ends):
            values = [layers[start:end](each) for each in values]
            a, b = (each / (each.norm(dim=1, keepdim=True) + 1e-10) for each in values)
            weights = numbers[f"lin{k}.model.1.weight"][0, :, 0, 0]
            total += float(torch.einsum("bchw,c->bhw", (a - b) ** 2, weights).mean())
            start = end
    return total


@pytest.fixture
def imported(parts, tmp_path):
    def bring(net):
        numbers, layers, ends = state(net)
        torch.save(numbers, tmp_path / "weights.pth")
        part = LPIPS.add(tmp_path / "weights.pth", ImportOptions())
        return part, numbers, layers, ends

    return bring


@pytest.mark.parametrize("net", ["alex", "vgg"])
def test_it_is_that_of_a_plain_reimplementation(imported, net):
    part, *network = imported(net)
    assert (part.name, part.title) == (net, f"LPIPS 0.1 ({net})")
    first, second = np.random.default_rng(0).random((2, 80, 72, 3))
    found = perceptual_distance(net)
    assert found(first, second) == pytest.approx(plain_lpips(*network, first, second), rel=1e-4)
    assert found(first, first) == 0
    with pytest.raises(DataError, match="no LPIPS"):
        found(first[:40], second[:40])


def test_another_network_is_refused(parts, tmp_path):
    numbers = state("alex")[0]
    numbers["net.slice2.3.weight"] = torch.zeros(192, 64, 3, 3)
    torch.save(numbers, tmp_path / "weights.pth")
    with pytest.raises(DataError, match="another shape"):
        LPIPS.add(tmp_path / "weights.pth", ImportOptions())
    with pytest.raises(MissingPart, match="no part 'lpips'"):
        perceptual_distance("alex")


def test_a_picture_is_scored_with_it_and_without_it(imported, tmp_path):
    paths = tmp_path / "rendered.png", tmp_path / "photo.png"
    picture = np.full((200, 180, 4), 255, dtype=np.uint8)
    picture[..., :3] = np.random.default_rng(0).integers(0, 255, (200, 180, 3))
    save_png(paths[1], picture)
    picture[..., :3] //= 2
    save_png(paths[0], picture)
    without = score_views(*paths, "nvs-actorshq")
    assert "lpips: no part 'lpips'" in str(without)
    assert set(without.numbers["nvs-actorshq"]) == {"psnr", "ssim", "ms_ssim"}
    imported("alex")
    found = score_views(*paths, "nvs-actorshq").numbers["nvs-actorshq"]
    assert found["lpips"] > 0
    with pytest.raises(HarnessError, match="no recipe 'econ'"):
        score_views(*paths, "econ")

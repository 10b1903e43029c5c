"""PIXIE's way from a picture of a body to the numbers of SMPL-X, without crops of head and hands.

Feng et al., "Collaborative Regression of Expressive Bodies using Moderation", 3DV 2021. Names of
layers are those of the tensors in the checkpoint.
"""

import functools
import itertools
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from methods.parts.checkpoint_tensors import Checkpoint, Wanted, read_wanted
from methods.parts.conversion import Graph, bare, filled, require_equal, shapes_of, write_onnx
from methods.parts.converted import NETWORK, OUTPUTS
from methods.parts.kind import ImportOptions
from methods.parts.onnx_networks import answers, open_session
from methods.parts.store import Examined

_WIDTHS = (48, 96, 192, 384)
#: How often each number of resolutions exchanges, from two to four.
_MODULES = (1, 4, 3)
_BLOCKS = 4
_STEM = 64
_FEATURES_BACKBONE, _HEAD_BLOCKS = 2048, 5
_EXPANSION = 4


class _BasicBlock(nn.Module):
    """Two 3 x 3 convolutions and a shortcut."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.conv1, self.bn1 = _convolution(channels, channels), nn.BatchNorm2d(channels)
        self.conv2, self.bn2 = _convolution(channels, channels), nn.BatchNorm2d(channels)

    def forward(self, features: Tensor) -> Tensor:
        inner = functional.relu(self.bn1(self.conv1(features)))
        return functional.relu(self.bn2(self.conv2(inner)) + features)


class _Bottleneck(nn.Module):
    """A 1 x 1, a 3 x 3 and a 1 x 1 convolution, and a shortcut.

    Args:
        before: Channels that come in.
        inner: Channels of the middle convolution; four times as many go out.
        downsample: What the shortcut does; None passes on what comes in.
    """

    def __init__(self, before: int, inner: int, downsample: nn.Module | None) -> None:
        super().__init__()
        after = _EXPANSION * inner
        self.conv1, self.bn1 = nn.Conv2d(before, inner, 1, bias=False), nn.BatchNorm2d(inner)
        self.conv2, self.bn2 = _convolution(inner, inner), nn.BatchNorm2d(inner)
        self.conv3, self.bn3 = nn.Conv2d(inner, after, 1, bias=False), nn.BatchNorm2d(after)
        self.downsample = downsample

    def forward(self, features: Tensor) -> Tensor:
        inner = functional.relu(self.bn1(self.conv1(features)))
        inner = functional.relu(self.bn2(self.conv2(inner)))
        shortcut = features if self.downsample is None else self.downsample(features)
        return functional.relu(self.bn3(self.conv3(inner)) + shortcut)


class _Exchange(nn.Module):
    """Some resolutions, each worked on by itself and then made of all.

    Args:
        count: How many resolutions.
    """

    def __init__(self, count: int) -> None:
        super().__init__()
        widths = _WIDTHS[:count]
        self.branches = nn.ModuleList(
            nn.Sequential(*(_BasicBlock(width) for _ in range(_BLOCKS))) for width in widths
        )
        self.fuse_layers = nn.ModuleList(
            nn.ModuleList(_fusing(source, target) for source in range(count))
            for target in range(count)
        )

    def forward(self, resolutions: list[Tensor]) -> list[Tensor]:
        worked = [branch(each) for branch, each in zip(self.branches, resolutions, strict=True)]
        found: list[Tensor] = []
        for layers in self.fuse_layers:
            assert isinstance(layers, nn.ModuleList)
            brought = [layer(each) for layer, each in zip(layers, worked, strict=True)]
            found.append(functional.relu(torch.stack(brought).sum(0)))
        return found


class HrNet(nn.Module):
    """The whole encoder."""

    def __init__(self) -> None:
        super().__init__()
        self.conv1, self.bn1 = _convolution(3, _STEM, stride=2), nn.BatchNorm2d(_STEM)
        self.conv2, self.bn2 = _convolution(_STEM, _STEM, stride=2), nn.BatchNorm2d(_STEM)
        wide = _EXPANSION * _STEM
        widening = nn.Sequential(nn.Conv2d(_STEM, wide, 1, bias=False), nn.BatchNorm2d(wide))
        self.layer1 = nn.Sequential(
            _Bottleneck(_STEM, _STEM, widening),
            *(_Bottleneck(wide, _STEM, None) for _ in range(_BLOCKS - 1)),
        )
        self.transition1 = nn.ModuleList(
            [_step(wide, _WIDTHS[0]), nn.Sequential(_step(wide, _WIDTHS[1], stride=2))]
        )
        self.transition2 = _one_more(2)
        self.transition3 = _one_more(3)
        for count, modules in enumerate(_MODULES, start=2):
            exchanges = nn.ModuleList(_Exchange(count) for _ in range(modules))
            setattr(self, f"stage{count}", exchanges)
        self.subsample_4 = _subsampling(_WIDTHS)
        self.subsample_3 = _subsampling(_WIDTHS[1:])
        self.subsample_2 = _subsampling(_WIDTHS[2:])
        self.conv_layers = nn.Sequential(
            *(_head_block(4 * _WIDTHS[3] if first else _FEATURES_BACKBONE)
              for first in [True] + [False] * (_HEAD_BLOCKS - 1))
        )  # fmt: skip

    def forward(self, picture: Tensor) -> Tensor:
        """(B, 2048) features of (B, 3, 224, 224), RGB with ImageNet's mean and deviation."""
        features = functional.relu(self.bn1(self.conv1(picture)))
        features = functional.relu(self.bn2(self.conv2(features)))
        features = self.layer1(features)
        found = [layer(features) for layer in self.transition1]
        for count in range(2, len(_WIDTHS) + 1):
            if count > 2:
                added = getattr(self, f"transition{count - 1}")[count - 1]
                found = [*found, added(found[-1])]
            for exchange in getattr(self, f"stage{count}"):
                found = exchange(found)
        coarse = [self.subsample_4(found[0]), self.subsample_3(found[1]),
                  self.subsample_2(found[2]), found[3]]  # fmt: skip
        head: Tensor = self.conv_layers(torch.cat(coarse, dim=1))
        return head.mean(3).mean(2)


def _convolution(before: int, after: int, stride: int = 1, *, bias: bool = False) -> nn.Conv2d:
    return nn.Conv2d(before, after, 3, stride=stride, padding=1, bias=bias)


def _step(before: int, after: int, stride: int = 1) -> nn.Sequential:
    return nn.Sequential(_convolution(before, after, stride), nn.BatchNorm2d(after), nn.ReLU())


def _one_more(count: int) -> nn.ModuleList:
    """What makes the next coarser resolution of the coarsest; the others are passed on."""
    kept = [nn.Identity() for _ in range(count)]
    return nn.ModuleList(
        [*kept, nn.Sequential(_step(_WIDTHS[count - 1], _WIDTHS[count], stride=2))]
    )


def _fusing(source: int, target: int) -> nn.Module:
    """Brings one resolution to the size and the channels of another."""
    before, after = _WIDTHS[source], _WIDTHS[target]
    if source == target:
        return nn.Identity()
    if source > target:
        return nn.Sequential(
            nn.Conv2d(before, after, 1, bias=False),
            nn.BatchNorm2d(after),
            nn.Upsample(scale_factor=float(2 ** (source - target)), mode="nearest"),
        )
    steps = [_step(before, before, stride=2) for _ in range(target - source - 1)]
    last = nn.Sequential(_convolution(before, after, stride=2), nn.BatchNorm2d(after))
    return nn.Sequential(*steps, last)


def _subsampling(widths: tuple[int, ...]) -> nn.Sequential:
    layers: list[nn.Module] = []
    for before, after in itertools.pairwise(widths):
        layers += [_convolution(before, after, 2, bias=True), nn.BatchNorm2d(after), nn.ReLU()]
    return nn.Sequential(*layers)


def _head_block(before: int) -> _Bottleneck:
    shortcut = nn.Conv2d(before, _FEATURES_BACKBONE, 1, bias=False)
    return _Bottleneck(before, _FEATURES_BACKBONE // _EXPANSION, shortcut)


_FEATURES, _HIDDEN = 2048, 1024
_MEAN, _DEVIATION = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)


class _Encoder(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.encoder = HrNet()

    def forward(self, picture: Tensor) -> Tensor:
        features: Tensor = self.encoder(picture)
        return features


class _Linear(nn.Module):
    """Linear layers with ReLU between them."""

    def __init__(self, *sizes: int) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        for before, after in itertools.pairwise(sizes):
            layers += [nn.Linear(before, after), nn.ReLU()]
        self.layers = nn.Sequential(*layers[:-1])

    def forward(self, features: Tensor) -> Tensor:
        found: Tensor = self.layers(features)
        return found


class PixieBody(nn.Module):
    """All layers that a picture of the body goes through."""

    def __init__(self) -> None:
        super().__init__()
        self.Encoder_body = _Encoder()
        self.Extractor_head_share = _Linear(_FEATURES, _FEATURES)
        self.Extractor_left_hand_share = _Linear(_FEATURES, _FEATURES)
        self.Extractor_right_hand_share = _Linear(_FEATURES, _FEATURES)
        self.Regressor_body = _Linear(_FEATURES, _HIDDEN, OUTPUTS["body"])
        self.Regressor_head_share = _Linear(_FEATURES, _HIDDEN, _HIDDEN, OUTPUTS["head"])
        self.Regressor_hand_share = _Linear(_FEATURES, _HIDDEN, _HIDDEN, OUTPUTS["left_hand"])

    def forward(self, picture: Tensor) -> tuple[Tensor, ...]:
        """The numbers of ``OUTPUTS``, each (B, count).

        Args:
            picture: (B, 3, 224, 224) RGB in [0, 1]; it is normalised here and nowhere else.
        """
        mean, deviation = (picture.new_tensor(each)[:, None, None] for each in (_MEAN, _DEVIATION))
        features = self.Encoder_body((picture - mean) / deviation)
        hands = (self.Extractor_left_hand_share, self.Extractor_right_hand_share)
        return (
            self.Regressor_body(features),
            self.Regressor_head_share(self.Extractor_head_share(features)),
            *(self.Regressor_hand_share(extract(features)) for extract in hands),
        )


_BATCH = {0: "batch"}
_GRAPH = Graph(
    inputs=("picture",),
    outputs=tuple(OUTPUTS),
    moving=dict.fromkeys(("picture", *OUTPUTS), _BATCH),
)
_SIDE_PX = 224
#: Counters of the training, and the constants that this network has in itself.
_IGNORED = ("num_batches_tracked", "MEAN", "STD")
#: Share of the largest number by which onnxruntime, which sums in another order, may differ.
_TOLERANCE = 1e-4


def examine(file: Path, options: ImportOptions) -> Examined:  # noqa: ARG001
    """The networks of a body's picture; see ``methods.parts.store.Examine``.

    Those for pictures of head and hands do not matter.
    """
    checkpoint = Checkpoint(file)
    numbers: dict[str, NDArray[np.float32]] = {}
    for section, layers in bare(PixieBody).named_children():
        wanted = Wanted(f"PIXIE's {section}", shapes_of(layers), ignored=_IGNORED)
        found = read_wanted(checkpoint, (section,), wanted)
        numbers |= {f"{section}.{name}": array for name, array in found.items()}
    return Examined("pixie", "PIXIE, body path", functools.partial(_write, numbers))


def _write(numbers: Mapping[str, NDArray[np.float32]], folder: Path) -> None:
    network = filled(bare(PixieBody), numbers)
    pictures = torch.rand(1, 3, _SIDE_PX, _SIDE_PX, generator=torch.Generator().manual_seed(0))
    write_onnx(network, folder / NETWORK, _GRAPH, {"picture": pictures})
    with torch.no_grad():
        wanted = network(pictures)
    found = answers(open_session(folder / NETWORK), "PIXIE", {"picture": pictures.numpy()})
    require_equal("PIXIE", found, wanted, _TOLERANCE)

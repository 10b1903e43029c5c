"""HRNet-W48, PIXIE's encoder of the body: a picture of 224 x 224 pixels to 2048 features.

Four resolutions are kept side by side and exchanged: Sun et al., "Deep High-Resolution
Representation Learning for Human Pose Estimation", CVPR 2019. The head that brings all four to
7 x 7 pixels: Choutas et al., "Monocular Expressive Body Regression through Body-Driven Attention",
ECCV 2020. Names of layers are those of the tensors in the checkpoint.
"""

from __future__ import annotations

import itertools

import torch
from torch import Tensor, nn
from torch.nn import functional

_WIDTHS = (48, 96, 192, 384)
#: How often each number of resolutions exchanges, from two to four.
_MODULES = (1, 4, 3)
_BLOCKS = 4
_STEM = 64
_FEATURES, _HEAD_BLOCKS = 2048, 5
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
            *(_head_block(4 * _WIDTHS[3] if first else _FEATURES)
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
    shortcut = nn.Conv2d(before, _FEATURES, 1, bias=False)
    return _Bottleneck(before, _FEATURES // _EXPANSION, shortcut)

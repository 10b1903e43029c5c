"""The architecture of ECON's normal networks: photo and rendered body to clothed normals.

A convolutional generator as in Wang et al., "High-Resolution Image Synthesis and Semantic
Manipulation with Conditional GANs", CVPR 2018: four halvings, nine residual blocks, four doublings.
ECON (Xiu et al., CVPR 2023) has one for the front, ``netF``, and one for the back, ``netB``. The
positions of the layers in each ``Sequential`` are the names of the tensors in the checkpoint.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from methods.parts.torch_layers import InstanceNorm

_HALVINGS, _BLOCKS = 4, 9
#: The photo's three channels and the body normals' three.
_CHANNELS_IN, _CHANNELS_OUT = 6, 3


class _Block(nn.Module):
    """Two 3 x 3 convolutions and a shortcut."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.conv_block = nn.Sequential(
            nn.ReflectionPad2d(1),
            nn.Conv2d(channels, channels, 3),
            InstanceNorm(),
            nn.ReLU(),
            nn.ReflectionPad2d(1),
            nn.Conv2d(channels, channels, 3),
            InstanceNorm(),
        )

    def forward(self, features: Tensor) -> Tensor:
        return features + self.conv_block(features)


class NormalGenerator(nn.Module):
    """One of the two networks.

    Args:
        width: Channels at full resolution; 64 in ECON.
    """

    def __init__(self, width: int = 64) -> None:
        super().__init__()
        layers: list[nn.Module] = [
            nn.ReflectionPad2d(3),
            *_normalised(nn.Conv2d(_CHANNELS_IN, width, 7)),
        ]
        for level in range(_HALVINGS):
            before = width * 2**level
            layers += _normalised(nn.Conv2d(before, 2 * before, 3, stride=2, padding=1))
        layers += [_Block(width * 2**_HALVINGS) for _ in range(_BLOCKS)]
        for level in reversed(range(_HALVINGS)):
            after = width * 2**level
            layers += _normalised(
                nn.ConvTranspose2d(2 * after, after, 3, stride=2, padding=1, output_padding=1)
            )
        layers += [nn.ReflectionPad2d(3), nn.Conv2d(width, _CHANNELS_OUT, 7), nn.Tanh()]
        self.model = nn.Sequential(*layers)

    def forward(self, image: Tensor, body: Tensor) -> Tensor:
        """Normals (B, 3, H, W) in [-1, 1], of any length; H and W are multiples of 16.

        Args:
            image: (B, 3, H, W) sRGB in [-1, 1], 0 outside the subject.
            body: (B, 3, H, W) rendered normals of the body's front or back side.
        """
        normals: Tensor = self.model(torch.cat([image, body], dim=1))
        return normals


def _normalised(layer: nn.Conv2d | nn.ConvTranspose2d) -> list[nn.Module]:
    return [layer, InstanceNorm(), nn.ReLU()]

"""The architecture of ECON's normal networks: photo and rendered body to clothed normals.

A convolutional generator as in Wang et al., "High-Resolution Image Synthesis and Semantic
Manipulation with Conditional GANs", CVPR 2018: four halvings, nine residual blocks, four doublings.
ECON (Xiu et al., CVPR 2023) has one for the front, ``netF``, and one for the back, ``netB``. The
positions of the layers in each ``Sequential`` are the names of the tensors in the checkpoint.
"""

import functools
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from methods.parts.checkpoint_tensors import Checkpoint, Wanted, read_wanted
from methods.parts.conversion import (
    Graph,
    InstanceNorm,
    bare,
    filled,
    require_equal,
    shapes_of,
    write_onnx,
)
from methods.parts.converted import FILES
from methods.parts.kind import ImportOptions
from methods.parts.onnx_networks import answers, open_session
from methods.parts.store import Examined

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


_MOVING = {2: "height", 3: "width"}
GRAPH = Graph(
    inputs=("image", "body"),
    outputs=("normals",),
    moving=dict.fromkeys(("image", "body", "normals"), _MOVING),
)
#: Random numbers instead of trained ones let rounding grow to 0.4 %; a mistake makes 19 % or more.
_TOLERANCE = 0.02


def examine(file: Path, options: ImportOptions, width: int = 64) -> Examined:  # noqa: ARG001
    """Both networks of a checkpoint; see ``methods.parts.store.Examine``.

    Args:
        file: The checkpoint of PyTorch Lightning; its other networks and losses do not matter.
        options: Not one of them matters.
        width: Channels at full resolution; 64 in ECON.
    """
    checkpoint = Checkpoint(file)
    # Every number is read here and again when it is written: all together take 1.5 GB.
    for _ in _networks(checkpoint, width):
        pass
    write = functools.partial(_write, checkpoint, width)
    return Examined("econ-normal", "ECON netF and netB", write)


def _networks(
    checkpoint: Checkpoint, width: int
) -> Iterator[tuple[str, dict[str, NDArray[np.float32]]]]:
    """The numbers of each network, one network at a time."""
    place = ("state_dict",) if checkpoint.has("state_dict") else ()
    for name in FILES:
        prefix = f"netG.{name}."
        shapes = shapes_of(bare(NormalGenerator, width=width), prefix)
        wanted = Wanted(f"ECON's network {name}", shapes, prefix)
        yield prefix, read_wanted(checkpoint, place, wanted)


def _write(checkpoint: Checkpoint, width: int, folder: Path) -> None:
    draw = torch.Generator().manual_seed(0)
    trial = {name: torch.rand(1, 3, 64, 80, generator=draw) * 2 - 1 for name in GRAPH.inputs}
    pairs = zip(FILES.values(), _networks(checkpoint, width), strict=True)
    for file, (prefix, numbers) in pairs:
        network = filled(bare(NormalGenerator, width=width), numbers, prefix)
        write_onnx(network, folder / file, GRAPH, trial)
        with torch.no_grad():
            wanted = network(*trial.values())
        feeds = {key: value.numpy() for key, value in trial.items()}
        found = answers(open_session(folder / file), prefix, feeds)
        require_equal(prefix.rstrip("."), found, [wanted], _TOLERANCE)

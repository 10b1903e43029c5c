"""The architecture of IF-Nets+: voxels of both sheets and of the body to occupancy at points.

An implicit network as in Chibane et al., "Implicit Functions in Feature Space for 3D Shape
Reconstruction and Completion", CVPR 2020, with the body as a second input as in ECON (Xiu et al.,
CVPR 2023). It is in two parts: what is computed once for a subject, and what is computed for each
point. Names of layers are those of the tensors in the checkpoint.
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
from methods.parts.conversion import (
    Graph,
    bare,
    filled,
    instance_normalised,
    require_equal,
    shapes_of,
    write_onnx,
)
from methods.parts.converted import DECODER, ENCODER
from methods.parts.kind import ImportOptions
from methods.parts.onnx_networks import answers, open_session
from methods.parts.store import Examined

#: Channels of the six lattices of features, fine to coarse.
FEATURES = (32, 32, 64, 128, 128, 128)
_PARTIAL, _BODY = 16, 4
#: One sheet voxel, the features and the point itself.
_AT_POINT = 1 + sum(FEATURES) + 3
_HIDDEN = (512, 256, 256)


class _Attention(nn.Module):
    """A convolution whose answer is weighted by another one."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.conv = _convolution(channels, channels)
        self.attention = _convolution(channels, channels, bias=False)

    def forward(self, features: Tensor) -> Tensor:
        weighted: Tensor = self.conv(features) * torch.sigmoid(self.attention(features))
        return weighted


class IfNet(nn.Module):
    """All layers, as the checkpoint has them."""

    def __init__(self) -> None:
        super().__init__()
        self.conv_in_partial = _convolution(1, _PARTIAL)
        self.conv_in_smpl = _convolution(1, _BODY)
        self.SA = _Attention(_BODY)
        self.conv_0_fusion = _convolution(_PARTIAL + _BODY, FEATURES[0])
        self.conv_0_1_fusion = _convolution(FEATURES[0], FEATURES[0])
        for level, channels in enumerate(FEATURES[1:]):
            setattr(self, f"conv_{level}", _convolution(FEATURES[level], channels))
            setattr(self, f"conv_{level}_1", _convolution(channels, channels))
        sizes = (_AT_POINT, *_HIDDEN)
        for layer, (before, after) in enumerate(itertools.pairwise(sizes)):
            setattr(self, f"fc_{layer}", nn.Conv1d(before, after, 1))
        self.fc_out = nn.Conv1d(_HIDDEN[-1], 1, 1)

    def forward(self, sheets: Tensor, body: Tensor, points: Tensor) -> Tensor:
        """Occupancy (B, N) of points; see ``VoxelEncoder`` and ``PointDecoder``."""
        return PointDecoder(self)(points, sheets, *VoxelEncoder(self)(sheets, body))


class VoxelEncoder(nn.Module):
    """The part that is computed once for a subject.

    Args:
        layers: With numbers.
    """

    def __init__(self, layers: IfNet) -> None:
        super().__init__()
        self.layers = layers

    def forward(self, sheets: Tensor, body: Tensor) -> tuple[Tensor, ...]:
        """Six lattices of features, fine to coarse, the first two of half the voxels' size.

        Args:
            sheets: (B, D, D, D) weights of the sheets' voxels, by (z, y, x).
            body: (B, D, D, D) 1 in the body's voxels, by (z, y, x).
        """
        own = self.layers
        sheet_features = _halved(_normalised(own.conv_in_partial(sheets[:, None])))
        body_features = own.SA(_halved(_normalised(own.conv_in_smpl(body[:, None]))))
        fused = torch.cat([sheet_features, body_features], dim=1)
        fused = functional.relu(own.conv_0_fusion(fused))
        found = [_normalised(own.conv_0_1_fusion(fused))]
        for level in range(len(FEATURES) - 1):
            features = _halved(found[-1]) if level else found[-1]
            features = functional.relu(getattr(own, f"conv_{level}")(features))
            found.append(_normalised(getattr(own, f"conv_{level}_1")(features)))
        return tuple(found)


class PointDecoder(nn.Module):
    """The part that is computed for each point.

    Args:
        layers: With numbers.
    """

    def __init__(self, layers: IfNet) -> None:
        super().__init__()
        self.layers = layers

    def forward(self, points: Tensor, sheets: Tensor, *features: Tensor) -> Tensor:
        """Occupancy (B, N), above 0.5 inside.

        Args:
            points: (B, N, 3) by (x, y, z), from -1 to 1 over the voxels' centres; y points down as
                in the voxels.
            sheets: As in ``VoxelEncoder.forward``.
            features: The six lattices.
        """
        place = points[:, None, None]
        lattices = (sheets[:, None], *features)
        at_points = [
            functional.grid_sample(
                lattice, place, mode="bilinear", padding_mode="border", align_corners=True
            )[:, :, 0, 0]
            for lattice in lattices
        ]
        found = torch.cat([*at_points, points.transpose(1, 2)], dim=1)
        for layer in range(len(_HIDDEN)):
            found = functional.relu(getattr(self.layers, f"fc_{layer}")(found))
        occupancy: Tensor = self.layers.fc_out(found)[:, 0]
        return occupancy


def _convolution(before: int, after: int, *, bias: bool = True) -> nn.Conv3d:
    return nn.Conv3d(before, after, 3, padding=1, padding_mode="replicate", bias=bias)


def _normalised(features: Tensor) -> Tensor:
    return instance_normalised(functional.relu(features))


def _halved(features: Tensor) -> Tensor:
    return functional.max_pool3d(features, 2)


#: What the tensors' names begin with in the checkpoint.
PREFIX = "netG."
#: What the authors' training code also keeps there in some versions.
_IGNORED = ("netG.reconEngine.", "netG.normal_filter.", "netG.voxelization.")
_LATTICES = tuple(f"features_{level}" for level in range(len(FEATURES)))
_SIDES = {1: "depth", 2: "height", 3: "width"}
_ENCODER = Graph(
    inputs=("sheets", "body"),
    outputs=_LATTICES,
    moving={"sheets": _SIDES, "body": _SIDES},
)
_DECODER = Graph(
    inputs=("points", "sheets", *_LATTICES),
    outputs=("occupancy",),
    moving={
        "points": {1: "count"},
        "sheets": _SIDES,
        **{
            name: {axis + 1: f"{side}_{name}" for axis, side in _SIDES.items()}
            for name in _LATTICES
        },
        "occupancy": {1: "count"},
    },
    # The first version that samples in three dimensions.
    opset=20,
)
_TRIAL_SIDE, _TRIAL_POINTS = 64, 50
#: Share of the largest occupancy by which onnxruntime, which sums in another order, may differ.
_TOLERANCE = 1e-3


def examine(file: Path, options: ImportOptions) -> Examined:  # noqa: ARG001
    """The network of a checkpoint; see ``methods.parts.store.Examine``."""
    checkpoint = Checkpoint(file)
    place = ("state_dict",) if checkpoint.has("state_dict") else ()
    wanted = Wanted("IF-Nets+", shapes_of(bare(IfNet), PREFIX), PREFIX, _IGNORED)
    numbers = read_wanted(checkpoint, place, wanted)
    return Examined("ifnet", "ECON IF-Nets+", functools.partial(_write, numbers))


def _write(numbers: Mapping[str, NDArray[np.float32]], folder: Path) -> None:
    layers = filled(bare(IfNet), numbers, PREFIX)
    assert isinstance(layers, IfNet)
    draw = torch.Generator().manual_seed(0)
    sheets, body = torch.rand(2, 1, *(3 * [_TRIAL_SIDE]), generator=draw)
    points = torch.rand(1, _TRIAL_POINTS, 3, generator=draw) * 2 - 1
    voxels = {"sheets": sheets, "body": body}
    encoder, decoder = VoxelEncoder(layers).eval(), PointDecoder(layers).eval()
    write_onnx(encoder, folder / ENCODER, _ENCODER, voxels)
    with torch.no_grad():
        lattices = encoder(sheets, body)
        wanted = decoder(points, sheets, *lattices)
    at_points = {"points": points, "sheets": sheets}
    asked = {**at_points, **dict(zip(_LATTICES, lattices, strict=True))}
    write_onnx(decoder, folder / DECODER, _DECODER, asked)
    # Both files in turn: in coarse lattices a channel that hardly varies makes rounding grow.
    features = answers(open_session(folder / ENCODER), "IF-Nets+", _arrays(voxels))
    feeds = {**_arrays(at_points), **dict(zip(_LATTICES, features, strict=True))}
    found = answers(open_session(folder / DECODER), "IF-Nets+", feeds)
    require_equal("IF-Nets+", found, [wanted], _TOLERANCE)


def _arrays(tensors: Mapping[str, torch.Tensor]) -> dict[str, NDArray[np.float32]]:
    return {name: tensor.numpy() for name, tensor in tensors.items()}

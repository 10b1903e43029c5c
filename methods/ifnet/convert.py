"""ECON's ``ifnet.ckpt`` becomes two ONNX files."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from methods.ifnet.network import FEATURES, IfNet, PointDecoder, VoxelEncoder
from methods.ifnet.part import DECODER, ENCODER
from methods.parts.checkpoint_tensors import Checkpoint, Wanted, read_wanted
from methods.parts.kind import ImportOptions
from methods.parts.onnx_export import Graph, bare, filled, require_equal, shapes_of, write_onnx
from methods.parts.onnx_session import answers, open_session
from methods.parts.store import Examined

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

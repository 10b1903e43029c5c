"""ECON's ``normal.ckpt`` becomes two ONNX files."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from methods.normals.econ.network import NormalGenerator
from methods.normals.econ.part import FILES
from methods.parts.checkpoint_tensors import Checkpoint, Wanted, read_wanted
from methods.parts.kind import ImportOptions
from methods.parts.onnx_export import Graph, bare, filled, require_equal, shapes_of, write_onnx
from methods.parts.onnx_session import answers, open_session
from methods.parts.store import Examined

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

"""PIXIE's ``pixie_model.tar`` becomes one ONNX file: what a picture of the body goes through."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from methods.body.pixie.network import PixieBody
from methods.body.pixie.part import NETWORK, OUTPUTS
from methods.parts.checkpoint_tensors import Checkpoint, Wanted, read_wanted
from methods.parts.kind import ImportOptions
from methods.parts.onnx_export import Graph, bare, filled, require_equal, shapes_of, write_onnx
from methods.parts.onnx_session import answers, open_session
from methods.parts.store import Examined

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

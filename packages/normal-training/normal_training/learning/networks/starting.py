"""Weights out of an ONNX file that training wrote, so that another training can start from them."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from pathlib import Path

import torch
from torch import Tensor, nn

from harness.core.errors import DataError
from methods.parts.onnx_networks import read_network
from normal_training.learning.networks.network import Block, NormalNetwork

#: How the network of the whole picture is called within the one that is exported, alone and before
#: another one, and how that one is.
_ALONE, _WHOLE, _DETAIL = "network.", "first.whole.network.", "detail."
#: Appended to the name of a tensor that is stored with half the digits; see ``export``.
HALF = "__half"


def started_from(path: Path, *, detail: bool = False) -> dict[str, Tensor]:
    """The state of a ``NormalNetwork`` in a file that ``export_network`` wrote.

    A file of an earlier, shallower network lacks the tensors of blocks, which do nothing at the
    start.

    Args:
        path: The file.
        detail: Whether it is the second network of a ``Detailed`` that is wanted. In a file of one
            network that is where a second one starts, too.

    Raises:
        DataError: not such a file, or of a network of another shape.
        MissingPart: onnx is not installed.
    """
    model = read_network(path)
    # Only now: where onnx is not installed, its reader says so.
    from onnx import numpy_helper

    tensors = {tensor.name.removesuffix(HALF): tensor for tensor in model.graph.initializer}
    within = _ALONE
    if any(name.startswith(_DETAIL) for name in tensors):
        within = _DETAIL if detail else _WHOLE
    found = {
        name.removeprefix(within): torch.from_numpy(numpy_helper.to_array(tensor).copy()).float()
        for name, tensor in tensors.items()
        if name.startswith(within)
    }
    fresh = NormalNetwork()
    wanted = fresh.state_dict()
    shapes = {name: value.shape for name, value in wanted.items()}
    fits = all(shapes.get(name) == value.shape for name, value in found.items())
    if not fits or not (wanted.keys() - found.keys()) <= _in_blocks(fresh):
        raise DataError(
            f"training cannot start from {path}",
            expected="a network that 'harness train normals' made, or one of fewer blocks",
            got=f"{len(found)} tensors of its {len(wanted)}, or other shapes",
            hint="Leave out --from: training then starts from random weights",
        )
    return found


def network_from(path: Path) -> NormalNetwork:
    """The first network in a file; blocks that an earlier one lacks do nothing.

    Raises:
        DataError, MissingPart: as ``started_from``.
    """
    network = NormalNetwork()
    network.load_state_dict({**network.state_dict(), **started_from(path)})
    return network


def both_started_from(path: Path) -> dict[str, Tensor]:
    """The state of a ``Detailed`` in a file of two networks; in one of one, both start as that.

    Raises:
        DataError, MissingPart: as ``started_from``.
    """
    parts = {_WHOLE: started_from(path), _DETAIL: started_from(path, detail=True)}
    return {within + name: value for within, part in parts.items() for name, value in part.items()}


def blended(network: nn.Module, start: Mapping[str, Tensor], share: float) -> nn.Module:
    """A network between the one that training started from and the one that it ended with.

    Weights of one descent may be averaged: between two ends the error is often lower than at
    either. Source: Wortsman et al., Robust fine-tuning of zero-shot models, 2022.

    Args:
        network: Where training ended; it is not changed.
        start: The state that it started from. What it lacks, blocks that it did not have, is
            taken as trained.
        share: How much of the start is in the answer, 0 to 1.
    """
    found = copy.deepcopy(network)
    found.load_state_dict(
        {
            name: torch.lerp(value, start[name].to(value), share) if name in start else value
            for name, value in network.state_dict().items()
        }
    )
    return found


def _in_blocks(network: NormalNetwork) -> set[str]:
    """The tensors without which a network answers as it would with their first values."""
    return {
        f"{place}.{name}"
        for place, module in network.named_modules()
        if isinstance(module, Block)
        for name in module.state_dict()
    }

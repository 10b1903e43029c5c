"""Bring a checkpoint into ONNX."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from harness.core.errors import MethodError


@dataclass(frozen=True, slots=True)
class Graph:
    """How a network is called.

    Attributes:
        inputs: Names, in the order of its arguments.
        outputs: Names, in the order of its results.
        moving: Names of the dimensions that differ from call to call, by input or output and by
            position.
        opset: Version of ONNX' operators.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    moving: Mapping[str, Mapping[int, str]] = field(default_factory=dict[str, Mapping[int, str]])
    opset: int = 17


def bare(kind: type[nn.Module], **arguments: int) -> nn.Module:
    """A network without numbers, which takes no memory."""
    with torch.device("meta"):
        return kind(**arguments).eval()


def shapes_of(network: nn.Module, prefix: str = "") -> dict[str, tuple[int, ...]]:
    """The shape of each tensor of a network's state, by name with a prefix.

    The counters of batch normalisation are left out: they play no part once it is trained.
    """
    return {
        f"{prefix}{name}": tuple(tensor.shape)
        for name, tensor in network.state_dict().items()
        if tensor.is_floating_point()
    }


def filled(
    network: nn.Module, numbers: Mapping[str, NDArray[np.float32]], prefix: str = ""
) -> nn.Module:
    """A bare network with its numbers, which are those of ``shapes_of``."""
    state = {
        name: torch.from_numpy(numbers[f"{prefix}{name}"])
        if tensor.is_floating_point()
        else torch.zeros(tensor.shape, dtype=tensor.dtype)
        for name, tensor in network.state_dict().items()
    }
    network.load_state_dict(state, assign=True)
    return network.requires_grad_(requires_grad=False)


def write_onnx(
    network: nn.Module, path: Path, graph: Graph, trial: Mapping[str, torch.Tensor]
) -> None:
    """Write a network as ONNX; follow it by ``require_equal`` on what the file answers.

    Args:
        network: On the CPU, without gradients.
        path: The ``.onnx`` file.
        graph: How it is called.
        trial: A tensor for each input.
    """
    with warnings.catch_warnings():
        # The newer exporter needs another package for the same graph. What this one warns of, sizes
        # that it takes for constant, shows in the answers.
        warnings.simplefilter("ignore")
        torch.onnx.export(
            network,
            tuple(trial[name] for name in graph.inputs),
            str(path),
            dynamo=False,
            input_names=list(graph.inputs),
            output_names=list(graph.outputs),
            dynamic_axes={name: dict(axes) for name, axes in graph.moving.items()},
            opset_version=graph.opset,
        )


def require_equal(
    what: str,
    found: Sequence[NDArray[np.float32]],
    wanted: Sequence[torch.Tensor],
    tolerance: float,
) -> None:
    """Refuse a file that answers otherwise than the network that it was written from.

    Args:
        what: The network, for the message.
        found: Outputs of the file.
        wanted: Outputs of the network.
        tolerance: The greatest difference, as a share of an output's largest value.

    Raises:
        MethodError: one output differs more.
    """
    for got, true in zip(found, wanted, strict=True):
        off = float(np.abs(got - true.numpy()).max() / max(float(true.abs().max()), 1e-30))
        if not off <= tolerance:
            raise MethodError(
                f"the ONNX file of {what} does not answer as the network does",
                expected=f"within {tolerance} of the largest value",
                got=f"{off:.2g}",
            )


_EPS = 1e-5


def instance_normalised(features: Tensor) -> Tensor:
    """(B, C, ...) channels with mean 0 and variance 1 over their own one or more axes.

    The same as ``torch.nn.functional.instance_norm``. Means are taken one axis after the other:
    onnxruntime adds a whole channel up in one float32, which is 500 times less exact on 32^3
    voxels.
    """
    centred = features - _mean(features)
    return centred / torch.sqrt(_mean(centred * centred) + _EPS)


class InstanceNorm(nn.Module):
    """``instance_normalised`` as a layer without numbers of its own."""

    def forward(self, features: Tensor) -> Tensor:
        """See ``instance_normalised``."""
        return instance_normalised(features)


def _mean(features: Tensor) -> Tensor:
    for axis in reversed(range(2, features.ndim)):
        features = features.mean(axis, keepdim=True)
    return features

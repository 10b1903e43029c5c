"""The trained network as an ONNX file that says what it is.

Weights are stored with half the digits: the file is half as large, and what is rounded, one part in
two thousand of each weight, is far below what training leaves undecided.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from harness.core.errors import MethodError
from harness.core.files.atomic import atomic_path
from harness.core.missing import not_installed
from methods.normals.onnx_estimator import MULTIPLE
from normal_training.learning.networks.network import Answer
from normal_training.learning.networks.starting import HALF
from normal_training.learning.networks.transposed import with_plain_convolutions

_INPUTS = {"image": 3, "mask": 1, "body_front": 3, "body_back": 3}
_OUTPUTS = Answer._fields
#: Smaller tensors are left as they are.
_LARGE = 256
#: The greatest difference between PyTorch's and onnxruntime's answers, as a share of the greatest
#: component; of unit normals that is 1.
TOLERANCE = 1e-4
#: Pixels between the values of the noise that both are compared on.
_SMOOTH = 16


def export_network(network: nn.Module, path: Path, about: Mapping[str, str]) -> None:
    """Write a network as ONNX for pictures of any size, after comparing both runtimes' answers.

    Args:
        network: On any device; its large weights are rounded to half precision, as in the file.
        path: The ``.onnx`` file.
        about: Its metadata; see ``methods/normals/onnx_estimator.py``.

    Raises:
        MissingPart: onnx or onnxruntime is not installed.
        MethodError: the file answers otherwise than the network by more than 1e-4 of the greatest
            component.
    """
    try:
        import onnx
    except ImportError as error:
        raise not_installed("onnx", "writing a network") from error
    network = _rounded(network.to("cpu").eval())
    size = (2 * MULTIPLE, 3 * MULTIPLE)
    example = tuple(torch.zeros(1, channels, *size) for channels in _INPUTS.values())
    with atomic_path(path) as temporary:
        with warnings.catch_warnings():
            # The newer exporter needs another package for the same graph.
            warnings.simplefilter("ignore", DeprecationWarning)
            # How far a picture is padded stays a few steps of integers, which cost nothing.
            warnings.filterwarnings("ignore", "Constant folding", UserWarning)
            torch.onnx.export(
                network,
                example,
                str(temporary),
                dynamo=False,
                input_names=list(_INPUTS),
                output_names=list(_OUTPUTS),
                dynamic_axes={name: {2: "height", 3: "width"} for name in (*_INPUTS, *_OUTPUTS)},
                opset_version=17,
            )
        model = onnx.load(temporary)
        with_plain_convolutions(model)
        _halved(model)
        onnx.helper.set_model_props(model, dict(about))
        onnx.save(model, temporary)
        _compare(network, temporary)


def _rounded(network: nn.Module) -> nn.Module:
    with torch.no_grad():
        for parameter in network.parameters():
            if parameter.numel() >= _LARGE:
                parameter.copy_(parameter.half().float())
    return network


def _halved(model: Any) -> None:
    """Store the large weights of a graph as float16, and make them float32 when it is loaded."""
    from onnx import TensorProto, helper, numpy_helper

    casts = []
    for tensor in model.graph.initializer:
        values = numpy_helper.to_array(tensor)
        if values.dtype != np.float32 or values.size < _LARGE:
            continue
        casts.append(
            helper.make_node("Cast", [tensor.name + HALF], [tensor.name], to=TensorProto.FLOAT)
        )
        tensor.CopyFrom(numpy_helper.from_array(values.astype(np.float16), tensor.name + HALF))
    # A node comes after those whose values it takes.
    nodes = [*casts, *model.graph.node]
    del model.graph.node[:]
    model.graph.node.extend(nodes)


def _compare(network: nn.Module, path: Path) -> None:
    import onnxruntime

    draw = torch.Generator().manual_seed(0)
    size = (5 * MULTIPLE, 4 * MULTIPLE)
    # Noise that is as smooth as bodies are: between opposite normals no direction is certain.
    coarse = (1, sum(_INPUTS.values()), *(side // _SMOOTH for side in size))
    noise = torch.nn.functional.interpolate(
        torch.randn(coarse, generator=draw), size=size, mode="bilinear"
    )
    image, mask, *bodies = noise.split(list(_INPUTS.values()), dim=1)
    inside = (mask > -1.0).float()
    units = [torch.nn.functional.normalize(maps) * inside for maps in (image, *bodies)]
    inputs = (units[0], inside, *units[1:])
    with torch.no_grad():
        wanted = network(*inputs)
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    feeds = {name: value.numpy() for name, value in zip(_INPUTS, inputs, strict=True)}
    answers = session.run(list(_OUTPUTS), feeds)
    off = max(
        float((torch.from_numpy(got) - true).abs().max() / true.abs().max().clamp(min=1.0))
        for got, true in zip(answers, wanted, strict=True)
    )
    if not off <= TOLERANCE:
        raise MethodError(
            "the ONNX file does not answer as the network does",
            expected=f"within {TOLERANCE}",
            got=f"{off:.2g}",
        )

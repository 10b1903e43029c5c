"""Transposed convolutions of a graph as plain ones, which onnxruntime does in half the time.

Each of the four pixels that stand where one stood is a plain convolution of what is around it. So
the weights only have to be put in another order, which onnxruntime does when it loads a file: in
the file they stay as they were trained.
"""

from __future__ import annotations

from typing import Any

import numpy as np

_KIND = "ConvTranspose"
#: Every picture is enlarged so many times.
_TIMES = 2


def with_plain_convolutions(model: Any) -> None:
    """Let a model do the same with convolutions in place of transposed ones.

    Those that enlarge a picture twice are replaced: strides of 2, and a kernel of two times an odd
    number whose padding is one less than half of it. Others stay.

    Args:
        model: An ONNX model, changed in place; opset 13 or later, transposed convolutions with
            weights and biases by name.
    """
    from onnx import numpy_helper

    shapes = {tensor.name: tuple(tensor.dims) for tensor in model.graph.initializer}
    plain, constants = [], {}
    for number, node in enumerate(model.graph.node):
        shape = shapes.get(node.input[1]) if node.op_type == _KIND else None
        if shape is None or not _doubles(node, shape):
            plain.append(node)
            continue
        replaced = _Plain(f"{node.name or number}/plain", shape)
        plain.extend(replaced.nodes(node))
        constants.update(replaced.constants)
    del model.graph.node[:]
    model.graph.node.extend(plain)
    model.graph.initializer.extend(
        numpy_helper.from_array(values, name) for name, values in constants.items()
    )


def _doubles(node: Any, shape: tuple[int, ...]) -> bool:
    from onnx import helper

    about = {entry.name: helper.get_attribute_value(entry) for entry in node.attribute}
    side = shape[2] // _TIMES
    return (
        len(node.input) == 3
        and shape[2:] == (_TIMES * side, _TIMES * side)
        and side % 2 == 1
        and about.get("group", 1) == 1
        and list(about.get("strides", [])) == [_TIMES] * 2
        and list(about.get("pads", [0] * 4)) == [side - 1] * 4
        and list(about.get("dilations", [1, 1])) == [1, 1]
        and not any(about.get("output_padding", []))
    )


class _Plain:
    """The nodes that do what one transposed convolution does."""

    def __init__(self, name: str, shape: tuple[int, ...]) -> None:
        self._name = name
        self._inside, self._outside, kernel, _ = shape
        self._side = kernel // _TIMES
        self.constants: dict[str, np.ndarray] = {}

    def nodes(self, node: Any) -> list[Any]:
        """In the order in which they are done."""
        picture, weights, bias = node.input
        weights, ordering = self._in_order(weights)
        bias, repeating = self._repeated(bias)
        convolved = f"{self._name}/convolved"
        return [
            *ordering,
            *repeating,
            _node(
                "Conv",
                [picture, weights, bias],
                convolved,
                kernel_shape=[self._side] * 2,
                pads=[self._side // 2] * 4,
            ),
            # As PyTorch's pixel_shuffle: a channel's four pixels are four channels after another.
            _node("DepthToSpace", [convolved], node.output[0], blocksize=_TIMES, mode="CRD"),
        ]

    def _in_order(self, weights: str) -> tuple[str, list[Any]]:
        """Weights (in, out, 2n, 2n) as (4 out, in, n, n), backwards: the other way of looking."""
        split = (self._inside, self._outside, self._side, _TIMES, self._side, _TIMES)
        whole = (self._outside * _TIMES**2, self._inside, self._side, self._side)
        names = [f"{self._name}/{step}" for step in ("split", "down", "across", "moved", "weights")]
        backwards = self._constant("backwards", np.arange(self._side)[::-1])
        return names[-1], [
            _node("Reshape", [weights, self._constant("as_split", split)], names[0]),
            _node("Gather", [names[0], backwards], names[1], axis=2),
            _node("Gather", [names[1], backwards], names[2], axis=4),
            _node("Transpose", [names[2]], names[3], perm=[1, 3, 5, 0, 2, 4]),
            _node("Reshape", [names[3], self._constant("as_whole", whole)], names[4]),
        ]

    def _repeated(self, bias: str) -> tuple[str, list[Any]]:
        name = f"{self._name}/bias"
        each = np.repeat(np.arange(self._outside), _TIMES**2)
        return name, [_node("Gather", [bias, self._constant("each", each)], name, axis=0)]

    def _constant(self, step: str, values: Any) -> str:
        name = f"{self._name}/{step}"
        self.constants[name] = np.array(values, dtype=np.int64)
        return name


def _node(kind: str, inputs: list[str], output: str, **about: Any) -> Any:
    from onnx import helper

    return helper.make_node(kind, inputs, [output], output, **about)

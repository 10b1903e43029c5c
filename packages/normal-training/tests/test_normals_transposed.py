"""Transposed convolutions of a graph, and the plain ones that take their place."""

from __future__ import annotations

import numpy as np
import pytest

onnx = pytest.importorskip("onnx")
ort = pytest.importorskip("onnxruntime")

from normal_training.learning.networks.transposed import with_plain_convolutions  # noqa: E402

INSIDE, OUTSIDE = 5, 3


def model(kernel, padding, **about):
    """One transposed convolution of 5 channels to 3."""
    helper, kind = onnx.helper, onnx.TensorProto.FLOAT
    draw = np.random.default_rng(kernel)
    weights = draw.normal(size=(INSIDE, OUTSIDE, kernel, kernel)).astype(np.float32)
    about = {"strides": [2, 2], "pads": [padding] * 4, **about}
    node = helper.make_node("ConvTranspose", ["x", "w", "b"], ["y"], "enlarge", **about)
    sizes = ["height", "width"]
    graph = helper.make_graph(
        [node],
        "one",
        [helper.make_tensor_value_info("x", kind, [1, INSIDE, *sizes])],
        [helper.make_tensor_value_info("y", kind, [1, OUTSIDE, None, None])],
        [
            onnx.numpy_helper.from_array(weights, "w"),
            onnx.numpy_helper.from_array(draw.normal(size=OUTSIDE).astype(np.float32), "b"),
        ],
    )
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)


def answer(made):
    onnx.checker.check_model(made)
    session = ort.InferenceSession(made.SerializeToString(), providers=["CPUExecutionProvider"])
    picture = np.random.default_rng(0).normal(size=(1, INSIDE, 7, 4)).astype(np.float32)
    return session.run(None, {"x": picture})[0]


def kinds(made):
    return {node.op_type for node in made.graph.node}


@pytest.mark.parametrize(("kernel", "padding"), [(2, 0), (6, 2), (10, 4)])
def test_the_answer_is_the_same(kernel, padding):
    made = model(kernel, padding)
    wanted = answer(made)
    assert wanted.shape == (1, OUTSIDE, 14, 8)
    with_plain_convolutions(made)
    assert "ConvTranspose" not in kinds(made)
    np.testing.assert_allclose(answer(made), wanted, atol=2e-5)


def test_the_weights_stay_as_they_are():
    made = model(6, 2)
    before = {tensor.name: tensor.SerializeToString() for tensor in made.graph.initializer}
    with_plain_convolutions(made)
    after = {tensor.name: tensor.SerializeToString() for tensor in made.graph.initializer}
    assert before.items() <= after.items()
    # What is new are numbers of places, a few bytes each.
    assert all(len(after[name]) < 300 for name in after.keys() - before.keys())


@pytest.mark.parametrize(
    ("kernel", "padding", "about"),
    [
        (4, 1, {}),
        (6, 1, {}),
        (3, 1, {}),
        (6, 2, {"strides": [1, 1]}),
        (6, 2, {"output_padding": [1, 1]}),
        (6, 2, {"dilations": [2, 2]}),
    ],
)
def test_what_does_not_double_a_picture_stays(kernel, padding, about):
    made = model(kernel, padding, **about)
    before = made.SerializeToString()
    with_plain_convolutions(made)
    assert made.SerializeToString() == before

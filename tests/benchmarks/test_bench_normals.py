"""What a view costs the shipped normal network, against a second of the same machine.

The ruler is a stack of plain 3 x 3 convolutions of known work, run by the same onnxruntime: about
what two free cores with AVX-512 do in a second. Both meet whatever else the machine does, in turns.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from harness.core.errors import MissingPart
from methods.normals import NormalChoice

onnx = pytest.importorskip("onnx")
pytest.importorskip("onnxruntime")

SIDE = 512
CHANNELS, LAYERS, RULER_SIDE = 64, 32, 256
#: Multiplications and additions of the ruler, in thousands of millions.
RULER_GFLOP = LAYERS * 2 * 9 * CHANNELS**2 * RULER_SIDE**2 / 1e9


def ruler(path: Path):
    """A function that does the ruler's work once."""
    import onnxruntime

    helper, kind = onnx.helper, onnx.TensorProto.FLOAT
    shape = [1, CHANNELS, RULER_SIDE, RULER_SIDE]
    rng = np.random.default_rng(0)
    # Of a size that keeps what goes through the stack neither growing nor vanishing.
    size = (9 * CHANNELS) ** -0.5
    weights = [
        onnx.numpy_helper.from_array(
            rng.normal(0, size, (CHANNELS, CHANNELS, 3, 3)).astype(np.float32), f"w{layer}"
        )
        for layer in range(LAYERS)
    ]
    nodes = [
        helper.make_node("Conv", [f"x{layer}", f"w{layer}"], [f"x{layer + 1}"], pads=[1, 1, 1, 1])
        for layer in range(LAYERS)
    ]
    ends = [helper.make_tensor_value_info(name, kind, shape) for name in ("x0", f"x{LAYERS}")]
    graph = helper.make_graph(nodes, "ruler", ends[:1], ends[1:], weights)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    path.write_bytes(model.SerializeToString())
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    picture = rng.normal(size=shape).astype(np.float32)
    return lambda: session.run(None, {"x0": picture})


@pytest.fixture(scope="module")
def network():
    try:
        return NormalChoice("open").estimator(None, {})  # type: ignore[arg-type]
    except MissingPart as error:
        pytest.skip(f"the open network is not shipped: {error}")


def view() -> tuple[np.ndarray, ...]:
    """A photo as crops are: the subject fills nine tenths of the height and two thirds across."""
    y, x = np.mgrid[:SIDE, :SIDE] / SIDE - 0.5
    squared = (x / 0.33) ** 2 + (y / 0.45) ** 2
    mask = squared < 1
    near = np.dstack([x / 0.33, -y / 0.45, np.sqrt(np.clip(1 - squared, 0, 1))])
    rgb = np.random.default_rng(0).random((SIDE, SIDE, 3)) * mask[..., None]
    near = near * mask[..., None]
    return rgb, mask.astype(np.float64), near, near * (1, 1, -1)


@pytest.mark.slow
def test_a_view_takes_less_than_a_second_of_two_cores(benchmark, in_turns, network, tmp_path):
    """Measured in turns on two busy cores: 0.57 and 0.52 of the ruler (1.35 s against 2.36 s)."""
    pictures, plain = view(), ruler(tmp_path / "ruler.onnx")
    plain()
    turns = in_turns({"ours": lambda: network(*pictures), "ruler": plain})
    front = benchmark.pedantic(network, args=pictures, rounds=2).front
    benchmark.extra_info["share_of_the_ruler"] = turns.ratio("ours", "ruler")
    benchmark.extra_info["ruler_gflop_per_s"] = RULER_GFLOP / turns.least_s("ruler")
    np.testing.assert_allclose(np.linalg.norm(front, axis=2), pictures[1], atol=1e-6)
    assert turns.ratio("ours", "ruler") < 1, turns.seconds

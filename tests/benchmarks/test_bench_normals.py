"""What a view costs the shipped normal network, against the first one that was shipped.

Two free cores at 2.1 GHz with AVX-512 need 0.35 s for a view with the first network, and a view may
cost 1.5 s there. Both do work of one kind, so that their ratio differs little between machines (a
stack of plain convolutions took from 1.1 to 1.8 times as long as two answers of one network), and
both meet whatever else the machine does, in turns.
"""

from __future__ import annotations

import numpy as np
import pytest

from harness.core.errors import MissingPart
from methods.normals import NormalChoice

pytest.importorskip("onnxruntime")

FIRST = "open-normals"
SIDE = 512
#: 1.4 s on the two cores of above.
MOST = 4.0


def network(choice: NormalChoice):
    """A function that estimates the normals of a view, and the view's mask."""
    try:
        estimator = choice.estimator(None, {})  # type: ignore[arg-type]
    except MissingPart as error:
        pytest.skip(f"the network is not shipped: {error}")
    pictures = view(choice.side_px or SIDE)
    return lambda: estimator(*pictures), pictures[1]


def view(side: int) -> tuple[np.ndarray, ...]:
    """A photo as crops are: the subject fills nine tenths of the height and two thirds across."""
    y, x = np.mgrid[:side, :side] / side - 0.5
    squared = (x / 0.33) ** 2 + (y / 0.45) ** 2
    mask = squared < 1
    near = np.dstack([x / 0.33, -y / 0.45, np.sqrt(np.clip(1 - squared, 0, 1))])
    rgb = np.random.default_rng(0).random((side, side, 3)) * mask[..., None]
    near = near * mask[..., None]
    return rgb, mask.astype(np.float64), near, near * (1, 1, -1)


@pytest.mark.slow
def test_a_view_takes_less_than_a_second_and_a_half_of_two_cores(benchmark, in_turns):
    """With ``open-normals6``, of the same form: 3.0 to 3.1 on busy cores; free, 1 s a view."""
    ours, mask = network(NormalChoice("open"))
    first, _ = network(NormalChoice("onnx", FIRST))
    ours(), first()
    turns = in_turns({"ours": ours, "first": first}, rounds=5)
    front = benchmark.pedantic(ours, rounds=2).front
    benchmark.extra_info["times_the_first"] = turns.ratio("ours", "first")
    np.testing.assert_allclose(np.linalg.norm(front, axis=2), mask, atol=1e-6)
    assert turns.ratio("ours", "first") < MOST, turns.seconds

"""Steps downhill against torch's own, and what is not imported for them."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from methods.body.fit.descent import Adam, Plateau, cosine

torch = pytest.importorskip("torch")


@pytest.mark.parametrize("kind", [torch.float32, torch.float64])
@pytest.mark.parametrize("schedule", ["plateau", "cosine", "none"])
def test_steps_are_torchs_bit_for_bit(kind: object, schedule: str) -> None:
    values = np.random.default_rng(3).normal(size=(7, 3))
    steps, rate = 60, 0.3
    paths: list[list[np.ndarray]] = []
    for ours in (True, False):
        moved = torch.tensor(values, dtype=kind, requires_grad=True)
        still = torch.ones(2, dtype=kind, requires_grad=True)
        if ours:
            optimiser = Adam([moved, still], rate)
            plateau = Plateau(optimiser, 0.5, 2, 1e-3)
        else:
            optimiser = torch.optim.Adam([moved, still], lr=rate, amsgrad=True)
            plateau = torch.optim.lr_scheduler.ReduceLROnPlateau(
                optimiser, factor=0.5, patience=2, min_lr=1e-3
            )
            falling = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps, eta_min=0.01)
        path: list[np.ndarray] = []
        for step in range(steps):
            optimiser.zero_grad()
            cost = (moved.sin() * torch.arange(1, 4)).square().sum() + moved.abs().sum()
            cost.backward()
            optimiser.step()
            if schedule == "plateau":
                plateau.step(float(cost.detach()))
            elif schedule == "cosine" and ours:
                optimiser.rate = cosine(optimiser.rate, step + 1, steps, 0.01)
            elif schedule == "cosine":
                falling.step()
            path.append(moved.detach().numpy().copy())
        paths.append(path)
        assert torch.equal(still, torch.ones(2, dtype=kind))
    assert all(np.array_equal(*pair) for pair in zip(*paths, strict=True))
    assert np.abs(paths[0][-1] - values).max() > 0.1


def test_body_and_its_fit_leave_torchs_compiler_out() -> None:
    pytest.importorskip("anny")
    program = """
import sys, torch
from methods.body.models.anny_body import AnnyBody
from methods.body.models.model import neutral
from methods.body.fit.descent import Adam
body = AnnyBody()
parameters = {n: v.requires_grad_() for n, v in neutral(body).items()}
optimiser = Adam(parameters.values(), 0.1)
body.posed(parameters).vertices.sum().backward()
optimiser.step()
assert "torch._dynamo" not in sys.modules
assert torch._dynamo.disable(len) is not len  # torch's own, when it is asked for
"""
    subprocess.run([sys.executable, "-c", program], check=True, timeout=120)

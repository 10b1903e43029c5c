"""A batch that is divided among threads gives the gradients of the whole."""

from __future__ import annotations

import pytest

torch = pytest.importorskip("torch")

from normal_training.learning.parallel_gradients import Lanes  # noqa: E402


def network():
    torch.manual_seed(0)
    return torch.nn.Sequential(torch.nn.Linear(4, 8), torch.nn.ReLU(), torch.nn.Linear(8, 1))


def test_gradients_are_those_of_the_mean_loss():
    parts = torch.randn(2, 16, 4, generator=torch.Generator().manual_seed(1))
    whole = network()
    wanted = (whole(parts[0]).square().mean() + whole(parts[1]).square().mean()) / 2
    wanted.backward()
    divided = network()
    found = Lanes(divided, 2).descend(lambda part, lane: lane(parts[part]).square().mean())
    assert found == pytest.approx(float(wanted.detach()))
    for mine, yours in zip(divided.parameters(), whole.parameters(), strict=True):
        torch.testing.assert_close(mine.grad, yours.grad)


def test_lanes_see_every_change_of_the_weights():
    divided, plain = network(), network()
    lanes = Lanes(divided, 2)
    steps = [torch.optim.SGD(each.parameters(), lr=0.01) for each in (divided, plain)]
    scene = torch.ones(1, 4)
    for _ in range(5):
        found = lanes.descend(lambda part, lane: (lane(scene) - 3.0).square().mean())
        wanted = (plain(scene) - 3.0).square().mean()
        assert found == pytest.approx(float(wanted.detach()))
        plain.zero_grad()
        wanted.backward()
        for step in steps:
            step.step()


def test_what_fails_in_a_lane_is_heard():
    def fails(part, lane):
        raise ValueError(f"part {part}")

    with pytest.raises(ValueError, match="part 0"):
        Lanes(network(), 2).descend(fails)

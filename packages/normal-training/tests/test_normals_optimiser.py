"""Muon's steps: orthogonal, of the stated size, and downhill."""

import copy

import pytest

torch = pytest.importorskip("torch")

from torch import nn  # noqa: E402

from normal_training.learning.optimiser import Muon, orthogonal  # noqa: E402


@pytest.mark.parametrize("shape", [(24, 60), (60, 24), (32, 32)])
def test_singular_values_become_about_one(shape):
    torch.manual_seed(0)
    matrix = torch.randn(shape) @ torch.diag(torch.logspace(-1, 1, shape[1]))
    found = orthogonal(matrix).float()
    values = torch.linalg.svdvals(found)
    assert values.max() < 1.3
    assert values.median() > 0.6
    # The directions stay: the product with the matrix is symmetric and positive, nearly.
    assert torch.trace(found.T @ matrix) > 0.6 * torch.linalg.svdvals(matrix).sum()


def test_matrices_of_one_shape_are_done_at_once_and_stay_apart():
    torch.manual_seed(0)
    shapes = [(24, 60), (20, 20), (24, 60), (60, 24), (5,), (20, 20), (24, 60)]
    together = [nn.Parameter(torch.randn(shape)) for shape in shapes]
    alone = copy.deepcopy(together)
    for number, (one, other) in enumerate(zip(together, alone, strict=True)):
        if number != 2:
            one.grad = torch.randn_like(one)
            other.grad = one.grad.clone()
    Muon(together, lr=0.1, weight_decay=0.1).step()
    for parameter in alone:
        Muon([parameter], lr=0.1, weight_decay=0.1).step()
    for one, other in zip(together, alone, strict=True):
        torch.testing.assert_close(one, other, atol=0.003, rtol=0)


def test_nothing_stays_nothing():
    assert not orthogonal(torch.zeros(20, 20)).any()


def test_a_step_is_as_large_as_adam_s():
    torch.manual_seed(0)
    layer = nn.Conv2d(32, 64, 3)
    before = layer.weight.detach().clone()
    layer(torch.randn(4, 32, 8, 8)).square().mean().backward()
    Muon(layer.parameters(), lr=0.01, weight_decay=0.0).step()
    change = (layer.weight.detach() - before).square().mean().sqrt()
    # Each entry moves by 0.2 of the rate in the mean square, as AdamW's do.
    assert 0.1 * 0.01 < float(change) < 0.3 * 0.01


def test_decay_shrinks_and_biases_move():
    layer = nn.Linear(20, 20)
    with torch.no_grad():
        layer.weight.fill_(1.0)
        layer.bias.zero_()
    layer.weight.grad, layer.bias.grad = torch.zeros(20, 20), torch.ones(20)
    Muon(layer.parameters(), lr=0.1, weight_decay=0.5).step()
    torch.testing.assert_close(layer.weight.detach(), torch.full((20, 20), 0.95))
    torch.testing.assert_close(layer.bias.detach(), torch.full((20,), -0.1), atol=1e-5, rtol=0)


def test_it_finds_a_least_square():
    torch.manual_seed(0)
    wanted, inputs = torch.randn(24, 24), torch.randn(256, 24)
    layer = nn.Linear(24, 24)
    optimiser = Muon(layer.parameters(), lr=0.15, weight_decay=0.0)
    losses = []
    for _ in range(80):
        loss = (layer(inputs) - inputs @ wanted.T).square().mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        losses.append(float(loss.detach()))
    assert losses[-1] < 0.05 * losses[0]


def test_a_saved_state_goes_on_alike():
    torch.manual_seed(0)
    inputs = torch.randn(8, 20)
    one, two = nn.Linear(20, 20), nn.Linear(20, 20)
    two.load_state_dict(one.state_dict())

    def advance(layer, optimiser):
        optimiser.zero_grad()
        layer(inputs).square().mean().backward()
        optimiser.step()

    first = Muon(one.parameters(), lr=0.02, weight_decay=0.1)
    advance(one, first)
    second = Muon(two.parameters(), lr=0.02, weight_decay=0.1)
    two.load_state_dict(one.state_dict())
    # In a file or a copy: states share their tensors.
    second.load_state_dict(copy.deepcopy(first.state_dict()))
    advance(one, first)
    advance(two, second)
    torch.testing.assert_close(one.weight, two.weight)
    torch.testing.assert_close(one.bias, two.bias)

"""The parts of the loss against closed forms."""

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from normal_training.learning import losses  # noqa: E402
from normal_training.learning.losses import (  # noqa: E402
    AllPixels,
    Pixels,
    chord,
    expected,
    steps,
    total,
)
from normal_training.learning.networks.network import Answer  # noqa: E402
from normal_training.learning.samples import Batch  # noqa: E402
from normal_training.learning.settings import LossWeights  # noqa: E402


def maps(*rows):
    """(1, 3, 1, W) of W normals."""
    return torch.tensor(rows, dtype=torch.float32).T[None, :, None]


def tilted(angle):
    return (float(np.sin(angle)), 0.0, float(np.cos(angle)))


def test_chord_is_twice_the_sine_of_half_the_angle():
    off = torch.tensor([tilted(0.7), tilted(0.0)]) - torch.tensor(tilted(0.0))
    found = chord(off)
    assert float(found[0]) == pytest.approx(2 * np.sin(0.35), abs=1e-4)
    assert float(found[1]) == pytest.approx(1e-3, abs=1e-6)


def test_rows_and_pairs_are_those_inside():
    inside = torch.tensor([[1.0, 1, 0, 1, 1, 1]]).view(1, 1, 1, 6)
    pixels = Pixels.of(inside)
    values = torch.arange(12.0).view(1, 2, 1, 6)
    assert pixels.rows(values).tolist() == [[0, 6], [1, 7], [3, 9], [4, 10], [5, 11]]
    first, second = pixels.pairs(2, 2)
    # Columns 1 and 3, 3 and 5, by their places among those inside.
    assert first.tolist() == [1, 2]
    assert second.tolist() == [2, 4]
    assert pixels.pairs(1, 1)[0].tolist() == []


def test_steps_are_nothing_for_a_map_that_is_off_by_the_same_everywhere():
    pixels = Pixels.of(torch.ones(1, 1, 1, 5))
    assert float(steps(torch.full((5, 3), 0.2), pixels)) == 0.0
    ramp = torch.zeros(5, 3)
    ramp[:, 0] = 0.1 * torch.arange(5.0)
    # Two pixels on, along rows; a map of one row has no columns to compare.
    assert float(steps(ramp, pixels)) == pytest.approx(0.2 / 2)


def test_the_expected_error_is_learned_to_be_the_mean():
    actual = torch.tensor([0.1, 0.3, 0.5])
    values = [float(expected(torch.full((3,), p), actual).mean()) for p in (0.2, 0.3, 0.4)]
    assert values[1] == min(values)
    guess = torch.tensor(0.3, requires_grad=True)
    expected(guess.expand(3), actual).mean().backward()
    assert float(guess.grad) == pytest.approx(0.0, abs=1e-6)


def batch(front, back, inside):
    nothing = torch.zeros(1, 3, 1, inside.shape[3])
    return Batch(nothing, inside, nothing, nothing, front, back, inside, inside)


def test_the_whole_is_the_sum_of_its_parts():
    true = maps(tilted(0.0), tilted(0.0), tilted(0.0))
    inside = torch.tensor([[1.0, 1, 0]]).view(1, 1, 1, 3)
    guess = 3.0 * maps(tilted(0.4), tilted(0.4), tilted(2.0))
    errors = torch.full((1, 1, 1, 3), 0.2)
    answer = Answer(guess, guess, errors, errors)
    weights = LossWeights(back=0.5, steps=0.3, expected=0.1)
    length = 2 * np.sin(0.2)
    side = length + 0.1 * (length / 0.2 + np.log(0.2))
    found = total(answer, batch(true, true, inside), weights)
    assert float(found) == pytest.approx(1.5 * side, abs=1e-3)
    empty = batch(true, true, 0 * inside)
    assert float(total(answer, empty, weights)) == 0.0


def test_the_error_s_estimate_does_not_move_the_normals():
    true, inside = maps(tilted(0.0), tilted(0.0)), torch.ones(1, 1, 1, 2)
    guess = maps(tilted(0.4), tilted(0.1)).requires_grad_()
    for weight in (0.0, 5.0):
        guess.grad = None
        errors = torch.full((1, 1, 1, 2), 0.3)
        answer = Answer(guess, guess, errors, errors)
        total(answer, batch(true, true, inside), LossWeights(expected=weight)).backward()
        if weight == 0.0:
            alone = guess.grad.clone()
    torch.testing.assert_close(guess.grad, alone)


def test_all_pixels_say_what_those_inside_say(monkeypatch):
    torch.manual_seed(0)
    front, back, true = (torch.randn(2, 3, 9, 7) for _ in range(3))
    true = torch.nn.functional.normalize(true, dim=1)
    errors = torch.rand(2, 1, 9, 7) + 0.1
    inside = (torch.rand(2, 1, 9, 7) > 0.4).float()
    found = []
    for kind in (Pixels.of, AllPixels):
        monkeypatch.setattr(losses, "counted_pixels", kind)
        # What is outside says nothing, whatever it is.
        unknown = torch.where(inside > 0, errors, torch.inf)
        guesses = [values.clone().requires_grad_() for values in (front, back, unknown)]
        scene = Batch(true, inside, true, true, true, -true, inside, inside)
        value = total(Answer(*guesses[:2], guesses[2], guesses[2]), scene, LossWeights())
        value.backward()
        found.append([value.detach(), *(guess.grad for guess in guesses)])
    for one, other in zip(*found, strict=True):
        torch.testing.assert_close(one, other, rtol=1e-5, atol=1e-6)
    nothing = AllPixels(0 * inside)
    assert float(nothing.mean(torch.ones(126))) == 0.0

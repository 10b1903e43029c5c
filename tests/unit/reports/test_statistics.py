"""Intervals and tests over subjects against what is known of them."""

from itertools import product

import numpy as np
import pytest

from harness.core.errors import HarnessError
from reports.statistics import (
    bootstrap_ends,
    bootstrap_interval,
    percentile_ends,
    sign_flip_p_value,
)


def test_an_interval_is_about_two_standard_errors_wide():
    values = np.random.default_rng(0).normal(30, 5, size=100).tolist()
    found = bootstrap_interval(values)
    assert found.mean == pytest.approx(np.mean(values))
    assert found.n == 100
    half = 1.96 * np.std(values, ddof=1) / 10
    assert found.low == pytest.approx(found.mean - half, abs=0.1 * half)
    assert found.high == pytest.approx(found.mean + half, abs=0.1 * half)


def test_one_bad_subject_makes_the_interval_lopsided():
    found = bootstrap_interval([20.0] * 10 + [21.0] * 9 + [66.0])
    assert found.high - found.mean > 2 * (found.mean - found.low)


def test_the_interval_covers_the_true_mean_as_often_as_it_says():
    random = np.random.default_rng(1)
    covered = 0
    for _ in range(60):
        found = bootstrap_interval(random.normal(10, 3, size=20).tolist())
        covered += found.low <= 10 <= found.high
    assert covered >= 51


def test_equal_seeds_give_equal_intervals():
    values = np.random.default_rng(0).normal(size=20).tolist()
    assert bootstrap_interval(values) == bootstrap_interval(values)
    assert bootstrap_interval(values, seed=1) != bootstrap_interval(values)


def test_plain_percentiles_are_those_of_the_resampled_means():
    # Two values: a resampled mean is 0, 5 or 10 with chances 1/4, 1/2, 1/4.
    wide = bootstrap_interval([0.0, 10.0], method="percentile")
    narrow = bootstrap_interval([0.0, 10.0], method="percentile", level=0.4)
    assert (wide.low, wide.high) == (0.0, 10.0)
    assert (narrow.low, narrow.high) == (5.0, 5.0)


def test_few_or_equal_values():
    one = bootstrap_interval([3.0])
    assert (one.mean, one.low, one.high, one.n) == (3, None, None, 1)
    equal = bootstrap_interval([0.1, 0.1, 0.1])
    assert (equal.low, equal.high) == (equal.mean, equal.mean) == pytest.approx((0.1, 0.1))


@pytest.mark.parametrize("values", [[], [1.0, float("nan")], [float("inf")]])
def test_values_that_are_not_there_are_refused(values):
    with pytest.raises(HarnessError, match="finite value"):
        bootstrap_interval(values)


def slow_p_value(differences):
    seen = abs(sum(differences)) - 1e-12
    sums = [
        abs(sum(s * d for s, d in zip(signs, differences, strict=True)))
        for signs in product((1, -1), repeat=len(differences))
    ]
    return np.mean([total >= seen for total in sums])


@pytest.mark.parametrize("seed", range(4))
def test_exact_p_values_agree_with_the_slow_twin(seed):
    differences = np.random.default_rng(seed).normal(0.5, 1, size=8).tolist()
    assert sign_flip_p_value(differences) == pytest.approx(slow_p_value(differences))


def test_known_p_values():
    assert sign_flip_p_value([1.0, 2, 3, 4, 5]) == 2 / 32
    assert sign_flip_p_value([1.0, -1]) == 1
    assert sign_flip_p_value([0.0, 0.0]) == 1
    assert sign_flip_p_value([0.1] * 20) == 2 / 2**20


def test_random_flips_agree_with_the_normal_approximation_and_are_never_zero():
    values = np.random.default_rng(0).normal(size=40)
    values += 0.3 - values.mean()
    z = values.mean() / np.sqrt((values**2).mean() / 40)
    expected = np.mean(np.abs(np.random.default_rng(1).normal(size=200_000)) >= z)
    assert sign_flip_p_value(values) == pytest.approx(expected, abs=0.02)
    assert 0 < sign_flip_p_value([1.0] * 40) < 1e-4
    assert sign_flip_p_value(values) == sign_flip_p_value(values)


def test_methods_are_compared_subject_by_subject():
    """Subjects differ far more than methods do: unpaired, nothing could be told."""
    subjects = np.random.default_rng(0).normal(30, 10, size=16)
    better = subjects - 1 + np.random.default_rng(1).normal(0, 0.2, size=16)
    differences = better - subjects
    found = bootstrap_interval(differences.tolist())
    assert found.mean == pytest.approx(-1, abs=0.2)
    assert -1.3 < found.low < found.high < -0.7
    assert sign_flip_p_value(differences) == 2 / 2**16


def test_ends_are_those_of_the_interval_and_need_two_subjects():
    values = [20.0, 21.0, 26.0, 30.0]
    found = bootstrap_interval(values)
    assert bootstrap_ends(values) == (found.low, found.high)
    low, high = percentile_ends(values)
    assert low < np.mean(values) < high
    for ends in (bootstrap_ends, percentile_ends):
        with pytest.raises(HarnessError, match="at least two subjects .*got 1"):
            ends([20.0])

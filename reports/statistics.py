"""What a mean over subjects is worth, and whether one method's mean really differs from another's.

A table's digits suggest more than twenty subjects can tell: one failed subject may carry a mean.
Intervals are over subjects; methods are compared subject by subject.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from harness.core.arrays import Floats
from harness.core.errors import HarnessError
from harness.core.files.hashing import derive_seed

RESAMPLES = 10_000
_QUOTED_RESAMPLES = 200_000
#: Up to so many subjects all sign patterns are tried: 2^20 sums take 10 ms.
_EXACT_UP_TO = 20
_RANDOM_FLIPS = 20_000


@dataclass(frozen=True, slots=True)
class Interval:
    """A mean over subjects with its confidence interval.

    Attributes:
        mean: Arithmetic mean.
        low: Lower end; None for fewer than two subjects, which tell nothing of their spread.
        high: Upper end; None for fewer than two subjects.
        n: How many subjects.
        level: Share of samples of subjects whose interval would hold the true mean.
    """

    mean: float
    low: float | None
    high: float | None
    n: int
    level: float = 0.95


def bootstrap_interval(
    values: Sequence[float],
    *,
    level: float = 0.95,
    seed: int = 0,
    method: Literal["BCa", "percentile"] = "BCa",
    resamples: int = RESAMPLES,
) -> Interval:
    """The mean of a value per subject, with its bootstrap interval over subjects.

    Bias-corrected and accelerated (Efron, 1987), because one bad subject makes means skewed; or the
    plain percentiles of the resampled means, to compare with others who use those.
    Values that are all equal give an interval of no width.

    Raises:
        HarnessError: no values, or one that is not finite.
    """
    from scipy.stats import bootstrap

    data = _checked(values)
    mean, n = float(data.mean()), len(data)
    if n < 2:
        return Interval(mean, None, None, n, level)
    if np.ptp(data) <= 1e-12 * np.abs(data).max():
        return Interval(mean, mean, mean, n, level)
    found = bootstrap(
        (data,),
        np.mean,
        batch=RESAMPLES,
        n_resamples=resamples,
        confidence_level=level,
        method=method,
        rng=np.random.default_rng(derive_seed(seed, "bootstrap")),
    ).confidence_interval
    return Interval(mean, float(found.low), float(found.high), n, level)


def bootstrap_ends(values: Sequence[float]) -> tuple[float, float]:
    """Low and high end of the interval of a mean over subjects, as tables of runs show it.

    Raises:
        HarnessError: fewer than two values, or one that is not finite.
    """
    return _ends(bootstrap_interval(values))


def percentile_ends(values: Sequence[float]) -> tuple[float, float]:
    """The same from plain percentiles, as tables of published results show it.

    Raises:
        HarnessError: fewer than two values, or one that is not finite.
    """
    # So many that the ends do not move in the digits that are usually quoted.
    return _ends(bootstrap_interval(values, method="percentile", resamples=_QUOTED_RESAMPLES))


def _ends(found: Interval) -> tuple[float, float]:
    if found.low is None or found.high is None:
        raise HarnessError("an interval needs at least two subjects", got=f"{found.n}")
    return found.low, found.high


def sign_flip_p_value(differences: Sequence[float] | Floats, *, seed: int = 0) -> float:
    """Two-sided p-value of "the differences are as likely to have the other sign" (Fisher, 1935).

    Exact up to 20 subjects, from 20 000 random sign patterns beyond. Twenty subjects can give
    2e-6 at best, five no less than 0.06.

    Raises:
        HarnessError: no differences, or one that is not finite.
    """
    data = _checked(differences)
    if len(data) <= _EXACT_UP_TO:
        sums = np.zeros(1)
        for difference in data:
            sums = np.concatenate([sums + difference, sums - difference])
        as_given = 0
    else:
        generator = np.random.default_rng(derive_seed(seed, "sign flips"))
        sums = (generator.integers(0, 2, (_RANDOM_FLIPS, len(data))) * 2.0 - 1.0) @ data
        # The pattern that was seen is one of those possible (Phipson & Smyth, 2010).
        as_given = 1
    # Sums that differ by rounding alone are equal.
    extreme = np.abs(sums) >= np.abs(data.sum()) - 1e-9 * np.abs(data).sum()
    return float((extreme.sum() + as_given) / (len(sums) + as_given))


def _checked(values: Sequence[float] | Floats) -> Floats:
    data = np.asarray(values, dtype=np.float64)
    if data.ndim != 1 or len(data) == 0 or not np.isfinite(data).all():
        raise HarnessError(
            "statistics need a finite value for each of at least one subject",
            got=f"{data.tolist()}"[:200],
            hint="A failed subject is reported beside a mean, never put into it",
        )
    return data

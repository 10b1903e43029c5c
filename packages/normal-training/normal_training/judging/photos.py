"""What a network makes of one photo of a generated subject, against the scan's own normals."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from statistics import fmean
from typing import Self

import numpy as np

from harness.core.arrays import Floats, Mask
from harness.core.errors import DataError
from harness.core.protocols import EstimatedNormals, NormalEstimator
from methods.normals.view_maps import filled_normals
from metrics.folds import fold_correlation, fold_strength, pixel_size_m
from metrics.normals import THRESHOLDS_DEG, angular_error_map
from normal_training.sampling.samples import PrintPair

#: The row of the body's own normals, which is what a network has to beat.
BODY = "body"


@dataclass(frozen=True, slots=True)
class NormalsJudgement:
    """How far normals are from the scan's, as means over all pixels of the subject.

    Attributes:
        front_deg, back_deg: Mean angles on the side that the photo shows and on the hidden one.
        front_below_11_25: Share of the pixels in front that are less off, 0 to 1.
        folds_deg, true_folds_deg: Fold strength in front, of the estimate and of the scan.
        fold_correlation: How well both agree in what is finer than 15 mm, -1 to 1.
        printed_front_deg: Mean angle in front where prints lie on the same subject in the same
            light.
        printed_folds_deg: Fold strength of that estimate; prints are no folds.
    """

    front_deg: float
    back_deg: float
    front_below_11_25: float
    folds_deg: float
    true_folds_deg: float
    fold_correlation: float
    printed_front_deg: float
    printed_folds_deg: float

    @classmethod
    def mean(cls, judgements: list[Self]) -> Self:
        """The mean of some, number by number."""
        names = [each.name for each in fields(cls)]
        return cls(**{name: fmean(getattr(j, name) for j in judgements) for name in names})

    @property
    def folds_share(self) -> float:
        """Fold strength of the estimate as a share of the scan's."""
        return self.folds_deg / self.true_folds_deg

    @property
    def prints_gain(self) -> float:
        """By what share prints raise the estimate's fold strength; 0 is right."""
        return self.printed_folds_deg / self.folds_deg - 1.0

    def to_dict(self) -> dict[str, float]:
        """Plain JSON values."""
        return asdict(self)


def judged_pair(pair: PrintPair, estimator: NormalEstimator) -> NormalsJudgement:
    """An estimator on one scene, plain and printed.

    Raises:
        DataError: the subject is too small in the photo.
        MethodError: the estimator cannot work on a picture of this size.
    """
    plain = _estimated(pair, pair.plain, estimator)
    printed = _estimated(pair, pair.printed, estimator)
    # The subject's box is centred at the origin of the world.
    size_m = pixel_size_m(pair.camera, np.zeros(3))
    front, back = (pair.mask & true.any(axis=2) for true in (pair.front, pair.back))
    off = _angles_deg(plain.front, pair.front, front)
    return NormalsJudgement(
        front_deg=float(off.mean()),
        back_deg=float(_angles_deg(plain.back, pair.back, back).mean()),
        front_below_11_25=float((off < THRESHOLDS_DEG[0]).mean()),
        folds_deg=fold_strength(plain.front, front, size_m).mean_deg,
        true_folds_deg=fold_strength(pair.front, front, size_m).mean_deg,
        fold_correlation=fold_correlation(plain.front, pair.front, front, size_m),
        printed_front_deg=float(_angles_deg(printed.front, pair.front, front).mean()),
        printed_folds_deg=fold_strength(printed.front, front, size_m).mean_deg,
    )


def _estimated(pair: PrintPair, rgb: Floats, estimator: NormalEstimator) -> EstimatedNormals:
    """What an estimator makes of one of the photos, at every pixel of the mask."""
    found = estimator(rgb, pair.mask.astype(np.float64), pair.body_front, pair.body_back)
    front, back = (filled_normals(each, pair.mask) for each in (found.front, found.back))
    return EstimatedNormals(front, back)


def _angles_deg(estimate: Floats, truth: Floats, mask: Mask) -> Floats:
    if not mask.any():
        raise DataError("a photo cannot be judged: no pixel shows the subject")
    return angular_error_map(estimate, truth, mask)[mask]

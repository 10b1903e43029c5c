"""The parameters of a generated subject's true body, as they lie beside its scan."""

from __future__ import annotations

import numpy as np

from harness.core.artifacts import Scan
from harness.core.errors import DataError
from methods.body.perturbation import TrueParameters

__all__ = ["true_parameters"]


def true_parameters(scan: Scan) -> TrueParameters:
    """What re-creates the subject's Anny body, in the scan's own frame.

    A body that was moved off the model is told by ``off_model_m``: its joints are re-created, its
    surface only to that distance, as far as any fit of the model can come.

    Raises:
        DataError: no true body beside the scan, or not one of Anny's.
    """
    if scan.body_path is None:
        raise DataError(f"scan of '{scan.subject}' has no true body", expected="a body.npz")
    with np.load(scan.body_path, allow_pickle=False) as file:
        if "pose_parameters" not in file or "phenotype" not in file:
            raise DataError(
                f"{scan.body_path} is no Anny body",
                expected="pose_parameters and phenotype",
                got=", ".join(file.files),
            )
        names = [str(name) for name in file["phenotype_names"]]
        values = [float(value) for value in file["phenotype"]]
        off_m = float(file["off_model_rms_m"]) if "off_model_rms_m" in file else 0.0
        phenotype = dict(zip(names, values, strict=True))
        return TrueParameters(file["pose_parameters"], phenotype, off_m)

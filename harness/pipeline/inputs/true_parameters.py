"""The parameters of a generated subject's true body, as they lie beside its scan."""

from __future__ import annotations

from harness.core.array_files.npz import read_array_npz
from harness.core.artifacts import OFF_MODEL, Scan
from harness.core.errors import DataError
from methods.body.models.perturbation import TrueParameters

__all__ = ["true_parameters"]

_WANTED = ("pose_parameters", "phenotype", "phenotype_names")


def true_parameters(scan: Scan) -> TrueParameters:
    """What re-creates the subject's Anny body, in the scan's own frame.

    ``off_model_m`` says how far a body was moved off the model: its joints are re-created, its
    surface only to that distance, as far as any fit of the model can come.

    Raises:
        DataError: no true body beside the scan, or not one of Anny's.
    """
    if scan.body_path is None:
        raise DataError(f"scan of '{scan.subject}' has no true body", expected="a body.npz")
    file = read_array_npz(scan.body_path, (*_WANTED, OFF_MODEL))
    missing = [name for name in _WANTED if name not in file]
    if missing:
        raise DataError(
            f"{scan.body_path} is no Anny body",
            expected=", ".join(_WANTED),
            got=", ".join(file) or "none of them",
        )
    names = [str(name) for name in file["phenotype_names"]]
    values = [float(value) for value in file["phenotype"]]
    off_m = float(file[OFF_MODEL]) if OFF_MODEL in file else 0.0
    return TrueParameters(file["pose_parameters"], dict(zip(names, values, strict=True)), off_m)

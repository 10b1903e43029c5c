"""The SMPL-X body that a fit of THuman describes, in the units and the frame of its scan.

Source: the authors' answers in the dataset's issues (22, 23): the male model, hands by the first
12 principal components about the model's mean hand, and first the scale, then the translation.
"""

import copy
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats
from harness.core.errors import DataError
from methods.body.models.smplx_file import BETAS, EXPRESSIONS, HAND, JOINTS, load_model
from methods.body.models.smplx_part import SMPLX

#: The imported model that the fits refer to.
MODEL_NAME = "SMPLX_MALE"
_COMPONENTS = 12
_POSES = {"global_orient": 3, "body_pose": 63, "jaw_pose": 3, "leye_pose": 3, "reye_pose": 3}


@dataclass(frozen=True, slots=True, eq=False)
class Placing:
    """How a fit places its body in its scan: the scale first, then the shift.

    Attributes:
        scale: Units of the scan to a metre.
        shift: (3,) units.
    """

    scale: float
    shift: Floats


def male_model() -> tuple[Path, str] | None:
    """The file of the imported male model and its sha256; None where none is imported.

    Raises:
        MissingPart, DataError: it is imported, and its file is gone or another one.
    """
    if MODEL_NAME not in {part.name for part in SMPLX.installed()}:
        return None
    stored = SMPLX.find(MODEL_NAME)
    return stored.file("model.npz"), stored.installed.sha256


def fitted_body(
    fit: Mapping[str, NDArray[Any]], model_file: Path
) -> tuple[Floats, Floats, tuple[str, ...]]:
    """Vertices (10475, 3), joints (55, 3) and the joints' names, in the scan's own units.

    Args:
        fit: What ``smplx_param.pkl`` holds.
        model_file: The male model.

    Raises:
        DataError: a value of the fit is missing or of another size.
        MissingPart: the package ``smplx`` is not installed.
    """
    import torch

    # A joint is a sum over all vertices: in single precision some processors are 0.01 mm off.
    model = copy.deepcopy(load_model(model_file)).double()
    from smplx.joint_names import JOINT_NAMES

    tensors = {
        name: torch.tensor(value[None], dtype=torch.float64)
        for name, value in fit_parameters(fit, model_file).items()
    }
    with torch.no_grad():
        output = model(**tensors, transl=torch.zeros(1, 3, dtype=torch.float64))
    place = placing(fit)
    vertices = output.vertices[0].numpy() * place.scale + place.shift
    joints = output.joints[0, :JOINTS].numpy() * place.scale + place.shift
    return vertices, joints, tuple(JOINT_NAMES[:JOINTS])


def fit_parameters(fit: Mapping[str, NDArray[Any]], model_file: Path) -> dict[str, Floats]:
    """Values (size,) of a fit by the package's names, with hands as 45 numbers and no mean.

    Args:
        fit: What ``smplx_param.pkl`` holds.
        model_file: The male model.

    Raises:
        DataError: a value of the fit is missing or of another size.
    """
    sizes = {**_POSES, "betas": BETAS, "expression": EXPRESSIONS}
    given = {name: _values(fit, name, size) for name, size in sizes.items()}
    with np.load(model_file) as arrays:
        for side in ("left", "right"):
            own = _values(fit, f"{side}_hand_pose", _COMPONENTS)
            components = arrays[f"hands_components{side[0]}"][:_COMPONENTS]
            given[f"{side}_hand_pose"] = own @ components + arrays[f"hands_mean{side[0]}"]
            assert given[f"{side}_hand_pose"].shape == (HAND,)
    return given


def placing(fit: Mapping[str, NDArray[Any]]) -> Placing:
    """Where a fit puts its body; errors as ``fit_parameters``."""
    name = "translation" if "translation" in fit else "transl"
    return Placing(float(_values(fit, "scale", 1)[0]), _values(fit, name, 3))


def _values(fit: Mapping[str, NDArray[Any]], name: str, size: int) -> Floats:
    value = fit.get(name)
    if value is None or value.size != size or not np.isfinite(value).all():
        raise DataError(
            "the SMPL-X fit cannot be read",
            expected=f"{size} finite numbers '{name}'",
            got="none" if value is None else f"shape {value.shape}",
        )
    return value.reshape(size).astype(np.float64)

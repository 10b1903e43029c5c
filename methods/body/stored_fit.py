"""A body fit as arrays, so that methods which fit the same body to the same photos share it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.core.artifacts import Body, BodyLandmarks
from harness.core.typed_json import from_json, to_json
from methods.body.settings import BodyFitResult, FitCost

_PARAMETER, _REGION, _FACTS = "parameter_", "region_", "facts"
#: Arrays of ``Body.to_arrays`` that are named like parameters of the model and are none.
_JOINT_NAMES, _MAIN_JOINTS = "parameter_joint_names", "parameter_main_joints"
_LANDMARKS, _POINTS = "parameter_landmark_index", "parameter_landmark_points"


@dataclass(frozen=True, slots=True)
class _Facts:
    """What of a fit is no array; as in ``BodyFitResult``, with views as text."""

    views_used: tuple[int, ...]
    hands_found: tuple[bool, bool]
    views_left_out: Mapping[str, str]
    depth: str
    swapped: tuple[int, ...] | None
    cost: FitCost | None


def packed(fit: BodyFitResult) -> dict[str, NDArray[Any]]:
    """A fit in arrays by name."""
    facts = _Facts(
        fit.views_used,
        fit.hands_found,
        {str(view): why for view, why in fit.views_left_out.items()},
        fit.depth,
        fit.swapped,
        fit.cost,
    )
    text = json.dumps(to_json(facts)).encode()
    return {
        **fit.body.to_arrays(),
        **{f"{_REGION}{name}": mask for name, mask in fit.regions.items()},
        _FACTS: np.frombuffer(text, dtype=np.uint8),
    }


def unpacked(arrays: Mapping[str, NDArray[Any]]) -> BodyFitResult:
    """The fit behind ``packed``, equal to the bit.

    Raises:
        KeyError, ValueError, DataError: arrays that are not those of a fit.
    """
    facts = from_json(_Facts, json.loads(arrays[_FACTS].tobytes()), "a stored fit", "a body fit")
    return BodyFitResult(
        body=_body(arrays),
        views_used=facts.views_used,
        hands_found=facts.hands_found,
        regions={
            name.removeprefix(_REGION): mask
            for name, mask in arrays.items()
            if name.startswith(_REGION)
        },
        views_left_out={int(view): why for view, why in facts.views_left_out.items()},
        depth=facts.depth,
        swapped=facts.swapped,
        cost=facts.cost,
    )


def _body(arrays: Mapping[str, NDArray[Any]]) -> Body:
    others = (_JOINT_NAMES, _MAIN_JOINTS, _LANDMARKS, _POINTS)
    parameters = {
        name.removeprefix(_PARAMETER): values
        for name, values in arrays.items()
        if name.startswith(_PARAMETER) and name not in others
    }
    landmarks = None
    if _LANDMARKS in arrays:
        landmarks = BodyLandmarks(arrays[_LANDMARKS], arrays[_POINTS])
    body = Body(
        model=str(arrays["model"]),
        vertices=arrays["vertices"],
        joints=arrays["joints"],
        faces=arrays["faces"],
        parameters=parameters,
        landmarks=landmarks,
    )
    if _JOINT_NAMES not in arrays:
        return body
    names = tuple(str(name) for name in arrays[_JOINT_NAMES])
    return replace(body, joint_names=names, main_joints=arrays[_MAIN_JOINTS])

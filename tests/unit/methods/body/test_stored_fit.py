"""A body fit through its stored form: nothing is lost."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from harness.core.artifacts import Body, BodyLandmarks
from harness.core.errors import DataError
from methods.body.fitting import packed, unpacked
from methods.body.settings import BodyFitResult, FitCost


@pytest.fixture
def fit():
    draw = np.random.default_rng(3)
    body = Body(
        model="anny",
        vertices=draw.normal(size=(9, 3)),
        joints=draw.normal(size=(4, 3)),
        faces=draw.integers(0, 9, (5, 3)).astype(np.int32),
        parameters={"pose": draw.normal(size=(4, 3)).astype(np.float32), "age": np.array(0.5)},
        joint_names=("root", "head", "wrist.L", "wrist.R"),
        main_joints=np.array([1, 3]),
        landmarks=BodyLandmarks(np.array([0, 7]), draw.normal(size=(2, 3))),
    )
    return BodyFitResult(
        body=body,
        views_used=(0, 2, 5),
        hands_found=(True, False),
        regions={"left_hand": draw.random(9) < 0.5, "face": draw.random(9) < 0.5},
        views_left_out={1: "its mask is empty"},
        depth="held at the subject's given centre",
        swapped=(2,),
        cost=FitCost((1.0, 1 / 3), {"head": (0.1, 0.2)}, "converged"),
    )


def assert_equal_arrays(first, second):
    assert first.keys() == second.keys()
    for name, values in first.items():
        assert values.dtype == second[name].dtype, name
        assert values.tobytes() == second[name].tobytes(), name


def without_landmarks(fit):
    return replace(fit, body=replace(fit.body, landmarks=None))


@pytest.mark.parametrize(
    "change",
    [
        lambda fit: fit,
        without_landmarks,
        lambda fit: replace(fit, swapped=None, cost=None),
        lambda fit: replace(
            fit, body=replace(fit.body, joint_names=(), main_joints=np.zeros(0, int))
        ),
        lambda fit: replace(fit, body=replace(fit.body, parameters={})),
    ],
)
def test_every_field_comes_back(fit, change):
    before = change(fit)
    after = unpacked(packed(before))
    assert_equal_arrays(packed(before), packed(after))
    for each in fields(BodyFitResult):
        if each.name not in ("body", "regions"):
            assert getattr(after, each.name) == getattr(before, each.name)
    assert_equal_arrays(before.body.to_arrays(), after.body.to_arrays())
    assert_equal_arrays(before.regions, after.regions)
    assert after.details() == before.details()


def test_other_arrays_are_refused(fit):
    arrays = packed(fit)
    with pytest.raises(KeyError):
        unpacked({name: values for name, values in arrays.items() if name != "vertices"})
    broken = np.frombuffer(b'{"views_used": 3}', dtype=np.uint8)
    with pytest.raises(DataError, match="a body fit"):
        unpacked({**arrays, "facts": broken})

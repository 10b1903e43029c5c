"""Who estimates normals, and what each is given."""

from __future__ import annotations

import numpy as np
import pytest

from harness.core.errors import HarnessError, MethodError
from harness.geometry.sides import SidedRaycaster
from methods.normals import NormalChoice, view_maps, working_view
from methods.normals.view_maps import filled_normals


@pytest.fixture
def view(sphere, photograph):
    return working_view(photograph(sphere(0.3)), 0, 64)


def test_the_floor_is_the_body_continued_to_the_outline(view, sphere):
    body = SidedRaycaster(sphere(0.25))
    maps = view_maps(view, body, NormalChoice("body").estimator(view.camera, {}))
    there = np.abs(maps.body_front).sum(2) > 0
    assert 0 < there.sum() < view.mask.sum()
    np.testing.assert_allclose(maps.front[there], maps.body_front[there], atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(maps.front[view.mask], axis=1), 1.0)
    assert (maps.front[~view.mask] == 0).all()
    # Rays spread: at the rim the far side still turns a little towards the viewer.
    assert (maps.back[there][:, 2] < 0.1).all()


def test_the_ceiling_is_asked_for_both_sides_of_its_camera(view, sphere):
    scan, asked = SidedRaycaster(sphere(0.3)), []

    def oracle(camera, side="near"):
        asked.append((camera, side))
        return scan.normals(camera, side)

    estimator = NormalChoice("oracle").estimator(view.camera, {"oracle_normals": oracle})
    maps = view_maps(view, SidedRaycaster(sphere(0.25)), estimator)
    assert asked == [(view.camera, "near"), (view.camera, "far")]
    met = view.mask & (np.abs(scan.normals(view.camera, "near")).sum(2) > 0)
    np.testing.assert_allclose(maps.front[met], scan.normals(view.camera, "near")[met], atol=1e-9)


def test_privileges_and_parts_are_told():
    assert NormalChoice("oracle").privileges == ("oracle_normals",)
    assert NormalChoice("body").privileges == ()
    assert NormalChoice("oracle").part.name == "normals of the scan"


def test_oracle_normals_must_be_lent(view):
    with pytest.raises(MethodError, match="not handed in.*'oracle_normals'"):
        NormalChoice("oracle").estimator(view.camera, {})


@pytest.mark.parametrize(
    ("kind", "model", "message"),
    [
        ("guess", "", "cannot be 'guess'.*body or oracle or onnx"),
        ("onnx", "", "do not go together"),
        ("body", "net.onnx", "do not go together"),
    ],
)
def test_choices_that_make_no_sense(kind, model, message):
    with pytest.raises(HarnessError, match=message):
        NormalChoice(kind, model)


def test_a_body_beside_the_subject_is_refused(view, sphere):
    beside = SidedRaycaster(sphere(0.1, (0.0, 0.6, 0.0)))
    with pytest.raises(MethodError, match="not where view 0 shows the subject"):
        view_maps(view, beside, NormalChoice("body").estimator(view.camera, {}))


def test_an_estimator_without_numbers_is_refused(view, sphere):
    def broken(rgb, mask, body_front, body_back):
        return body_front * np.nan, body_back

    with pytest.raises(MethodError, match="front normals of view 0 cannot be used"):
        view_maps(view, SidedRaycaster(sphere(0.3)), broken)


def test_holes_take_the_nearest_normal():
    normals = np.zeros((1, 5, 3))
    normals[0, 0], normals[0, 4] = (0, 0, 2), (1, 0, 0)
    mask = np.array([[True, True, False, True, True]])
    filled = filled_normals(normals, mask)
    np.testing.assert_array_equal(filled[0, :, 2], [1, 1, 0, 0, 0])
    np.testing.assert_array_equal(filled[0, :, 0], [0, 0, 0, 1, 1])
    with pytest.raises(MethodError, match="no pixel"):
        filled_normals(np.zeros((1, 5, 3)), mask)

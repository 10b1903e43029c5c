"""The body in the gaps of the sheets: where it goes, what is cut, what never comes."""

from __future__ import annotations

import numpy as np
import pytest

from harness.core.errors import DataError, MethodError
from harness.core.mesh import Mesh
from harness.geometry.surface import SurfaceIndex
from methods.surface.completion import (
    BodyCompletion,
    CompletionParameters,
    body_hands,
    registered,
    without_hands,
    without_vertices,
)

BODY_M, CLOTHES_M = 0.30, 0.34


@pytest.fixture(scope="module")
def scene(ball) -> tuple[Mesh, Mesh]:
    """A round body, and clothes 4 cm off it of which only front and back are seen."""
    clothes = ball.vertices * CLOTHES_M
    sheets = without_vertices(Mesh(clothes, ball.faces), np.abs(clothes[:, 2]) < 0.12)
    assert sheets is not None
    return Mesh(ball.vertices * BODY_M, ball.faces, source="body"), sheets


def test_between_the_sheets_the_body_stands_off_like_the_clothes(scene):
    body, sheets = scene
    gap = BodyCompletion()(sheets, body, np.zeros(len(body.vertices), bool))
    assert gap is not None
    radius = np.linalg.norm(gap.vertices, axis=1)
    np.testing.assert_allclose(radius, CLOTHES_M, atol=0.004)
    assert np.abs(gap.vertices[:, 2]).max() < 0.12
    # All around the gap, up to the 2 cm along the surface that the sheets cover.
    angle = np.degrees(np.arctan2(gap.vertices[:, 1], gap.vertices[:, 0]))
    assert (np.histogram(angle, bins=36, range=(-180, 180))[0] > 5).all()
    _, distance = SurfaceIndex(sheets).closest(gap.vertices)
    assert 0.02 <= distance.min() < 0.04
    assert (np.einsum("ij,ij->i", gap.face_normals(), gap.vertices[gap.faces[:, 0]]) > 0).all()


def test_what_is_omitted_never_stands_in(scene):
    body, sheets = scene
    omitted = body.vertices[:, 1] > 0.1
    gap = BodyCompletion()(sheets, body, omitted)
    assert gap is not None
    assert gap.vertices[:, 1].max() < 0.1 * CLOTHES_M / BODY_M + 0.02
    with pytest.raises(MethodError, match="no face left"):
        BodyCompletion()(sheets, body, np.ones(len(body.vertices), bool))


def test_closed_sheets_need_no_completion(scene, ball):
    body, _ = scene
    whole = Mesh(ball.vertices * CLOTHES_M, ball.faces)
    assert BodyCompletion()(whole, body, np.zeros(len(body.vertices), bool)) is None


def test_a_sheet_out_of_reach_or_facing_elsewhere_does_not_pull(scene, ball):
    body, _ = scene
    rules = CompletionParameters(reach_m=0.03)
    far = SurfaceIndex(Mesh(ball.vertices * CLOTHES_M, ball.faces))
    np.testing.assert_allclose(registered(body, far, rules).vertices, body.vertices, atol=1e-6)
    inside_out = SurfaceIndex(Mesh(ball.vertices * 0.31, ball.faces[:, ::-1]))
    moved = registered(body, inside_out, CompletionParameters())
    np.testing.assert_allclose(moved.vertices, body.vertices, atol=1e-6)


def test_parameters_out_of_range_are_refused():
    with pytest.raises(DataError, match="positive reach_m"):
        CompletionParameters(covered_m=0.0)


def test_hands_of_the_body_replace_those_of_the_sheets(scene):
    body, sheets = scene
    hands = body.vertices[:, 0] > 0.2
    stand_in = body_hands(body, hands)
    assert stand_in.vertices[:, 0].min() > 0.2
    (rest,) = without_hands([sheets], body, hands)
    # Clothes are 4 cm off, within reach; along the surface the hand begins at 0.2 of 0.3.
    assert 0.2 < rest.vertices[:, 0].max() < (0.2 + 0.03) * CLOTHES_M / BODY_M
    assert without_hands([sheets], body, np.ones_like(hands)) == []
    (untouched,) = without_hands([sheets], body, hands, reach_m=0.03)
    assert len(untouched.faces) == len(sheets.faces)
    with pytest.raises(MethodError, match="no hands"):
        body_hands(body, np.zeros_like(hands))

"""A mesh in another unit, place or frame is found, and each thing by its own question."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from harness.board.conform_trial import frame_checks
from harness.core.mesh import Mesh
from harness.geometry.coinciding import concatenated
from tests.spheres import icosphere


def ball(middle: tuple[float, float, float], radius: float) -> Mesh:
    sphere = icosphere(radius)
    return replace(sphere, vertices=sphere.vertices + middle)


#: A head, a trunk, a nose ahead and one hand to the left: no turn or mirror leaves it as it is.
_PARTS = concatenated(
    [
        ball((0.0, 0.7, 0.0), 0.15),
        ball((0.0, 0.1, 0.0), 0.35),
        ball((0.0, 0.7, 0.25), 0.06),
        ball((0.55, 0.25, 0.1), 0.12),
        ball((0.0, -0.6, 0.0), 0.1),
    ]
)

#: As scans are: about the middle of their bounding box.
MIDDLE = _PARTS.bounds.mean(axis=0)
SUBJECT = replace(_PARTS, vertices=_PARTS.vertices - MIDDLE)
ABOVE = np.array([0.0, 0.9, 0.0])


def moved(matrix: object, *, flipped: bool = False) -> Mesh:
    faces = SUBJECT.faces[:, ::-1] if flipped else SUBJECT.faces
    return replace(SUBJECT, vertices=SUBJECT.vertices @ np.array(matrix, float).T, faces=faces)


def failed(mesh: Mesh) -> list[str]:
    return [each.id for each in frame_checks(mesh, SUBJECT, is_scan=False) if each.answer == "no"]


def test_the_subject_itself_and_a_thicker_one_stand_right():
    assert failed(SUBJECT) == []
    thicker = concatenated(
        [ball((0.0, 0.7, 0.02), 0.17), ball((0.0, 0.1, 0.0), 0.37), ball((0.55, 0.25, 0.1), 0.14),
         ball((0.0, -0.6, 0.0), 0.12)]
    )  # fmt: skip
    assert failed(replace(thicker, vertices=thicker.vertices - MIDDLE)) == []


@pytest.mark.parametrize(
    ("mesh", "name"),
    [
        (moved(1000 * np.eye(3)), "metres"),
        (moved(39.37 * np.eye(3)), "metres"),
        (replace(SUBJECT, vertices=SUBJECT.vertices + ABOVE), "place"),
        # Blender's world: (x, y, z) there is (x, z, -y) here.
        (moved([[1, 0, 0], [0, 0, -1], [0, 1, 0]]), "up"),
        (moved(np.diag([-1, -1, 1])), "up"),
        (moved(np.diag([-1, 1, -1])), "facing"),
        (moved([[0, 0, 1], [0, 1, 0], [-1, 0, 0]]), "facing"),
        (moved(np.diag([-1, 1, 1]), flipped=True), "handedness"),
        (replace(SUBJECT, faces=SUBJECT.faces[:, ::-1]), "winding"),
        (replace(SUBJECT, faces=SUBJECT.faces[3:]), "watertight"),
    ],
)
def test_each_fault_fails_its_own_question(mesh, name):
    assert failed(mesh) == [name]


def test_the_answer_names_the_unit_and_the_turn():
    said = {
        each.id: each.text for each in frame_checks(moved(1000 * np.eye(3)), SUBJECT, is_scan=False)
    }
    assert said["metres"] == "1e+03 times the size of the scan, as if in millimetres"
    assert said["place"] == "not in metres"
    turned = moved(np.diag([-1, 1, -1]))
    said = {each.id: each.text for each in frame_checks(turned, SUBJECT, is_scan=False)}
    assert said["facing"].startswith("turned by 180 degrees; ")


def test_a_subject_that_looks_alike_from_two_sides_decides_nothing():
    both = concatenated([ball((0.0, 0.7, 0.0), 0.15), ball((0.0, 0.0, 0.0), 0.4)])
    turned = replace(both, vertices=both.vertices * (-1, 1, -1))
    checks = {each.id: each.answer for each in frame_checks(turned, both, is_scan=False)}
    assert checks["facing"] == checks["handedness"] == checks["up"] == "yes"


def test_vertices_in_one_place_are_one():
    split = Mesh(SUBJECT.vertices[SUBJECT.faces].reshape(-1, 3),
                 np.arange(3 * len(SUBJECT.faces)).reshape(-1, 3))  # fmt: skip
    assert failed(split) == []


def test_holes_of_the_scan_are_not_the_methods():
    holed = replace(SUBJECT, faces=SUBJECT.faces[3:])
    checks = {each.id: each.answer for each in frame_checks(holed, SUBJECT, is_scan=True)}
    assert checks["watertight"] == "not asked"

"""Unit and frame mistakes are refused with their cause; bad reconstructions are scored."""

import numpy as np
import pytest

from harness.core.errors import DataError
from harness.geometry.surface import SurfaceIndex
from metrics.distance import sample_surface
from metrics.placement import check_turn
from metrics.score import score


@pytest.mark.parametrize(
    ("factor", "cause"),
    [
        (1000, "millimetres instead of metres: multiply it by 0.001"),
        (100, "centimetres instead of metres: multiply it by 0.01"),
        (39.37, "inches instead of metres"),
        (0.001, "divided by 1000: multiply it by 1000"),
        (2.1, "nothing is rescaled"),
        (0.45, "nothing is rescaled"),
    ],
)
def test_another_unit_is_refused(shapes, mexecon, factor, cause):
    figure = shapes.figure("truth.obj")
    scaled = shapes.moved(shapes.figure("mine.ply"), matrix=np.eye(3) * factor)
    with pytest.raises(DataError, match=r"units\? mine.ply is .* times as large") as caught:
        score(scaled, figure, mexecon)
    assert cause in str(caught.value)
    assert "1.04 x 1.76 x 0.57" in str(caught.value)


def test_feet_at_the_origin_instead_of_the_centre_are_refused(shapes, mexecon):
    figure = shapes.figure()
    with pytest.raises(DataError, match=r"frame\? .* lie 0.88 m apart .* not at its feet"):
        score(shapes.moved(figure, (0, 0.88, 0)), figure, mexecon)


TURNS = {
    "Z up": [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
    "Z up, the other way": [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
    "Y down": [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
    "X up": [[0, -1, 0], [1, 0, 0], [0, 0, 1]],
    "facing X": [[0, 0, 1], [0, 1, 0], [-1, 0, 0]],
    "facing away": [[-1, 0, 0], [0, 1, 0], [0, 0, -1]],
    "mirrored": [[-1, 0, 0], [0, 1, 0], [0, 0, 1]],
}


@pytest.mark.parametrize("turn", TURNS.values(), ids=TURNS)
def test_other_axes_are_refused_and_the_way_back_is_named(shapes, mexecon, turn):
    figure = shapes.figure()
    with pytest.raises(DataError, match=r"frame\? .* fits figure better with other axes") as caught:
        score(shapes.moved(figure, matrix=turn), figure, mexecon)
    back = np.array(turn).T
    names = [("-" if row.sum() < 0 else "") + "xyz"[np.abs(row).argmax()] for row in back]
    assert f"({', '.join(names)}) for (x, y, z)" in str(caught.value)


def test_a_doubtful_turn_is_a_warning(shapes):
    """A block with a long nose on the wrong side, the clearer the less noise there is."""
    block, nose = ([-0.2, -0.8, -0.12], [0.2, 0.8, 0.12]), ([-0.05, 0.2, 0.12], [0.05, 0.4, 0.6])
    truth = SurfaceIndex(shapes.joined(shapes.box(*block), shapes.box(*nose), source="nosy"))
    away = SurfaceIndex(shapes.moved(truth.mesh, matrix=np.diag([1, 1, -1])))
    targets = sample_surface(truth, 10_000, "independent", 0).points
    points = sample_surface(away, 2000, "independent", 1).points
    noise = np.random.default_rng(0).normal(size=points.shape)
    with pytest.raises(DataError, match="nosy better with other axes"):
        check_turn(points + 0.01 * noise, targets, away, truth)
    (warning,) = check_turn(points + 0.05 * noise, targets, away, truth)
    assert "nosy better with other axes: a misfit of 0.06" in warning
    assert check_turn(points + 0.12 * noise, targets, away, truth) == []


def bad_reconstructions(shapes):
    figure = shapes.figure()
    top = figure.vertices[figure.faces][..., 1].mean(axis=1) > 0
    noise = np.random.default_rng(0).normal(scale=0.05, size=figure.vertices.shape)
    return {
        "the upper half": figure.submesh(top),
        "an egg": shapes.moved(shapes.sphere(1, level=3), matrix=np.diag([0.4, 0.9, 0.3])),
        "a block": shapes.box([-0.3, -0.9, -0.2], [0.3, 0.9, 0.2], level=3),
        "torn to pieces": shapes.moved(figure, noise),
        "half a metre aside": shapes.moved(figure, (0.5, 0, 0.3)),
        "leaning by 30 degrees": shapes.moved(figure, matrix=shapes.rotation(0, 30)),
        "facing aside by 40 degrees": shapes.moved(figure, matrix=shapes.rotation(1, 40)),
        "much too thin": shapes.moved(figure, matrix=np.diag([0.6, 1, 0.1])),
        "much too small": shapes.moved(figure, matrix=np.eye(3) * 0.55),
        "inside out": shapes.flipped(figure),
    }


@pytest.mark.parametrize(
    "name",
    [
        "the upper half",
        "an egg",
        "a block",
        "torn to pieces",
        "half a metre aside",
        "leaning by 30 degrees",
        "facing aside by 40 degrees",
        "much too thin",
        "much too small",
        "inside out",
    ],
)
def test_bad_reconstructions_are_scored(shapes, mexecon, name):
    result = score(bad_reconstructions(shapes)[name], shapes.figure(), mexecon)
    assert all(np.isfinite(metric.value) for metric in result.metrics.values())


def test_another_person_in_another_pose_is_scored(shapes, mexecon):
    mirrored_arm = shapes.box([-0.75, 0.5, -0.05], [-0.18, 0.6, 0.05], level=2)
    body = shapes.moved(shapes.sphere(1, level=3), matrix=np.diag([0.25, 0.85, 0.2]))
    result = score(shapes.joined(body, mirrored_arm), shapes.figure(), mexecon)
    assert result.metrics["chamfer"].value > 30

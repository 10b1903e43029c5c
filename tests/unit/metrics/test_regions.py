"""Errors of labelled regions: closed forms, and that nothing is lost between the regions."""

import dataclasses
import json

import numpy as np
import pytest

from harness.core.settings import MetricProtocol
from harness.core.truth import FaceRegions
from harness.core.typed_json import to_json
from metrics.regions import FAR_MM, region_errors
from metrics.score import score

GAP = 0.4
PROTOCOL = MetricProtocol("exact", 1, 20_000, "stratified", "point-to-surface")


@pytest.fixture(scope="module")
def halves(shapes):
    """Two squares of 1 m x 1 m in one plane, ``GAP`` apart: the left one, the right one."""
    shift = (1 + GAP) / 2
    return shapes.moved(shapes.square(), (-shift, 0, 0)), shapes.moved(
        shapes.square(), (shift, 0, 0)
    )


@pytest.fixture(scope="module")
def measured(shapes, halves):
    """Errors by region of a prediction against both squares."""

    def run(predicted, names=("left", "right")):
        truth = shapes.joined(*halves, source="truth")
        labels = np.repeat([0, 1], [len(half.faces) for half in halves])
        outcome = score(predicted, truth, PROTOCOL, keep_points=True)
        points = outcome.predicted_points, outcome.truth_points
        return outcome, region_errors(*points, truth, FaceRegions(names, labels))

    return run


@pytest.mark.parametrize(("offset_mm", "beyond"), [(20.0, 0.0), (60.0, 1.0)])
def test_only_the_half_that_was_moved_has_the_error(shapes, halves, measured, offset_mm, beyond):
    left, right = halves
    moved = shapes.moved(right, (0, 0, offset_mm / 1000))
    _, found = measured(shapes.joined(left, moved))

    assert found["left"].accuracy_mm == pytest.approx(0, abs=1e-3)
    assert found["left"].completeness_mm == pytest.approx(0, abs=1e-3)
    assert found["left"].missing_share == found["left"].bulge_share == 0
    assert found["right"].accuracy_mm == pytest.approx(offset_mm, abs=1e-3)
    assert found["right"].completeness_mm == pytest.approx(offset_mm, abs=1e-3)
    assert found["right"].missing_share == found["right"].bulge_share == beyond
    assert found["right"].normal_error_deg == pytest.approx(0, abs=1e-3)
    assert found["left"].area_share == pytest.approx(0.5)


def test_a_half_that_is_not_there_is_missing_and_no_prediction_tells_of_it(halves, measured):
    """Its points are as far as the gap and their way to its edge: evenly from 0.4 to 1.4 m."""
    _, found = measured(halves[0])

    assert found["right"].completeness_mm == pytest.approx(1000 * (GAP + 0.5), rel=1e-3)
    assert found["right"].missing_share == 1
    assert found["right"].n_predicted == 0
    assert found["right"].accuracy_mm is found["right"].normal_error_deg is None
    assert found["right"].bulge_share is None
    assert found["left"].completeness_mm == pytest.approx(0, abs=1e-3)


def test_a_half_that_turns_away_is_far_beyond_a_known_line(shapes, halves, measured):
    """Turned by a about its middle, a point of the plane x away is |x| sin a off: up to
    sin a / 2 at its edges, whose mean is sin a / 4; normals are off by a.
    """
    angle = 15.0
    sine = np.sin(np.radians(angle))
    right = shapes.moved(halves[1], (-(1 + GAP) / 2, 0, 0))
    turned = shapes.moved(
        shapes.moved(right, matrix=shapes.rotation(1, angle)), ((1 + GAP) / 2, 0, 0)
    )
    _, found = measured(shapes.joined(halves[0], turned))

    assert found["right"].normal_error_deg == pytest.approx(angle, abs=1e-3)
    # From the turned square straight down to the plane: x' = x cos a stays over the true square.
    assert found["right"].accuracy_mm == pytest.approx(1000 * sine / 4, rel=2e-3)
    beyond = 1 - FAR_MM / 1000 / (sine / 2)
    assert found["right"].bulge_share == pytest.approx(beyond, abs=0.01)
    assert found["left"].bulge_share == 0


def test_weighted_by_their_points_the_regions_give_the_whole(shapes, halves, measured):
    bent = shapes.moved(shapes.joined(*halves), (0.05, 0.02, 0.03), shapes.rotation(2, 4))
    outcome, found = measured(bent)

    regions = found.values()
    assert sum(r.area_share for r in regions) == pytest.approx(1)
    assert sum(r.n_truth for r in regions) == PROTOCOL.samples
    assert sum(r.n_predicted for r in regions) == PROTOCOL.samples
    for name, field, count in (
        ("p2s_accuracy", "accuracy_mm", "n_predicted"),
        ("p2s_completeness", "completeness_mm", "n_truth"),
        ("normal_error", "normal_error_deg", "n_predicted"),
    ):
        total = sum(getattr(r, field) * getattr(r, count) for r in regions)
        assert total / PROTOCOL.samples == pytest.approx(outcome.metrics[name].value)


def test_a_region_without_an_area_is_not_there(halves, shapes, measured):
    _, found = measured(shapes.joined(*halves), ("left", "right", "nowhere"))
    assert list(found) == ["left", "right"]


def test_errors_are_plain_json(halves, measured):
    _, found = measured(halves[0])
    document = json.loads(json.dumps(to_json(found["right"]), allow_nan=False))
    assert set(document) == {field.name for field in dataclasses.fields(found["right"])}
    assert document["accuracy_mm"] is None

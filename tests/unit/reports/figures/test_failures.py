"""The failure figure: which region is the worst, which subjects are shown, what is outlined."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from harness.core.artifacts import Capture
from harness.core.errors import DataError, HarnessError
from harness.core.mesh import Mesh
from harness.core.records import RegionErrors
from harness.core.rigs import RingRig
from harness.geometry.images import load_rgb, save_png
from harness.geometry.raycast import Raycaster
from reports.figures.failures import (
    FailedMesh,
    Failure,
    FailurePanel,
    FailureRow,
    _telling_view,
    failure_grid,
    worst_region,
    worst_subjects,
)
from reports.figures.panels import ErrorScale

WIDTH, HEIGHT = 54, 96


def block(low, high):
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    faces = np.array([[q[i], q[j], q[k]] for q in quads for i, j, k in ((0, 1, 2), (0, 2, 3))])
    low, high = np.array(low), np.array(high)
    return Mesh(low + corners * (high - low), faces)


#: A block whose back is labelled apart from the rest.
TRUTH = block((-0.3, -0.8, -0.1), (0.3, 0.8, 0.1))
LABELS = np.where(TRUTH.face_normals()[:, 2] < 0, "back", "rest")


@pytest.fixture
def capture(tmp_path, monkeypatch):
    monkeypatch.setattr("reports.figures.failures._LEAST_HEIGHT", 80)
    cameras = RingRig(views=8).cameras(WIDTH, HEIGHT)
    for view in range(len(cameras)):
        grey = np.full((HEIGHT, WIDTH, 4), 128, dtype=np.uint8)
        save_png(tmp_path / "rgb" / f"{view:02d}.png", grey)
    return Capture("synthetic", "block", "tiny", "key", tmp_path, cameras)


def row(capture, *regions):
    """One method for each region that is the worst; None for one without a mesh."""
    panels = []
    for index, region in enumerate(regions):
        found = None
        if region:
            errors = np.full(len(TRUTH.vertices), 10.0)
            found = FailedMesh(TRUTH, errors, Failure(region, 10.0, f"{region}: 10 mm"))
        panels.append(FailurePanel(f"method {index}", found))
    return FailureRow(capture, TRUTH, LABELS, tuple(panels))


def numbers(accuracy, completeness, missing=0.0, bulge=0.0, area=0.1):
    return RegionErrors(
        area_share=area,
        accuracy_mm=accuracy,
        completeness_mm=completeness,
        normal_error_deg=5.0,
        missing_share=missing,
        bulge_share=bulge,
        n_predicted=10,
        n_truth=10,
    )


def record(subject="a", **regions):
    return SimpleNamespace(subject=subject, regions=regions)


def test_the_worst_region_has_the_largest_error_of_either_direction():
    arms, legs = numbers(5.0, 41.2, missing=0.12), numbers(60.0, 8.0, missing=0.01, bulge=0.3)
    assert worst_region(record(arms=arms)).text == "arms: 41 mm,\n12 % missing"
    assert worst_region(record(arms=arms, legs=legs)).text == "legs: 60 mm,\n30 % bulging"
    assert worst_region(record(arms=numbers(3.0, 2.0, missing=0.001))).text == "arms: 3 mm"


def test_a_region_without_predicted_points_is_judged_by_what_is_missing():
    lost = replace(numbers(None, 300.0, missing=1.0), bulge_share=None)
    assert worst_region(record(hands=lost)) == Failure(
        "hands", 300.0, "hands: 300 mm,\n100 % missing"
    )


def test_a_region_of_a_few_points_is_not_the_worst():
    found = worst_region(record(eyes=numbers(99.0, 99.0, area=0.0004), head=numbers(1.0, 2.0)))
    assert found.region == "head"
    assert worst_region(record()) is None


def test_subjects_stand_in_the_order_of_their_worst_region():
    records = [
        record("good", head=numbers(1.0, 2.0)),
        record("bad", head=numbers(1.0, 2.0), arms=numbers(1.0, 50.0)),
        record("mixed", head=numbers(1.0, 1.0)),
        record("mixed", head=numbers(90.0, 1.0)),
        record("unlabelled"),
    ]
    assert worst_subjects(records, 4) == ("mixed", "bad", "good")
    assert worst_subjects(records, 2) == ("mixed", "bad")


@pytest.mark.parametrize(
    ("direction", "view"), [((0, 0, 1), 0), ((1, 0, 0), 2), ((0, 0, -1), 4), ((-1, 0, 0), 6)]
)
def test_a_row_is_seen_from_where_its_failures_are(capture, direction, view):
    labels = np.where(TRUTH.face_normals() @ direction > 0, "there", "elsewhere")
    shown = replace(row(capture, None, "there"), face_regions=labels)
    assert _telling_view(shown, Raycaster(TRUTH)) == view


def test_failures_that_no_view_shows_are_seen_from_the_front(capture):
    assert _telling_view(row(capture, "nowhere"), Raycaster(TRUTH)) == 0


def red(path):
    picture = load_rgb(path).astype(int)
    return (picture[..., 0] > 200) & (picture[..., 1] < 110) & (picture[..., 2] < 110)


def test_the_worst_region_is_outlined_on_its_method_and_on_the_scan(capture, tmp_path):
    path = tmp_path / "failures.png"
    failure_grid([row(capture, "back", "nowhere", None)], path, ErrorScale(50.0))
    columns = np.flatnonzero(red(path).any(axis=0))
    # Two upright rectangles: each has a left and a right side, and little between.
    runs = np.split(columns, np.flatnonzero(np.diff(columns) > 30) + 1)
    assert len(runs) == 2
    assert max(map(len, runs)) - min(map(len, runs)) <= 3
    first = path.read_bytes()
    failure_grid([row(capture, "back", "nowhere", None)], path, ErrorScale(50.0))
    assert path.read_bytes() == first


def test_rows_with_other_methods_or_errors_are_refused(capture, tmp_path):
    path = tmp_path / "failures.png"
    for rows in ([], [row(capture, "back"), row(capture, "back", "back")]):
        with pytest.raises(HarnessError, match="same methods"):
            failure_grid(rows, path, ErrorScale(50.0))
    wrong = FailedMesh(TRUTH, np.zeros(3), Failure("back", 1.0, "back"))
    with pytest.raises(DataError, match="one per vertex"):
        failure_grid(
            [FailureRow(capture, TRUTH, LABELS, (FailurePanel("m", wrong),))],
            path,
            ErrorScale(50.0),
        )
    assert not path.exists()

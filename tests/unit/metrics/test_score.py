"""What a score holds, and what it refuses."""

import dataclasses
import json

import numpy as np
import pytest

from harness.core.errors import DataError, HarnessError
from harness.core.metric_catalog import METRICS
from harness.core.typed_json import to_json
from metrics.score import score

GEOMETRY = ["chamfer", "p2s_accuracy", "p2s_completeness", "normal_error"]


@pytest.fixture(scope="module")
def pair(shapes):
    return shapes.moved(shapes.figure("mine"), (0.02, 0.01, -0.03)), shapes.figure("truth")


def test_a_score_holds_the_four_metrics_of_geometry_in_their_units(pair, mexecon, exact):
    for protocol in (mexecon, exact):
        result = score(*pair, protocol)
        assert list(result.metrics) == GEOMETRY
        for name, metric in result.metrics.items():
            assert metric.unit == METRICS[name].unit
            assert metric.n == protocol.samples * (2 if name == "chamfer" else 1)
            assert 0 < metric.standard_error < 0.05 * metric.value
    assert result.warnings == ()


def test_the_two_protocols_differ_in_chamfer_and_in_the_weights_of_normals(pair, mexecon, exact):
    published, ours = score(*pair, mexecon), score(*pair, exact)
    right = score(*pair, dataclasses.replace(mexecon, normal_weights="barycentric"))
    mean = (
        published.metrics["p2s_accuracy"].value + published.metrics["p2s_completeness"].value
    ) / 2
    assert published.metrics["chamfer"].value > mean + 1
    assert published.metrics["chamfer"].floor > 3
    assert ours.metrics["chamfer"].floor == 0
    for name in ("p2s_accuracy", "p2s_completeness", "normal_error"):
        first, second = right.metrics[name], ours.metrics[name]
        error = np.hypot(first.standard_error, second.standard_error)
        assert abs(first.value - second.value) < 4 * error
    error = 4 * published.metrics["normal_error"].standard_error
    assert published.metrics["normal_error"].value > ours.metrics["normal_error"].value + error
    assert {**published.metrics, "normal_error": 0} == {**right.metrics, "normal_error": 0}


def test_the_other_direction_has_no_mistake_of_the_published_evaluator(pair, mexecon):
    right = dataclasses.replace(mexecon, normal_weights="barycentric")
    permuted, plain = (
        score(*pair, rules).diagnostics.normals.truth_to_predicted_mean_deg
        for rules in (mexecon, right)
    )
    assert permuted == plain


def test_smooth_normals_end_at_texture_seams_where_the_protocol_says_so(shapes, mexecon):
    """A cube with a texture of its own on each side is as sharp as it looks."""
    cube = shapes.box([0, 0, 0], [1, 1, 1], level=2)
    sides = np.abs(cube.face_normals()).argmax(axis=1) * 2 + (cube.face_normals().sum(axis=1) > 0)
    textured = dataclasses.replace(
        cube,
        uv=np.stack([np.arange(6) / 6, np.zeros(6)], axis=1),
        face_uv=np.repeat(sides[:, None], 3, axis=1),
    )
    rules = dataclasses.replace(mexecon, normal_weights="barycentric", texture_seams="smooth")
    flat = dataclasses.replace(rules, texture_seams="split")
    around = shapes.moved(cube, (1e-4, 1e-4, 1e-4))
    assert score(textured, textured, flat).metrics["normal_error"].value < 1e-3
    assert score(around, textured, rules).metrics["normal_error"].value < 1
    assert score(around, textured, flat).metrics["normal_error"].value > 5
    assert score(around, cube, flat).metrics == score(around, cube, rules).metrics


def test_points_whose_normals_cancel_are_left_out_or_take_the_face(shapes, mexecon):
    """Half of the area is a sheet without thickness, its two sides on the same vertices."""
    square = shapes.square(level=0)
    sheet = dataclasses.replace(square, faces=np.vstack([square.faces, square.faces[:, ::-1]]))
    predicted = shapes.joined(sheet, shapes.moved(shapes.square(2**0.5, 0), (0, 0, 0.5)))
    truth = shapes.moved(shapes.square(2), (0, 0, 0.25))
    left_out = score(predicted, truth, mexecon, keep_points=True)
    kept = score(predicted, truth, dataclasses.replace(mexecon, cancelled_normals="face"))
    assert left_out.metrics["normal_error"].n == pytest.approx(15_000, abs=500)
    assert left_out.metrics["normal_error"].value < 1e-3
    assert np.isnan(left_out.predicted_points.normal_errors_deg).sum() == pytest.approx(15_000, 0.1)
    assert kept.metrics["normal_error"].n == 30_000
    assert kept.metrics["normal_error"].value == pytest.approx(45, abs=1)
    with pytest.raises(DataError, match="no normal error"):
        score(sheet, truth, mexecon)


def test_the_floor_is_what_the_truth_scores(shapes, mexecon):
    """Also where sheets lie close to one another: there it is below that of a single sheet."""
    layers = [shapes.sphere(radius, level=4) for radius in (0.3, 0.301, 0.302)]
    truth = shapes.joined(*layers, source="layers")
    floor = score(layers[0], truth, mexecon).metrics["chamfer"].floor
    assert floor == score(truth, truth, mexecon).metrics["chamfer"].value
    others = [
        score(truth, truth, dataclasses.replace(mexecon, seed=seed)).metrics["chamfer"]
        for seed in range(1, 5)
    ]
    error = others[0].standard_error * np.sqrt(1 + 1 / 4)
    assert abs(floor - np.mean([other.value for other in others])) < 4 * error
    single = 500 * np.sqrt(truth.area / 30_000)
    assert floor < single - 8 * error


def test_a_score_is_plain_json(pair, mexecon):
    result = score(*pair, mexecon)
    document = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    assert document["protocol"]["name"] == "mexecon"
    assert document["protocol"]["sha"] == mexecon.sha
    assert document["metrics"]["chamfer"] == to_json(result.metrics["chamfer"])
    assert document["diagnostics"]["alignment"] == "none"
    assert set(document["diagnostics"]["f_score"]) == {"5_mm", "10_mm", "20_mm", "50_mm"}


def test_errors_are_kept_point_by_point_on_request_only(pair, exact):
    assert score(*pair, exact).predicted_points is None
    result = score(*pair, exact, keep_points=True)
    there, back = result.predicted_points, result.truth_points
    metrics, normals = result.metrics, result.diagnostics.normals
    assert there.points.shape == back.points.shape == (exact.samples, 3)
    assert there.distances_mm.mean() == pytest.approx(metrics["p2s_accuracy"].value)
    assert back.distances_mm.mean() == pytest.approx(metrics["p2s_completeness"].value)
    assert there.normal_errors_deg.mean() == pytest.approx(metrics["normal_error"].value)
    assert back.normal_errors_deg.mean() == pytest.approx(normals.truth_to_predicted_mean_deg)

    for kept, own, other in ((there, *pair), (back, *pair[::-1])):
        assert off_plane_mm(kept.points, own, kept.faces) == pytest.approx(0, abs=1e-3)
        assert (
            off_plane_mm(kept.points, other, kept.closest_faces) <= kept.distances_mm + 1e-3
        ).all()


def off_plane_mm(points, mesh, faces):
    """How far each point is from the plane of its face."""
    normals = mesh.face_normals()[faces]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return 1000 * np.abs(
        np.einsum("ij,ij->i", points - mesh.vertices[mesh.faces[faces, 0]], normals)
    )


def test_all_methods_are_measured_at_the_same_true_points(pair, shapes, exact):
    truth = pair[1]
    first = score(pair[0], truth, exact, keep_points=True).truth_points
    second = score(shapes.box([-0.3, -0.9, -0.2], [0.3, 0.9, 0.2]), truth, exact, keep_points=True)
    np.testing.assert_array_equal(first.points, second.truth_points.points)


def test_equal_inputs_give_equal_scores_and_another_seed_does_not(pair, mexecon):
    first, again = score(*pair, mexecon), score(*pair, mexecon)
    other = score(*pair, dataclasses.replace(mexecon, seed=1))
    assert first.to_dict() == again.to_dict()
    assert first.metrics["chamfer"].value != other.metrics["chamfer"].value


def test_the_prediction_does_not_share_the_random_stream_of_the_truth(pair, mexecon):
    """Else a perfect copy would be sampled at the same points and score a Chamfer of 0."""
    truth = pair[1]
    result = score(truth, truth, mexecon, keep_points=True)
    assert not np.array_equal(result.predicted_points.points, result.truth_points.points)
    assert result.metrics["chamfer"].value > 3


def test_seams_split_no_normals(shapes, exact):
    """A file whose faces share no vertices describes the same smooth surface."""
    truth = shapes.sphere(level=2)
    split = dataclasses.replace(
        truth,
        vertices=truth.vertices[truth.faces.ravel()],
        faces=np.arange(truth.faces.size).reshape(-1, 3),
    )
    assert score(split, truth, exact).metrics["normal_error"].value < 1e-3


def test_faces_without_area_are_counted_and_change_nothing(pair, exact):
    predicted, truth = pair
    extra = np.repeat(predicted.faces[:5, :1], 3, axis=1)
    padded = dataclasses.replace(predicted, faces=np.vstack([predicted.faces, extra]))
    first, second = score(predicted, truth, exact), score(padded, truth, exact)
    assert second.diagnostics.meshes["predicted"].faces_without_area == 5
    for name, metric in first.metrics.items():
        error = 4 * metric.standard_error
        assert second.metrics[name].value == pytest.approx(metric.value, abs=error)


def test_a_protocol_that_contradicts_itself_is_refused(pair, mexecon):
    wrong = dataclasses.replace(mexecon, sampling="stratified")
    with pytest.raises(HarnessError, match="protocol mexecon contradicts itself"):
        score(*pair, wrong)
    with pytest.raises(HarnessError, match="draws no points"):
        score(*pair, dataclasses.replace(mexecon, samples=0))


@pytest.mark.parametrize("defect", ["NaN", "no faces", "no area", "index"])
def test_defective_meshes_never_become_numbers(pair, defect):
    """They cannot even be made, so that no native code ever meets them."""
    truth = pair[1]
    vertices, faces = truth.vertices.copy(), truth.faces.copy()
    if defect == "NaN":
        vertices[3, 1] = np.nan
    elif defect == "no faces":
        faces = faces[:0]
    elif defect == "no area":
        faces = faces[:, [0, 0, 1]]
    else:
        faces[7, 2] = len(vertices)
    with pytest.raises(DataError):
        dataclasses.replace(truth, vertices=vertices, faces=faces)


@pytest.mark.parametrize("role", ["predicted", "truth"])
@pytest.mark.parametrize("turned", [True, False])
def test_faces_that_are_there_twice_are_told_and_turn_no_normal(shapes, exact, role, turned):
    small, large = shapes.sphere(0.5, level=3), shapes.sphere(0.51, level=3)
    wanted = score(small, large, exact)
    assert not wanted.warnings
    mesh = small if role == "predicted" else large
    copy = mesh.faces[:, ::-1] if turned else mesh.faces
    twice = dataclasses.replace(mesh, faces=np.vstack([mesh.faces, copy]))
    found = score(twice, large, exact) if role == "predicted" else score(small, twice, exact)
    (warning,) = found.warnings
    count = len(mesh.faces)
    assert f"{count} of {2 * count} faces of the {role} mesh lie where others do" in warning
    assert f"{count if turned else 0} of them the other way round" in warning
    normal = found.metrics["normal_error"].value
    assert normal == pytest.approx(wanted.metrics["normal_error"].value, abs=0.05)

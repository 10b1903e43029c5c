"""Labels beside a scan become errors by region, and nothing else changes."""

from dataclasses import replace

import numpy as np
import pytest

from harness.core.artifacts import Scan
from harness.core.errors import DataError
from harness.core.mesh import Mesh
from harness.core.settings import MetricProtocol
from harness.core.truth import face_regions
from harness.run.mesh_scores import mesh_scores

PROTOCOL = MetricProtocol("mexecon", 1, 500, "independent", "sample-to-sample")


def wall(shift_m: float = 0.0) -> Mesh:
    """A strip 2 m long of four triangles, the right half of which stands ``shift_m`` forward."""
    vertices = [[x, y, z] for x, z in ((-1, 0), (0, 0), (0, shift_m), (1, shift_m)) for y in (0, 1)]
    faces = [[0, 2, 1], [1, 2, 3], [4, 6, 5], [5, 6, 7]]
    return Mesh(np.array(vertices, float), np.array(faces))


def write_labels(path, labels, names=("head", "arms")):
    np.savez(path, face_labels=np.array(labels, np.int16), names=np.array(names))
    return path


@pytest.fixture
def scan(tmp_path):
    return Scan("toy", "t1", tmp_path / "t1.obj", "metres", "+z", np.eye(4), {})


@pytest.fixture
def labelled(scan, tmp_path):
    return replace(scan, labels_path=write_labels(tmp_path / "labels.npz", [0, 0, 1, 1]))


def scores(scan):
    return mesh_scores(wall(0.02), scan, wall(), PROTOCOL)


def test_a_record_tells_where_the_error_is(labelled):
    regions = scores(labelled).regions
    assert list(regions) == ["head", "arms"]
    assert regions["arms"].accuracy_mm == pytest.approx(20, abs=0.01)
    assert regions["head"].completeness_mm < 1
    assert regions["head"].area_share == pytest.approx(0.5)


def test_labels_change_no_other_number(scan, labelled):
    found, plain = scores(labelled), scores(scan)
    assert found.regions
    assert replace(found, regions={}) == plain


@pytest.mark.parametrize(
    ("labels", "match"),
    [
        ([0, 0, 1], "4 labels, one per face"),
        ([0, 0, 1, 2], "faces of no named region"),
        ([0, 0, -1, 1], "faces of no named region"),
    ],
)
def test_labels_of_another_mesh_are_refused(scan, tmp_path, labels, match):
    wrong = replace(scan, labels_path=write_labels(tmp_path / "labels.npz", labels))
    with pytest.raises(DataError, match=match):
        face_regions(wrong, wall())


@pytest.mark.parametrize("damage", ["cut", "text", "other"])
def test_a_damaged_file_is_named(labelled, damage):
    path = labelled.labels_path
    if damage == "cut":
        path.write_bytes(path.read_bytes()[:100])
    elif damage == "text":
        path.write_text("labels")
    else:
        np.savez(path, vertices=np.zeros(3))
    with pytest.raises(DataError, match="labels.npz holds no labels of faces"):
        face_regions(labelled, wall())

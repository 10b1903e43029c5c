"""Normal maps of a sphere against the sphere: their errors, and their file."""

from dataclasses import replace

import numpy as np
import pytest

from clothed_avatars.skin.bake import _REGIONS
from harness.core.artifacts import NormalMaps, Scan
from harness.core.errors import DataError, MethodError
from harness.core.mesh import Mesh
from harness.core.rigs import RingRig
from harness.core.truth import BODY_REGIONS
from harness.geometry.raycast import Raycaster
from harness.run.normal_scores import normal_map_errors
from harness.run.publication import load_normals, save_normals
from metrics.folds import fold_strength

CAMERAS = RingRig().cameras(90, 160)


def sphere() -> Mesh:
    """Closed, of radius 0.5 m, at the origin; the faces of its upper half come first."""
    polar, around = np.linspace(0, np.pi, 41), np.arange(61) % 60 * (2 * np.pi / 60)
    v, u = np.meshgrid(polar, around, indexing="ij")
    points = np.stack([np.sin(v) * np.sin(u), np.cos(v), np.sin(v) * np.cos(u)], axis=-1).round(12)
    index = np.arange(points[..., 0].size).reshape(v.shape)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)], axis=2)
    return Mesh(0.5 * points.reshape(-1, 3), faces.reshape(-1, 3))


SPHERE = sphere()


def turned(normals, angle_deg):
    """About the axis of sight."""
    angle = np.radians(angle_deg)
    turn = [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    return normals @ np.array(turn).T


def maps(view, body_turn_deg=0.0) -> NormalMaps:
    """True maps of the sphere; the body's are turned."""
    camera = CAMERAS[view].cropped(20, 50, 60, 60)
    caster = Raycaster(SPHERE)
    near, far = (caster.normals(camera, side) for side in ("near", "far"))
    body = [turned(side, body_turn_deg) for side in (near, far)]
    return NormalMaps(view, camera, near.any(axis=2), near, far, *body)


@pytest.fixture
def scan(tmp_path):
    return Scan("toy", "t1", tmp_path / "t1.obj", "metres", "+z", np.eye(4), {})


@pytest.fixture
def labelled(scan, tmp_path):
    path = tmp_path / "labels.npz"
    half = len(SPHERE.faces) // 2
    labels = np.repeat([0, 1], [half, len(SPHERE.faces) - half]).astype(np.int16)
    np.savez(path, face_labels=labels, names=np.array(["head", "dress"]))
    return replace(scan, labels_path=path)


def errors_of(maps, scan):
    return normal_map_errors(maps, scan, SPHERE)


def test_true_maps_have_no_error_and_a_turned_body_has_its_own(labelled):
    entries = errors_of([maps(0, 30.0), maps(2, 30.0)], labelled)
    assert [(e.view, e.yaw_deg, e.side) for e in entries] == [
        (0, 0.0, "near"),
        (0, 0.0, "far"),
        (2, 90.0, "near"),
        (2, 90.0, "far"),
    ]
    for entry in entries:
        for pair in (entry.clothed, entry.whole):
            estimate, body = pair.estimate, pair.body
            assert estimate.mean_deg < 1e-6
            assert estimate.share_below_11_25 == 1.0
            # By more than a corner's width off the axis, by at most the whole turn.
            assert 12 < body.mean_deg < 30
            assert estimate.n == body.n


def test_folds_are_those_of_the_maps_at_their_pixels_size(scan):
    camera = RingRig().cameras(360, 640)[0]
    caster = Raycaster(SPHERE)
    near = caster.normals(camera, "near")
    true = NormalMaps(0, camera, near.any(axis=2), *[near, caster.normals(camera, "far")] * 2)
    seen, hidden = (entry.folds for entry in errors_of([true], scan))
    assert seen.estimate_deg == seen.truth_deg == pytest.approx(hidden.truth_deg, rel=0.2)
    assert seen.truth_deg == pytest.approx(
        fold_strength(near, near.any(axis=2), 3.0 / camera.K[0, 0]).mean_deg, rel=1e-6
    )
    assert seen.correlation == pytest.approx(1.0)
    # A pixel of the small cameras covers 13 mm.
    assert errors_of([maps(0)], scan)[0].folds is None


def test_clothed_pixels_are_those_of_faces_that_are_worn(labelled):
    """The lower half is: a camera at its height sees as much of both."""
    wrong = maps(0)
    lower = turned(wrong.front, 180.0)
    lower[:30] = wrong.front[:30]
    entry = errors_of([replace(wrong, front=lower)], labelled)[0]
    assert entry.clothed.estimate.n == pytest.approx(entry.whole.estimate.n / 2, rel=0.05)
    assert entry.clothed.estimate.mean_deg == pytest.approx(
        2 * entry.whole.estimate.mean_deg, rel=0.05
    )


def test_without_labels_all_pixels_count_and_without_maps_there_is_nothing(scan):
    entry = errors_of([maps(0, 30.0)], scan)[0]
    assert entry.clothed is None
    assert entry.whole.body.mean_deg > 10
    assert normal_map_errors([], scan, SPHERE) == ()


def test_pixels_beside_the_scan_are_not_compared(scan):
    """A mask may be larger than the scan, by the half pixel at its edge."""
    seen = maps(0)
    wide = np.ones_like(seen.mask)
    filled = np.where(seen.mask[..., None], seen.front, [1.0, 0.0, 0.0])
    wider = replace(seen, mask=wide, front=filled, body_front=filled)
    entry = errors_of([wider], scan)[0]
    assert entry.whole.estimate.n == int(seen.mask.sum())
    assert entry.whole.estimate.mean_deg < 1e-6


def test_maps_of_another_size_than_their_camera_are_refused():
    seen = maps(0)
    with pytest.raises(MethodError, match="body back map of view 0 does not fit"):
        replace(seen, body_back=seen.body_back[1:])


def test_the_persons_own_labels_are_those_of_the_avatars():
    assert {*(name for name, _ in _REGIONS), "eyes", "hair", "skin"} == BODY_REGIONS


def test_files_keep_directions_to_half_a_degree(tmp_path):
    views = [maps(0, 30.0), maps(4)]
    save_normals(tmp_path / "normals.npz", views)
    loaded = load_normals(tmp_path / "normals.npz")
    assert [each.view for each in loaded] == [0, 4]
    for before, after in zip(views, loaded, strict=True):
        assert after.camera.to_dict() == before.camera.to_dict()
        np.testing.assert_array_equal(after.mask, before.mask)
        for name in ("front", "back", "body_front", "body_back"):
            one, other = getattr(before, name), getattr(after, name)
            assert (one.any(axis=2) == other.any(axis=2)).all()
            along = np.einsum("ijk,ijk->ij", one, other)[before.mask]
            assert np.degrees(np.arccos(along.clip(-1, 1))).max() < 0.5


@pytest.mark.parametrize("damage", ["gone", "cut", "other"])
def test_files_that_are_no_normal_maps_are_named(tmp_path, damage):
    path = tmp_path / "normals.npz"
    if damage != "gone":
        save_normals(path, [maps(0)])
    if damage == "cut":
        path.write_bytes(path.read_bytes()[:500])
    elif damage == "other":
        np.savez(path, mask_00=np.zeros((2, 2), bool))
    with pytest.raises(DataError, match="normal maps"):
        load_normals(path)

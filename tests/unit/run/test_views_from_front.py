"""Whatever numbers a rig gives its views, a method is handed the front first."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from harness.core.artifacts import Capture, Reconstruction
from harness.core.errors import MethodError
from harness.core.mesh import Mesh
from harness.core.protocols import MethodInfo, Privilege
from harness.core.rigs import RingRig
from harness.core.typed_json import to_json
from harness.data.manifest import load_manifest
from harness.files.obj import write_obj
from harness.geometry.images import save_png
from harness.run import cell_worker
from harness.run.cell import scores_of
from harness.run.cell_job import CellJob
from harness.run.method_choice import ChosenMethod
from harness.run.record_inputs import evaluated, method_code
from harness.run.sources import Source
from harness.run.view_choice import as_given, views_for
from harness.run.workspace import Workspace

MANIFEST = """\
schema: 1
datasets:
  toy:
    {title: T, kind: thuman, licence: own, root: scans, scale: units, facing: "+z", subjects: [t1]}
rigs:
  ring8: {views: 8}
  published8: {views: 8, first_yaw_deg: 90.0}
  ring16: {views: 16}
  flat8: {views: 8, span_m: 1.6}
recipes:
  ours: {rig: ring8, width: 96, height: 54, renderer: raycast, minimum_mask_iou: 0.9}
  theirs: {rig: published8, width: 96, height: 54, renderer: raycast, minimum_mask_iou: 0.9}
  many: {rig: ring16, width: 96, height: 54, renderer: raycast, minimum_mask_iou: 0.9}
  parallel: {rig: flat8, width: 96, height: 54, renderer: raycast, minimum_mask_iou: 0.9}
protocols:
  exact: {version: 1, samples: 500, sampling: stratified, chamfer: point-to-surface}
"""


def tetrahedron() -> Mesh:
    """Without any symmetry, so that every view differs from every other."""
    corners = np.array([[-0.2, -0.4, 0.1], [0.3, -0.35, 0.05], [0.0, -0.3, -0.2], [0.05, 0.4, 0.0]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    return Mesh(corners, faces, np.full((1, 2), 0.5), np.zeros_like(faces))


@pytest.fixture
def world(tmp_path: Path) -> Path:
    folder = tmp_path / "scans" / "model" / "t1"
    folder.mkdir(parents=True)
    write_obj(folder / "t1.obj", tetrahedron())
    (folder / "material0.mtl").write_text("newmtl material0\nmap_Kd material0.png\n")
    save_png(folder / "material0.png", np.full((8, 8, 3), 180, np.uint8))
    (tmp_path / "m.yaml").write_text(MANIFEST)
    return tmp_path


class Witness:
    """Hands the answer back, and keeps what it was shown."""

    info = MethodInfo("witness", "Witness", views=(0, 4))

    def reconstruct(self, capture, context) -> Reconstruction:
        self.shown, self.lent = capture, context.privileged
        return Reconstruction(tetrahedron())


def carried_out(witness, filed, world, monkeypatch) -> dict:
    """The result of a cell of the witness on a filed capture."""
    manifest = load_manifest(world / "m.yaml")
    source = Source.select(manifest, Workspace(world), "toy", (), filed.recipe)
    chosen = ChosenMethod("witness", "witness", {}, "methods.gt", witness)
    monkeypatch.setattr(ChosenMethod, "of", lambda *_, **__: chosen)
    protocol = manifest.protocol("exact")
    info = as_given(witness.info, filed)
    code = method_code("methods.gt", info.privileges)
    inputs = evaluated(info, code, filed, source.locate("t1"), protocol, 0)
    cell = world / "cell"
    cell.mkdir()
    job = CellJob(source.only("t1"), chosen.ref, protocol.name, 0, inputs, cell, keep=False)
    told = to_json(cell_worker.handle(job, lambda *_: None))
    assert told["status"] == "ok", told["reason"]
    return told


def filed_capture(world, recipe):
    """The subject's photos by a recipe, as they lie on disk."""
    manifest = load_manifest(world / "m.yaml")
    source = Source.select(manifest, Workspace(world), "toy", (), recipe)
    return source.ensure_capture("t1", lambda *_: None)


@pytest.mark.parametrize("recipe", ["ours", "theirs"])
def test_a_method_is_handed_the_front_first(world, monkeypatch, recipe):
    filed, witness = filed_capture(world, recipe), Witness()
    told = carried_out(witness, filed, world, monkeypatch)

    assert told["scores"]["metrics"]["p2s_accuracy"]["value"] == pytest.approx(0, abs=1e-3)
    assert not witness.lent
    front, back = (witness.shown.cameras[view] for view in witness.info.views)
    np.testing.assert_allclose(front.position, [0, 0, 3], atol=1e-12)
    np.testing.assert_allclose(back.position, [0, 0, -3], atol=1e-12)
    number = {"ours": 0, "theirs": 6}[recipe]
    assert witness.shown.image_path(0) == filed.image_path(number)
    # What is on disk keeps the rig's own numbers.
    np.testing.assert_allclose(filed.cameras[number].position, [0, 0, 3], atol=1e-12)


def test_of_sixteen_photos_a_method_is_given_its_own_and_scored_on_all(world, monkeypatch):
    seen: list[int] = []

    def scored(result, capture, *rest):
        seen.append(len(capture.cameras))
        return scores_of(result, capture, *rest)

    monkeypatch.setattr(cell_worker, "scores_of", scored)
    filed, witness = filed_capture(world, "many"), Witness()
    told = carried_out(witness, filed, world, monkeypatch)
    assert told["details"]["photos_by_view"] == {"0": 0, "4": 8}
    back = witness.shown.cameras[4]
    np.testing.assert_allclose(back.position, [0, 0, -3], atol=1e-12)
    assert seen == [16]


def test_of_parallel_photos_that_tell_no_depth_the_centre_is_lent(world, monkeypatch):
    witness = Witness()
    carried_out(witness, filed_capture(world, "parallel"), world, monkeypatch)
    ends = tetrahedron().bounds
    np.testing.assert_allclose(witness.lent[Privilege.SUBJECT_CENTRE], ends.mean(axis=0), atol=1e-6)


def test_both_numberings_are_the_same_eight_photos(world):
    manifest = load_manifest(world / "m.yaml")
    ours, theirs = (
        Source.select(manifest, Workspace(world), "toy", (), recipe)
        for recipe in ("ours", "theirs")
    )
    for source in (ours, theirs):
        source.ensure_capture("t1", lambda *_: None)
    pictures = []
    for view in range(8):
        one, other = (source.capture("t1").image_path(view) for source in (ours, theirs))
        assert one.read_bytes() == other.read_bytes()
        pictures.append(one.read_bytes())
    assert len(set(pictures)) == 8
    assert ours.capture("t1").image_path(2).name == "02.png"
    assert theirs.capture("t1").image_path(2).name == "00.png"


# Which photos a method is given


def imported(yaws_deg):
    cameras = [replace(RingRig(views=1, first_yaw_deg=yaw).cameras(30, 40)[0]) for yaw in yaws_deg]
    return Capture("captures", "t", "imported", "", None, tuple(cameras))  # pyright: ignore


def test_a_ring_of_eight_is_found_among_many_photos():
    yaws = [200, 0, 13, 44, 50, 88, 91, 137, 178, 222, 275, 312, 350, 30, 60]
    chosen = views_for(MethodInfo("m", "M", views=tuple(range(8))), imported(yaws))
    picked = [yaws[number] for number in chosen.capture.numbers]
    assert picked == [0, 44, 91, 137, 178, 222, 275, 312]
    assert "photos_far_from_their_view_deg" not in chosen.details


def test_front_and_back_are_found_and_what_is_far_is_told():
    yaws = [100, 20, 230]
    chosen = views_for(MethodInfo("m", "M", views=(0, 4)), imported(yaws))
    assert [yaws[chosen.capture.numbers[view]] for view in (0, 4)] == [20, 230]
    assert chosen.details["photos_far_from_their_view_deg"] == {"4": 50.0}


def test_a_method_that_takes_more_photos_than_there_are_says_so():
    with pytest.raises(MethodError, match="takes 8 photos.*got 3 of 't'.*mexecon2"):
        views_for(MethodInfo("m", "M", views=tuple(range(8))), imported([0, 90, 200]))


def test_where_a_photo_was_left_out_the_others_keep_their_places():
    """Numbers after it would be one less, and the back another view."""
    ring = imported(range(0, 360, 45))
    reports = [
        {"name": f"photo {view}", "left_out": "it moved" if view == 2 else ""} for view in range(8)
    ]
    seven = replace(
        ring,
        recipe="quick8-uncalibrated",
        cameras=tuple(camera for view, camera in enumerate(ring.cameras) if view != 2),
        provenance={"estimate": {"focal": "given", "photos": reports}},
    )
    chosen = views_for(MethodInfo("m2", "M", views=(0, 4)), seven)
    assert chosen.details == {"photos_by_view": {"0": 0, "4": 3}}
    assert chosen.capture.cameras[4] is ring.cameras[4]
    with pytest.raises(
        MethodError, match="takes 8 photos .got 7 of '.*', without photo 2: it moved"
    ):
        views_for(MethodInfo("m8", "M", views=tuple(range(8))), seven)
    assert len(views_for(MethodInfo("m", "M"), seven).capture.cameras) == 7


def test_a_method_that_takes_all_photos_is_given_all_from_the_front():
    chosen = views_for(MethodInfo("m", "M"), imported([90, 0, 200]))
    assert chosen.capture.numbers == (1, 0, 2)


def test_a_method_that_needs_perspective_says_so():
    ring = Capture("toy", "t", "ortho", "", None, RingRig(span_m=2.0).cameras(30, 40))  # pyright: ignore
    with pytest.raises(MethodError, match="'m' takes no orthographic photos: it finds pinholes"):
        views_for(MethodInfo("m", "M", needs_perspective="it finds pinholes"), ring)
    assert len(views_for(MethodInfo("m", "M"), ring).capture.cameras) == 8


@pytest.mark.parametrize(
    ("pitch_deg", "views", "given"),
    [
        (0.0, (0,), True),
        (0.0, (0, 4), True),
        (0.0, (0, 2), False),
        (0.0, None, False),
        (15.0, (0,), True),
        (15.0, (0, 4), False),
    ],
)
def test_who_sees_parallel_photos_alone_is_given_the_depth(pitch_deg, views, given):
    rig = RingRig(span_m=2.0, pitch_deg=pitch_deg)
    ring = Capture("toy", "t", "ortho", "", None, rig.cameras(30, 40))  # pyright: ignore
    method = MethodInfo("m", "M", views=views, privileges=(Privilege.KNOWN_CAMERAS,))
    added = (Privilege.SUBJECT_CENTRE,) if given else ()
    assert as_given(method, ring).privileges == (Privilege.KNOWN_CAMERAS, *added)
    seen = replace(rig, span_m=0.0).cameras(30, 40)
    assert as_given(method, replace(ring, cameras=seen)) == method
    assert as_given(method, replace(ring, recipe="imported")) == method
    placed = replace(method, privileges=(Privilege.GROUND_TRUTH_MESH,))
    assert as_given(placed, ring) == placed


@pytest.mark.parametrize(("count", "photos"), [(16, (0, 2, 4, 6, 8, 10, 12, 14)), (8, range(8))])
def test_a_method_for_eight_takes_every_second_photo_of_sixteen(count, photos):
    ring = Capture("toy", "t", "ring", "", None, RingRig(views=count).cameras(30, 40))  # pyright: ignore
    chosen = views_for(MethodInfo("m", "M", views=tuple(range(8))), ring)
    assert chosen.capture.numbers[:8] == tuple(photos)


@pytest.mark.parametrize(
    ("count", "views", "photos"),
    [
        (4, (0, 1, 2, 3), (0, 1, 2, 3)),
        (4, (0, 2), (0, 2)),
        (4, (0, 4), (0, 2)),
        (6, tuple(range(8)), tuple(range(6))),
        (16, (0, 4), (0, 8)),
        (16, (0, 8), (0, 8)),
        (16, (0, 4, 8, 12), (0, 4, 8, 12)),
    ],
)
def test_views_of_rings_of_other_numbers(count, views, photos):
    ring = Capture("toy", "t", "ring", "", None, RingRig(views=count).cameras(30, 40))  # pyright: ignore
    chosen = views_for(MethodInfo("m", "M", views=views), ring).capture
    there = [view for view in views if view < len(chosen.cameras)]
    assert tuple(chosen.numbers[view] for view in there) == photos

"""``mexecon+`` as a method: its settings, what it says of itself, and its way from files."""

from __future__ import annotations

import contextlib
from dataclasses import replace

import numpy as np
import pytest

from harness.core.artifacts import Body, Capture, image_name
from harness.core.errors import HarnessError, MethodError
from harness.core.mesh import Mesh
from harness.core.protocols import Context, Privilege
from harness.core.rigs import RingRig
from harness.geometry.coinciding import open_edges
from harness.geometry.images import save_png
from harness.geometry.raycast import Raycaster
from methods.nview.method import FusedMethod, _Person, mexecon_plus
from methods.nview.views import even_choice
from tests.unit.methods.stereo.conftest import grain, picture

#: Photos are matched at half their size, in windows that are as wide as in full.
SMALL = {
    "nview.voxel_m": "0.014",
    "nview.resolution": "160",
    "match.pixel_m": "0.0045",
    "match.radius_px": "2",
}


def photograph(mesh, cameras, folder) -> Capture:
    """Grey RGBA pictures whose alpha is the exact coverage."""
    caster = Raycaster(mesh)
    for view, camera in enumerate(cameras):
        alpha = np.round(255 * caster.coverage(camera)).astype(np.uint8)
        rgba = np.dstack([np.full((*alpha.shape, 3), 128, np.uint8), alpha])
        save_png(folder / image_name(view), rgba)
    return Capture("toy", "s", "r", "k", folder, tuple(cameras))


@pytest.fixture(scope="module")
def small_ball(ball) -> Mesh:
    """A sphere of 10 cm: the surface that follows photos has a quarter of the faces."""
    return Mesh(ball.vertices / 2, ball.faces)


def context(folder, mesh=None) -> Context:
    lent = {}
    if mesh is not None:
        caster = Raycaster(mesh)
        lent[Privilege.ORACLE_NORMALS] = lambda camera, side="near": caster.normals(camera, side)
    return Context(0, folder, lambda _: contextlib.nullcontext(), lent)


def test_it_takes_all_views_and_names_its_parts():
    info = mexecon_plus.info
    assert info.views is None
    rooms = {"body", "nview", "match", "keep", "narrow", "dents", "pulls"}
    assert set(info.parameters) == rooms
    assert [part.role for part in info.parts] == ["body model", "landmarks", "normal estimator"]
    assert info.deviations == ()


def test_without_a_body_nothing_of_it_is_named():
    info = mexecon_plus.configured({"body": "off"}).info
    assert info.parameters["nview"]["body"] == "off"
    assert "body" not in info.parameters
    alone = mexecon_plus.configured({"nview.photos": "off"}).info
    assert set(alone.parameters) == {"body", "nview"}
    assert [part.role for part in info.parts] == ["normal estimator"]
    # The shipped network was trained on avatars of the same generator.
    assert Privilege.GENERATOR_PRIOR in info.privileges
    bare = mexecon_plus.configured({"body": "off", "nview.normals": "off"}).info
    assert bare.parts == ()
    assert set(bare.privileges) == {Privilege.KNOWN_CAMERAS, Privilege.EXACT_MASKS}


def test_oracle_normals_are_a_privilege():
    info = mexecon_plus.configured({"nview.normals": "oracle"}).info
    assert Privilege.ORACLE_NORMALS in info.privileges


def test_unknown_settings_get_the_nearest():
    with pytest.raises(HarnessError, match="Did you mean 'nview.voxel_m'"):
        mexecon_plus.configured({"nview.voxel": "0.01"})


def test_from_files_to_a_surface_without_a_body(small_ball, ring, tmp_path):
    settings = {"body": "off", "nview.normals": "oracle", **SMALL}
    capture = photograph(small_ball, ring(6), tmp_path)
    found = mexecon_plus.configured(settings).reconstruct(capture, context(tmp_path, small_ball))
    assert open_edges(found.mesh) == 0
    assert np.abs(np.linalg.norm(found.mesh.vertices, axis=1) - 0.1).mean() < 0.001
    assert found.body is None
    assert found.normals == ()
    fusion = found.details["fusion"]
    assert len(fusion["moved_mm"]) == fusion["rounds"]
    # Plain grey shows nothing that photos could agree on.
    assert found.details["photos"]["points"] == 0


def test_maps_of_some_views_say_which_photos_they_are_of(small_ball, ring, tmp_path, monkeypatch):
    body = Body("a ball", small_ball.vertices, np.zeros((1, 3)), small_ball.faces)
    person = _Person(small_ball, body, np.zeros((0, 3)), {})
    monkeypatch.setattr(FusedMethod, "_person", lambda *_: person)
    settings = {"nview.views": "4", "nview.normals": "oracle", "nview.photos": "off",
                "nview.rounds": "1", **SMALL}  # fmt: skip
    capture = photograph(small_ball, ring(8), tmp_path)
    found = mexecon_plus.configured(settings).reconstruct(capture, context(tmp_path, small_ball))
    # The front and the back of the four are photos 0 and 4 of the eight.
    assert [maps.view for maps in found.normals] == [0, 4]
    for maps in found.normals:
        seen = capture.cameras[maps.view]
        np.testing.assert_array_equal(maps.camera.world_to_camera, seen.world_to_camera)


def test_outlines_alone(small_ball, ring, tmp_path):
    settings = {"body": "off", "nview.normals": "off", "nview.rounds": "1", **SMALL}
    capture = photograph(small_ball, ring(6), tmp_path)
    mesh = mexecon_plus.configured(settings).reconstruct(capture, context(tmp_path)).mesh
    assert open_edges(mesh) == 0
    assert mesh.signed_volume == pytest.approx(4 / 3 * np.pi * 0.1**3, rel=0.15)


@pytest.mark.nightly
def test_photos_find_what_outlines_leave(ball, ring, tmp_path):
    """The hull of six views stands off a sphere by up to 3 cm; its texture shows where it is."""
    settings = {"body": "off", "nview.normals": "off", "nview.rounds": "0", **SMALL}
    cameras, caster, rng = ring(6), Raycaster(ball), np.random.default_rng(0)
    for view, camera in enumerate(cameras):
        save_png(tmp_path / image_name(view), picture(caster, camera, grain, 0.0, rng))
    capture = Capture("toy", "s", "r", "k", tmp_path, tuple(cameras))

    def off_mm(photos: str) -> float:
        method = mexecon_plus.configured({**settings, "nview.photos": photos})
        points = method.reconstruct(capture, context(tmp_path)).mesh.vertices
        beside = points[np.abs(points[:, 1]) < 0.1]
        return 1000 * float(np.abs(np.linalg.norm(beside, axis=1) - 0.2).mean())

    without, following = off_mm("off"), off_mm("on")
    assert without > 3.0
    assert following < 0.8


def test_two_views_end_in_a_sentence(ball, ring, tmp_path):
    capture = photograph(ball, ring(2), tmp_path)
    method = mexecon_plus.configured({"body": "off"})
    with pytest.raises(MethodError, match="3 to 64 views; got 2"):
        method.reconstruct(capture, context(tmp_path))


def test_a_view_without_a_subject_ends_in_a_sentence(ball, ring, tmp_path):
    capture = photograph(ball, ring(4), tmp_path)
    save_png(tmp_path / image_name(2), np.zeros((480, 360, 4), np.uint8))
    method = mexecon_plus.configured({"body": "off"})
    with pytest.raises(MethodError, match="view 2: the mask shows no subject"):
        method.reconstruct(capture, context(tmp_path))


@pytest.mark.parametrize(
    ("count", "chosen"),
    [
        (0, range(32)),
        (32, range(32)),
        (8, range(0, 32, 4)),
        (6, (0, 5, 10, 16, 21, 26)),
        (3, (0, 10, 21)),
    ],
)
def test_views_are_chosen_evenly_and_keep_their_photos(tmp_path, count, chosen):
    cameras = RingRig(views=32).cameras(24, 32)
    numbers = tuple(range(31, -1, -1))
    capture = Capture("toy", "s", "r", "k", tmp_path, cameras, numbers=numbers)
    some = even_choice(capture, count)
    assert some.numbers == tuple(numbers[view] for view in chosen)
    assert some.cameras == tuple(cameras[view] for view in chosen)
    unnumbered = even_choice(replace(capture, numbers=()), count)
    assert [unnumbered.image_path(view).stem for view in range(len(chosen))] == [
        f"{view:02d}" for view in chosen
    ]


def test_more_views_than_there_are_end_in_a_sentence(tmp_path):
    capture = Capture("toy", "s", "r", "k", tmp_path, RingRig().cameras(24, 32))
    with pytest.raises(MethodError, match=r"16 views were asked for.*at most the 8.*nview\.views"):
        even_choice(capture, 16)


def test_the_number_of_views_is_told():
    assert mexecon_plus.info.view_count is None
    assert mexecon_plus.configured({"nview.views": "6"}).info.view_count == 6
    with pytest.raises(HarnessError, match="views.*65"):
        mexecon_plus.configured({"nview.views": "65"})

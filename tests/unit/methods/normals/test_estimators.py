"""Who estimates normals, and what each is given."""

from __future__ import annotations

import numpy as np
import pytest

from harness.core.errors import HarnessError, MethodError, MissingPart
from harness.core.files.hashing import content_hash
from harness.core.protocols import EstimatedNormals, Privilege
from harness.geometry.raycast import Raycaster
from harness.run.method_choice import ChosenMethod
from methods.body_fit import jmbo8
from methods.mexecon import econ, mexecon8
from methods.normals import NormalChoice, installed, view_maps, working_view
from methods.normals.installed import OPEN_NETWORK
from methods.normals.view_maps import filled_normals


@pytest.fixture
def view(sphere, photograph):
    return working_view(photograph(sphere(0.3)), 0, 64)


def test_the_floor_is_the_body_continued_to_the_outline(view, sphere):
    body = Raycaster(sphere(0.25))
    maps = view_maps(view, body, NormalChoice("body").estimator(view.camera, {}))
    there = np.abs(maps.body_front).sum(2) > 0
    assert 0 < there.sum() < view.mask.sum()
    np.testing.assert_allclose(maps.front[there], maps.body_front[there], atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(maps.front[view.mask], axis=1), 1.0)
    assert (maps.front[~view.mask] == 0).all()
    # Rays spread: at the rim the far side still turns a little towards the viewer.
    assert (maps.back[there][:, 2] < 0.1).all()


def test_the_ceiling_is_asked_for_both_sides_of_its_camera(view, sphere):
    scan, asked = Raycaster(sphere(0.3)), []

    def oracle(camera, side="near"):
        asked.append((camera, side))
        return scan.normals(camera, side)

    estimator = NormalChoice("oracle").estimator(view.camera, {"oracle_normals": oracle})
    maps = view_maps(view, Raycaster(sphere(0.25)), estimator)
    assert asked == [(view.camera, "near"), (view.camera, "far")]
    met = view.mask & (np.abs(scan.normals(view.camera, "near")).sum(2) > 0)
    np.testing.assert_allclose(maps.front[met], scan.normals(view.camera, "near")[met], atol=1e-9)


def test_privileges_and_parts_are_told():
    assert NormalChoice("oracle").privileges == ("oracle_normals",)
    assert NormalChoice("body").privileges == ()
    assert NormalChoice("oracle").part.name == "normals of the scan"


def test_oracle_normals_must_be_lent(view):
    with pytest.raises(MethodError, match="not handed in.*'oracle_normals'"):
        NormalChoice("oracle").estimator(view.camera, {})


@pytest.mark.parametrize(
    ("kind", "model", "message"),
    [
        ("guess", "", "cannot be 'guess'.*body or oracle or open or onnx"),
        ("onnx", "", "do not go together"),
        ("body", "net.onnx", "do not go together"),
        ("open", "net.onnx", "do not go together"),
    ],
)
def test_choices_that_make_no_sense(kind, model, message):
    with pytest.raises(HarnessError, match=message):
        NormalChoice(kind, model)


def test_a_body_beside_the_subject_is_refused(view, sphere):
    beside = Raycaster(sphere(0.1, (0.0, 0.6, 0.0)))
    with pytest.raises(MethodError, match="not where view 0 shows the subject"):
        view_maps(view, beside, NormalChoice("body").estimator(view.camera, {}))


def test_an_estimator_without_numbers_is_refused(view, sphere):
    def broken(rgb, mask, body_front, body_back):
        return EstimatedNormals(body_front * np.nan, body_back)

    with pytest.raises(MethodError, match="front normals of view 0 cannot be used"):
        view_maps(view, Raycaster(sphere(0.3)), broken)


def test_an_estimator_that_asks_for_a_size_works_on_it(sphere, photograph):
    scan, seen = Raycaster(sphere(0.3)), []
    view = working_view(photograph(sphere(0.3)), 0, 64, 96)

    def knowing(rgb, mask, body_front, body_back):
        seen.append([each.shape[:2] for each in (rgb, mask, body_front, body_back)])
        sides = (scan.normals(view.asked.camera, side) for side in ("near", "far"))
        degrees = np.where(mask > 0, 7.0, 0.0)
        return EstimatedNormals(*sides, degrees, degrees)

    maps = view_maps(view, Raycaster(sphere(0.25)), knowing)
    assert seen == [[(96, 96)] * 4]
    assert maps.front.shape == (64, 64, 3) == maps.body_front.shape
    inner = view.mask & (scan.normals(view.camera, "near")[..., 2] > 0.3)
    cosine = (maps.front * scan.normals(view.camera, "near")).sum(2)[inner]
    assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).max() < 1.5
    np.testing.assert_allclose(np.linalg.norm(maps.back[view.mask], axis=1), 1.0)
    # At the outline, too, where half of what a pixel covers is empty.
    np.testing.assert_allclose(maps.front_error_deg[inner], 7.0, rtol=1e-5)
    assert (maps.front_error_deg[~view.mask] == 0).all()

    def small(rgb, mask, body_front, body_back):
        return EstimatedNormals(body_front[:64, :64], body_back[:64, :64])

    with pytest.raises(MethodError, match=r"of shape \(96, 96, 3\)"):
        view_maps(view, Raycaster(sphere(0.25)), small)


def test_holes_take_the_nearest_normal():
    normals = np.zeros((1, 5, 3))
    normals[0, 0], normals[0, 4] = (0, 0, 2), (1, 0, 0)
    mask = np.array([[True, True, False, True, True]])
    filled = filled_normals(normals, mask)
    np.testing.assert_array_equal(filled[0, :, 2], [1, 1, 0, 0, 0])
    np.testing.assert_array_equal(filled[0, :, 0], [0, 0, 0, 1, 1])
    with pytest.raises(MethodError, match="no pixel"):
        filled_normals(np.zeros((1, 5, 3)), mask)


def test_the_open_network_is_the_shipped_one(places, save_network):
    choice = NormalChoice("open")
    with pytest.raises(MissingPart, match=f"no network '{OPEN_NETWORK}' is shipped.*train normals"):
        _ = choice.part
    path = save_network(places / "net.onnx", licence="CC0-1.0")
    own = installed.import_file(path, OPEN_NETWORK, installed.imported_place())
    with pytest.raises(MissingPart, match="is shipped"):
        _ = choice.part
    other = save_network(places / "other.onnx", training_set="avatars-train t00002")
    shipped = installed.import_file(other, OPEN_NETWORK, installed.shipped_places()[0])
    part = choice.part
    assert (part.name, part.licence, part.sha256) == (OPEN_NETWORK, "Apache-2.0", shipped.sha256)
    assert choice.privileges == (Privilege.GENERATOR_PRIOR,)
    assert NormalChoice("onnx", OPEN_NETWORK).part.sha256 == own.sha256 != shipped.sha256
    # What was trained on generated people is known by its content, whatever it is called.
    assert NormalChoice("onnx", OPEN_NETWORK).privileges == ()
    assert NormalChoice("onnx", str(other)).privileges == (Privilege.GENERATOR_PRIOR,)


def test_a_name_means_the_user_s_own_network_or_else_a_shipped_one(places, save_network):
    path = save_network(places / "net.onnx", licence="CC0-1.0", training_set="avatars-train t00001")
    shipped = installed.import_file(path, "second", installed.shipped_places()[0])
    assert NormalChoice("onnx", "second").part.sha256 == shipped.sha256
    other = save_network(places / "other.onnx", training_set="more")
    own = installed.import_file(other, "second", installed.imported_place())
    assert NormalChoice("onnx", "second").part.sha256 == own.sha256 != shipped.sha256


def test_the_estimator_of_a_name_is_its_network(view, sphere, places, save_network):
    path = save_network(places / "net.onnx", {"front": "body_back", "back": "body_front"})
    installed.import_file(path, "swapped", installed.imported_place())
    body = Raycaster(sphere(0.3))
    maps = view_maps(view, body, NormalChoice("onnx", "swapped").estimator(view.camera, {}))
    seen = view.mask & (np.abs(maps.body_front).sum(2) > 0)
    np.testing.assert_allclose(maps.front[seen], maps.body_back[seen], atol=1e-6)


def test_a_name_that_nobody_imported(places):
    with pytest.raises(MissingPart, match="no network 'nobody' is imported.*parts import"):
        NormalChoice("onnx", "nobody").estimator(None, {})  # type: ignore[arg-type]


def test_methods_can_do_without_a_network_that_is_not_there(places):
    missing = econ.configured({"surface.normals": "open"})
    with pytest.raises(MissingPart, match=f"no network '{OPEN_NETWORK}'"):
        _ = missing.info
    parts = missing.configured({"surface.normals": "body", "body.normals": "off"}).info.parts
    assert "normals of the fitted body" in [part.name for part in parts]


def test_the_body_fit_takes_a_network_of_its_own(places, save_network):
    for name, training_set in ((OPEN_NETWORK, "avatars-train t00001"), ("second", "more")):
        path = save_network(places / f"{name}.onnx", licence="CC0-1.0", training_set=training_set)
        installed.import_file(path, name, installed.shipped_places()[0])
    other = {"body.normals": "onnx", "body.normals_model": "second"}
    assert jmbo8.configured(other).info.parts[-1].name == "second"
    both = mexecon8.configured(other).info
    assert [part.name for part in both.parts if part.role == "normal estimator"] == [
        "second",
        OPEN_NETWORK,
    ]
    # A file's place is nobody's business; its content is among the parts.
    assert both.parameters["body"]["normals_model"] is True
    assert mexecon8.info.parameters["body"]["normals_model"] is False
    for wrong in ({"body.normals": "onnx"}, {"body.normals_model": "second"}):
        with pytest.raises(HarnessError, match="do not go together"):
            jmbo8.configured(wrong)
    with pytest.raises(HarnessError, match="not used where 'normals' is 'off'"):
        jmbo8.configured({"body.normals": "off", "body.normals_model": "second"})


def test_a_request_without_its_network_ends_before_any_work(places):
    with pytest.raises(MissingPart, match=f"no network '{OPEN_NETWORK}'"):
        ChosenMethod.of("econ", {"surface.normals": "open"})
    assert (
        ChosenMethod.of("econ", {"surface.normals": "body", "body.normals": "off"}).info.name
        == "econ"
    )


def test_another_network_is_another_record(places, save_network):
    identities = set()
    for trained in ("avatars-train t00001", "avatars-train t00002"):
        path = save_network(places / "net.onnx", training_set=trained)
        installed.import_file(path, OPEN_NETWORK, installed.shipped_places()[0], replace=True)
        info = econ.configured({"surface.normals": "open"}).info
        identities.add(content_hash(info.identity()))
        assert str(places) not in str(info.to_dict())
    assert len(identities) == 2

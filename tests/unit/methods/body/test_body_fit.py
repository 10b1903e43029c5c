"""The methods themselves, from photos to body: MediaPipe looks at an unclothed figure."""

from __future__ import annotations

import contextlib
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from harness.core.artifacts import Capture, image_name
from harness.core.errors import HarnessError, MethodError
from harness.core.mesh import Mesh
from harness.core.protocols import Context, Privilege
from harness.geometry.images import save_png
from harness.geometry.raycast import Raycaster
from harness.run.cell_worker import SharedResults
from harness.run.cost import StageMeter
from methods import body_fit
from methods.body.fit.jmbo import _first_and_kept
from methods.body.photos import detection
from methods.body.photos.detection import detect
from methods.body.photos.views import load_views
from methods.body.settings import JMBO, JMBO_PLUS
from methods.body_fit import BodyFit, body_average, body_front, jmbo8, jmbo8_plus
from methods.estimated_normals import EstimatedNormals
from methods.normals import NormalChoice
from methods.normals.installed import OPEN_NETWORK, named

SKIN = np.array([0.80, 0.60, 0.48])


@pytest.fixture(scope="module")
def figure(anny, person):
    mesh = Mesh(person[1].vertices[0].double().numpy(), anny.faces)
    colours = np.tile(SKIN, (len(mesh.vertices), 1))
    colours[anny.regions["eyeballs"]] = 0.15
    return mesh, colours


@pytest.fixture(scope="module")
def capture(figure, make_views, photograph, tmp_path_factory):
    folder = tmp_path_factory.mktemp("figure")
    cameras = make_views.ring(8, height=480)
    for view, camera in enumerate(cameras):
        save_png(folder / image_name(view), photograph(figure[0], camera, figure[1]))
    return Capture("toy", "figure", "tiny", "figure", folder, cameras)


@pytest.fixture(scope="module")
def readings(answers):
    """What the detector read, by the photo's content."""
    return type(answers)(most=64)


@pytest.fixture(autouse=True)
def _each_photo_is_read_once(readings, monkeypatch):
    """A copy of a photo is the same photo: the detector takes most of a second for each."""

    def shown(file, size):
        return file.path.read_bytes(), size

    monkeypatch.setattr(detection, "_detect", readings.remembering(detection._detect, shown))


def some_views(capture, views, folder):
    """A capture of some of the views, in their own folder."""
    for new, old in enumerate(views):
        target = folder / image_name(new)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(capture.image_path(old).read_bytes())
    cameras = tuple(capture.cameras[view] for view in views)
    return replace(capture, directory=folder, cameras=cameras, key=f"{capture.key}{views}")


def blank(capture, views):
    for view in views:
        width, height = capture.cameras[view].size
        image = np.zeros((height, width, 4), np.uint8)
        image[height // 3 : height // 2, width // 3 : width // 2] = 200
        save_png(capture.image_path(view), image)


@pytest.fixture
def context(tmp_path, figure):
    caster = Raycaster(figure[0])
    return Context(
        seed=0,
        workdir=tmp_path,
        stage=lambda _: contextlib.nullcontext(),
        privileged={
            "oracle_normals": caster.normals,
            "subject_centre": figure[0].bounds.mean(axis=0),
        },
    )


def joint_error_mm(body, anny, person):
    main = [index for role, index in anny.roles.items() if role != "head"]
    truth = person[1].joints[0].numpy()
    return 1000 * np.linalg.norm(body.joints[main] - truth[main], axis=1).mean()


@pytest.mark.nightly
def test_a_person_is_found_in_every_view(capture, anny, person):
    found = detect(capture, range(8))
    assert found.found.all()
    points = person[2]
    nose = list(anny.landmarks.landmarks).index(0)
    pixels, _ = capture.cameras[0].project(points)
    assert np.linalg.norm(found.pixels[0, 0] - pixels[nose]) < 12
    assert np.median(np.linalg.norm(found.points_camera[0, [11, 12]], axis=1)) < 0.8


@pytest.mark.nightly
@pytest.mark.usefixtures("shared_fits")
def test_the_joint_fit_is_better_than_the_average_and_that_than_one_view(
    capture, context, anny, person
):
    exact = {"uncovered": "1.0", "standoff_m": "0.0", "normals": "oracle", "iterations": "30"}
    joint = jmbo8_plus.configured({f"body.{name}": text for name, text in exact.items()})
    fits = [body_front, body_average, joint]
    results = [fit.reconstruct(capture, context) for fit in fits]
    front, mean, joint = (joint_error_mm(r.body, anny, person) for r in results)
    assert joint < mean < front
    assert joint < 10
    np.testing.assert_array_equal(results[2].mesh.vertices, results[2].body.vertices)
    assert "height prior decides" in str(results[0].details["depth"])
    assert results[2].details["swapped_views"] == []


@pytest.mark.nightly
@pytest.mark.usefixtures("quick_landmarks")
def test_equal_seeds_give_equal_bodies(capture, context, tmp_path):
    some = some_views(capture, (0, 2, 5), tmp_path)
    quick = jmbo8_plus.configured({"body.iterations": "4"})
    first, again = (quick.reconstruct(some, context).mesh.vertices for _ in range(2))
    np.testing.assert_allclose(first, again, atol=1e-5)


@pytest.mark.nightly
@pytest.mark.usefixtures("quick_landmarks")
@pytest.mark.parametrize("views", [(0,), (0, 4), (1, 2, 6)])
def test_any_views_will_do(capture, context, views, tmp_path):
    some = some_views(capture, views, tmp_path)
    fit = BodyFit("some", "Some", tuple(range(16)), replace(JMBO, iterations=3, start="landmarks"))
    result = fit.reconstruct(some, context)
    assert result.details["views_used"] == list(range(len(views)))
    assert 1.2 < result.mesh.extent[1] < 2.3


def noisy_cameras(cameras, rotation_deg, centre_m, seed):
    """Cameras that are each turned and moved a little, as a calibration leaves them."""
    random = np.random.default_rng(seed)
    noisy = []
    for camera in cameras:
        turn = Rotation.from_rotvec(np.radians(rotation_deg) * random.standard_normal(3))
        rotation = turn.as_matrix() @ camera.rotation
        centre = camera.position + centre_m * random.standard_normal(3)
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = rotation, -rotation @ centre
        noisy.append(replace(camera, world_to_camera=pose))
    return tuple(noisy)


@pytest.mark.nightly
@pytest.mark.usefixtures("shared_fits")
def test_noisy_cameras_cost_millimetres_and_not_the_fit(capture, context, anny, person):
    brief = jmbo8_plus.configured({"body.iterations": "15"})
    noisy = replace(capture, cameras=noisy_cameras(capture.cameras, 0.2, 0.005, seed=1))
    clean, worse = (
        joint_error_mm(brief.reconstruct(one, context).body, anny, person)
        for one in (capture, noisy)
    )
    # 0.2 degrees at 3 m and 5 mm are together some 12 mm, and eight views average.
    assert worse < clean + 12


@pytest.mark.nightly
@pytest.mark.usefixtures("quick_landmarks")
def test_a_view_without_a_person_is_left_out_and_said_so(capture, context, tmp_path):
    some = some_views(capture, (0, 2, 4), tmp_path)
    blank(some, [1])
    result = body_average.reconstruct(some, context)
    assert result.details["views_used"] == [0, 2]
    assert result.details["views_left_out"] == {"1": "no person was detected"}


@pytest.mark.nightly
def test_no_person_at_all_is_an_error(capture, context, tmp_path):
    some = some_views(capture, (0, 1), tmp_path)
    blank(some, [0, 1])
    assert not detect(some, range(2)).found.any()
    with pytest.raises(MethodError, match="no view shows a person.*view 0: no person"):
        jmbo8_plus.reconstruct(some, context)


@pytest.mark.nightly
def test_estimated_normals_lie_on_the_pixels_of_the_fit(capture, figure):
    """The body's own normals stand in for a network's: the answer is known at every pixel."""
    views = load_views(capture, (0, 3), 256)
    mesh = figure[0]
    normals_of = EstimatedNormals(capture, views, mesh.faces, NormalChoice("body"))
    caster = Raycaster(mesh)
    for view, normals in zip(views.views, normals_of(mesh.vertices), strict=True):
        truth = caster.normals(view.camera)
        both = truth.any(axis=2) & normals.any(axis=2)
        assert both.sum() > 0.97 * truth.any(axis=2).sum()
        cosine = (truth * normals).sum(axis=2)[both]
        assert np.median(np.degrees(np.arccos(np.clip(cosine, -1, 1)))) < 1.5
        np.testing.assert_allclose(np.linalg.norm(normals[both], axis=1), 1.0)


@pytest.mark.nightly
@pytest.mark.usefixtures("shared_fits")
def test_the_papers_form_compares_normals_and_names_the_network(capture, context):
    result = jmbo8.configured({"body.iterations": "2"}).reconstruct(capture, context)
    before, after = result.details["jmbo"]["terms"]["normal"]
    assert before > 0
    assert after > 0
    assert "normal estimator" in [part.role for part in jmbo8.info.parts]


@pytest.mark.nightly
@pytest.mark.usefixtures("shared_fits")
def test_normals_estimated_anew_change_the_fit(capture, context):
    once, anew = (
        jmbo8.configured({"body.iterations": "2", "body.normals_every": every})
        .reconstruct(capture, context)
        .details["jmbo"]["cost"]
        for every in ("0", "1")
    )
    assert once[0] == anew[0]
    assert once[1] != anew[1]


@pytest.mark.nightly
@pytest.mark.usefixtures("quick_landmarks")
def test_one_view_opens_no_other_photo(capture, context, tmp_path):
    """The side photos are broken, and nobody looks."""
    some = some_views(capture, (0, 1, 2), tmp_path)
    for view in (1, 2):
        some.image_path(view).write_bytes(b"no picture")
    result = body_front.reconstruct(some, context)
    assert result.details["views_used"] == [0]


@pytest.mark.nightly
@pytest.mark.usefixtures("shared_fits")
def test_a_given_centre_holds_one_views_body_there(capture, context, figure):
    given = body_front.configured({"body.depth": "subject-centre"})
    result = given.reconstruct(capture, context)
    middle = result.mesh.bounds.mean(axis=0) - figure[0].bounds.mean(axis=0)
    assert abs(middle[2]) < 0.02
    assert "given centre" in str(result.details["depth"])
    assert "subject_centre" in given.info.privileges
    assert "subject_centre" not in body_front.info.privileges


@pytest.mark.nightly
@pytest.mark.usefixtures("quick_landmarks")
def test_depth_that_an_orthographic_view_does_not_tell_is_lent_or_said(capture, context):
    cameras = tuple(camera.weak_perspective(3.0) for camera in capture.cameras)
    flat = replace(capture, cameras=cameras)
    centre = flat.cameras[0].position + 3.4 * flat.cameras[0].forward
    lent = replace(context, privileged={Privilege.SUBJECT_CENTRE: centre})
    alone = replace(context, privileged={})
    for given, depth_m, said in ((lent, 3.4, "given centre"), (alone, 3.0, "3.0 m from the")):
        result = body_front.reconstruct(flat, given)
        middle = result.mesh.bounds.mean(axis=0) - flat.cameras[0].position
        assert middle @ flat.cameras[0].forward == pytest.approx(depth_m, abs=0.02)
        assert said in str(result.details["depth"])


@pytest.mark.parametrize("unused", [{"stage": "average"}, {"normal": "0"}, {"normals": "off"}])
def test_a_network_that_is_not_run_is_not_named(unused):
    settings = {f"body.{name}": text for name, text in unused.items()}
    roles = [part.role for part in jmbo8.configured(settings).info.parts]
    assert "normal estimator" not in roles


def test_settings_are_checked_and_recorded():
    oracle = jmbo8.configured({"body.normals": "oracle", "body.iterations": "7"})
    assert "oracle_normals" in oracle.info.privileges
    assert "oracle_normals" not in jmbo8.info.privileges
    assert oracle.info.parameters["body"]["iterations"] == 7
    with pytest.raises(HarnessError, match="setting 'model' cannot be 'smpl'.*anny or smplx"):
        jmbo8.configured({"body.model": "smpl"})
    with pytest.raises(HarnessError, match="unknown setting 'iterations'.*'body.iterations'"):
        jmbo8.configured({"iterations": "7"})


def test_what_a_stage_does_not_use_is_not_in_its_key():
    assert "silhouette" in jmbo8.info.parameters["body"]
    assert "silhouette" not in body_front.info.parameters["body"]
    assert "depth" in body_front.info.parameters["body"]
    assert "depth" not in jmbo8.info.parameters["body"]
    assert body_front.info.views == (0,)


def test_a_licensed_file_is_recorded_by_content_and_not_by_path(tmp_path):
    path = tmp_path / "SMPLX_NEUTRAL.npz"
    path.write_bytes(b"x")
    fit = jmbo8.configured({"body.model": "smplx", "body.model_file": str(path)})
    part = fit.info.parts[0]
    assert part.name == "SMPL-X"
    assert len(part.sha256) == 64
    assert str(tmp_path) not in str(fit.info.to_dict())
    assert "body.model" not in [deviation.what for deviation in fit.info.deviations]


@pytest.mark.nightly
@pytest.mark.usefixtures("quick_landmarks")
def test_a_fit_is_shared_by_methods_that_ask_for_the_same(capture, context, tmp_path, monkeypatch):
    meters = [StageMeter() for _ in range(2)]
    quick = {"body.iterations": "2"}
    fits = [BodyFit("a", "A", (0, 4), JMBO_PLUS), BodyFit("b", "B", (0, 4), JMBO_PLUS)]
    results = []
    for fit, meter in zip(fits, meters, strict=True):
        share = SharedResults(tmp_path / "shared", meter, lambda: True)
        lent = replace(context, seed=len(results), stage=meter.stage, share=share)
        results.append(fit.configured(quick).fit(capture, lent))
        # The second is handed everything.
        monkeypatch.setattr(body_fit, "fit_body", None)
    first, second = (fit.body.to_arrays() for fit in results)
    assert all(first[name].tobytes() == second[name].tobytes() for name in first)
    assert results[0].details() == results[1].details()
    assert meters[0].stages == meters[1].stages
    assert {"landmarks", "jmbo"} <= {stage.name for stage in meters[0].stages}

    # What decides the fit decides who shares it.
    share = SharedResults(tmp_path / "shared", StageMeter(), lambda: True)
    others = [
        fits[0].configured({"body.iterations": "3"}).fit,
        BodyFit("c", "C", (0, 2), JMBO_PLUS).configured(quick).fit,
    ]
    for fit in others:
        with pytest.raises(TypeError, match="NoneType"):
            fit(capture, replace(context, share=share))


@pytest.mark.nightly
def test_photos_are_read_once_for_all_that_share_them(capture, tmp_path, monkeypatch):
    share = SharedResults(tmp_path / "shared", StageMeter(), lambda: True)
    first = detect(capture, (0, 4), share)
    monkeypatch.setattr(detection, "_detect", None)
    second = detect(capture, (4, 0), share).at((1, 0))
    for name in ("pixels", "points_camera", "confidence", "hands"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))


@pytest.mark.parametrize(
    ("settings", "learned"),
    [
        ({"normals": "off"}, False),
        ({}, True),
        ({"normals": "onnx", "normals_model": OPEN_NETWORK}, True),
        ({"normals": "onnx", "normals_model": str(named(OPEN_NETWORK).path)}, True),
        ({"normals": "off", "prior": "0.001"}, True),
        ({"stage": "landmarks", "uncovered": "0.5"}, False),
        ({"normals": "off", "model": "anny"}, True),
    ],
)
def test_whatever_was_learned_on_generated_people_is_a_privilege(settings, learned):
    method = jmbo8.configured({f"body.{name}": text for name, text in
                               {"model": "smplx", **settings}.items()})  # fmt: skip
    assert ("generator_prior" in method.info.privileges) is learned


@pytest.mark.parametrize(
    "setting",
    ["iterations=-5", "batch=-1", "subject_px=0", "rate=0", "silhouette=-1", "standoff_m=2"],
)
def test_numbers_that_cannot_be_are_refused(setting):
    name, value = setting.split("=")
    with pytest.raises(HarnessError, match=f"'{name}' cannot be '{float(value):g}|'{name}' cannot"):
        jmbo8.configured({f"body.{name}": value})


def test_without_iterations_the_start_is_kept():
    assert _first_and_kept([], [], picks_best=False) == {}

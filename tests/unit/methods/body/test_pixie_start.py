"""PIXIE's bodies in the world: the calibrated camera sees them where PIXIE's own camera does."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from harness.core.artifacts import Capture, image_name
from harness.core.camera import Camera, look_at
from harness.core.errors import HarnessError, MethodError, MissingPart
from harness.geometry.images import save_png
from harness.geometry.place import Place
from harness.run.method_choice import ChosenMethod
from methods.body.fit.landmark_fit import average, average_of_columns
from methods.body.models.model import neutral
from methods.body.models.smplx_body import SmplxBody
from methods.body.models.smplx_part import SMPLX, named_model
from methods.body.photos.views import View
from methods.body.pixie import network as convert
from methods.body.pixie import start
from methods.body.pixie.start import (
    _MIRRORED,
    crop_window,
    held_values,
    pixie_each_view,
    pixie_sees,
    seen_by,
)
from methods.body.settings import FitSettings
from methods.parts.converted import NETWORK, OUTPUTS, PIXIE
from methods.parts.kind import ImportOptions
from methods.parts.onnx_networks import open_session
from methods.parts.store import Examined

onnx = pytest.importorskip("onnx")

SIDE = 400
#: PIXIE's frame is the camera's, so that a person who faces it is turned upside down.
FACING = Rotation.from_euler("XYZ", [np.pi, 0.2, 0.1]).as_matrix()
HIP = Rotation.from_rotvec([0.3, -0.2, 0.1]).as_matrix()


def six(turns: np.ndarray) -> np.ndarray:
    return turns.reshape(-1, 3, 3)[:, :, :2].ravel()


def numbers(turn: np.ndarray, camera: tuple[float, float, float]) -> dict[str, np.ndarray]:
    """What PIXIE answers for a body that only bends its left hip."""
    rest = np.eye(3)
    part = [HIP, *[rest] * 16]
    wrists = {"left_hand": turn * _MIRRORED, "right_hand": turn}
    hands = {side: six(np.stack([wrist, *[rest] * 15])) for side, wrist in wrists.items()}
    head = np.concatenate([np.full(200, 0.5), np.zeros(50), six(turn), np.zeros(3)])
    body = np.concatenate([camera, six(np.stack([turn, *part, rest]))])
    return {"body": body, "head": head, **hands}


def save_answers(path: Path, answers: dict[str, np.ndarray]) -> None:
    """A network that always answers the same; the first shape values are the picture's means."""
    helper, real = onnx.helper, onnx.TensorProto.FLOAT
    given = [helper.make_tensor_value_info("picture", real, [1, 3, 224, 224])]
    made = [helper.make_tensor_value_info(n, real, [1, c]) for n, c in OUTPUTS.items()]
    constants = {**answers, "head": answers["head"][3:]}
    nodes = [helper.make_node("ReduceMean", ["picture"], ["means"], axes=[2, 3], keepdims=0)]
    for name, values in constants.items():
        tensor = onnx.numpy_helper.from_array(np.float32(values)[None], name)
        target = "rest" if name == "head" else name
        nodes.append(helper.make_node("Constant", [], [target], value=tensor))
    nodes.append(helper.make_node("Concat", ["means", "rest"], ["head"], axis=1))
    graph = helper.make_graph(nodes, "constant", given, made)
    opset = [helper.make_opsetid("", 17)]
    onnx.save(helper.make_model(graph, opset_imports=opset, ir_version=9), path)


@pytest.fixture
def pixie(parts, tmp_path, monkeypatch):
    """``pixie(turn, camera, change)``: an imported part that sees this body in every picture."""

    def install(
        turn=FACING, camera=(0.9, 0.05, 0.3), change=lambda answers: answers
    ) -> dict[str, np.ndarray]:
        answers = change(numbers(turn, camera))
        write = lambda folder: save_answers(folder / NETWORK, answers)  # noqa: E731
        examined = Examined("pixie", "always the same", write)
        monkeypatch.setattr(convert, "examine", lambda file, options: examined)
        (tmp_path / "pixie_model.tar").write_bytes(b"x")
        PIXIE.add(tmp_path / "pixie_model.tar", ImportOptions(replace=True))
        return answers

    return install


@pytest.fixture(scope="module")
def body(tmp_path_factory, smplx_arrays) -> SmplxBody:
    path = tmp_path_factory.mktemp("smplx") / "SMPLX_NEUTRAL.npz"
    np.savez(path, **smplx_arrays)
    return SmplxBody(path)


@pytest.fixture
def capture(tmp_path):
    """``capture(cameras, box)``: photos in which a red box is the subject."""

    def take(cameras: list[Camera], box=(150, 80, 250, 340)) -> Capture:
        left, top, right, bottom = box
        for index, camera in enumerate(cameras):
            rgba = np.zeros((camera.height, camera.width, 4), np.uint8)
            rgba[..., :3] = (90, 90, 90)
            rgba[top:bottom, left:right] = (200, 100, 50, 255)
            save_png(tmp_path / image_name(index), rgba)
        return Capture("toy", "box", "tiny", "key", tmp_path, tuple(cameras))

    return take


def camera(position, target=(0.0, 0.0, 0.0), focal_px: float = 500.0) -> Camera:
    K = np.array([[focal_px, 0, SIDE / 2], [0, focal_px, SIDE / 2], [0, 0, 1]])
    return Camera(K, look_at(position, target), SIDE, SIDE)


def view(capture: Capture, index: int = 0, centre=None) -> View:
    place = Place(np.zeros(3) if centre is None else np.array(centre), 0.9, 0.3, centre is not None)
    seen = capture.cameras[index]
    return View(index, seen, np.zeros((SIDE, SIDE)), 100.0, place)


def found(body: SmplxBody, capture: Capture, *views: View) -> dict[str, np.ndarray]:
    chosen = views or (view(capture),)
    return pixie_each_view(body, chosen, pixie_sees(chosen, capture), capture)


def pixies_own(body: SmplxBody, capture: Capture, answers: dict[str, np.ndarray]) -> np.ndarray:
    """(V, 2) pixels of the photo at which PIXIE's parallel camera sees the body's vertices."""
    rest = {
        "orientation": torch.eye(3)[None, :, :2],
        "translation": torch.zeros(1, 3),
        "pose": torch.zeros(1, 21, 3),
        "shape": torch.zeros(1, 10),
    }
    rest["pose"][0, 0] = torch.tensor(Rotation.from_matrix(HIP).as_rotvec())
    local = body.posed(rest).vertices[0].double().numpy()
    root = body.rest_root(np.zeros(10))
    scale, *shift = answers["body"][:3]
    placed = (local @ FACING.T + root)[:, :2] + shift
    window = crop_window(capture, 0)
    return [window.left, window.top] + (scale * placed + 1) / 2 * window.width


@pytest.mark.parametrize("tilt", [0.0, 0.3])
def test_from_afar_both_cameras_see_the_same_body(body, pixie, capture, tilt):
    """At 80 m rays are as good as parallel; at 3 m the body is where the same scale puts it."""
    answers = pixie()
    far = camera((10.0, 80 * np.sin(tilt), 80.0), focal_px=12_000.0)
    photos = capture([far])
    wanted = pixies_own(body, photos, answers)
    posed = body.posed(found(body, photos))
    pixels, depths = far.project(posed.vertices[0].double().numpy())
    assert np.abs(pixels - wanted).max() < 2.0
    assert np.ptp(pixels[:, 1]) > 30
    window = crop_window(photos, 0)
    assert depths.mean() == pytest.approx(2 * 12_000.0 / (0.9 * window.width), rel=0.02)


@pytest.mark.parametrize("mistake", ["left out", "mirrored", "exchanged"])
def test_a_camera_in_another_frame_is_seen(body, pixie, capture, monkeypatch, mistake):
    answers = pixie()
    turned = {
        "left out": np.eye(3),
        "mirrored": np.diag([1.0, -1.0, -1.0]),
        "exchanged": np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]]),
    }
    far = camera((10.0, 30.0, 80.0), focal_px=12_000.0)
    photos = capture([far])
    right = start.seen_by

    def wrong(seen, scale):
        own = right(seen, scale)
        turn = turned["left out"] if mistake == "left out" else own.turn @ turned[mistake]
        return start.Seen(turn, own.distance_m)

    monkeypatch.setattr(start, "seen_by", wrong)
    posed = body.posed(found(body, photos))
    pixels, _ = far.project(posed.vertices[0].double().numpy())
    # What is behind the camera has no pixels.
    pixels = np.nan_to_num(pixels, nan=1e6)
    assert np.abs(pixels - pixies_own(body, photos, answers)).max() > 10.0


def test_a_turn_of_the_camera_about_its_centre_changes_nothing(body, pixie, capture):
    """The subject moves over the picture; on the same ray at the same distance it is the same."""
    ahead = camera((0.0, 0.0, 3.0))
    angle = 0.15
    turned = ahead.turned(Rotation.from_euler("y", angle).as_matrix())
    offset = round(500 * np.tan(angle))
    pixie(camera=(0.9, 0.0, 0.0))
    first = found(body, capture([ahead], (150, 70, 250, 330)))
    seen = turned.project(np.zeros((1, 3)))[0][0, 0] - SIDE / 2
    box = (round(150 + np.sign(seen) * offset), 70, round(250 + np.sign(seen) * offset), 330)
    other = found(body, capture([turned], box))
    np.testing.assert_allclose(other["orientation"], first["orientation"], atol=3e-3)
    np.testing.assert_allclose(other["translation"], first["translation"], atol=0.05)


def test_views_all_round_agree_on_one_body(body, pixie, capture):
    """Each view's answer is that of one upright body; orientations and poses average to it."""
    around = np.radians([0, 120, 240])
    cameras = [camera((3 * np.sin(a), 0.4, 3 * np.cos(a))) for a in around]
    photos = capture(cameras, (150, 70, 250, 330))
    truth = Rotation.from_euler("XYZ", [0.1, 0.7, -0.1]).as_matrix()
    bodies = []
    for index in range(3):
        crop = crop_window(photos, index).camera(cameras[index])
        pixie(seen_by(crop, 0.9).turn.T @ truth, (0.9, 0.0, 0.0))
        bodies.append(found(body, photos, view(photos, index, (0.0, 0.0, 0.0))))
    together = {name: torch.cat([one[name] for one in bodies]) for name in bodies[0]}
    mean = average_of_columns(together)
    for name, values in average(together).items():
        torch.testing.assert_close(mean[name], values, atol=1e-5, rtol=0)
    np.testing.assert_allclose(mean["orientation"][0], truth[:, :2], atol=1e-5)
    np.testing.assert_allclose(mean["pose"][0, 0], Rotation.from_matrix(HIP).as_rotvec(), atol=1e-5)
    np.testing.assert_allclose(mean["pose"][0, [11, 14, 19, 20]], 0.0, atol=1e-5)
    spread = together["translation"] - together["translation"].mean(0)
    assert spread.abs().max() < 0.3


def test_a_known_distance_holds_and_keeps_the_direction(body, pixie, capture):
    pixie()
    photos = capture([camera((0.0, 0.0, 3.0))])
    free = found(body, photos)["translation"][0].numpy()
    held = found(body, photos, view(photos, 0, (0.0, 0.0, 0.5)))["translation"][0].numpy()
    own = photos.cameras[0].position
    directions = [(each - own) / np.linalg.norm(each - own) for each in (free, held)]
    assert directions[0] @ directions[1] > 0.9999
    assert np.linalg.norm(held - own) == pytest.approx(2.5, abs=0.6)
    assert abs(np.linalg.norm(free - own) - np.linalg.norm(held - own)) > 0.3


def test_shape_values_count_in_their_own_space_alone(body, pixie, capture, monkeypatch):
    pixie()
    photos = capture([camera((0.0, 0.0, 3.0))])
    assert not found(body, photos)["shape"].any()
    monkeypatch.setattr(body, "has_pixie_shape", True)
    np.testing.assert_allclose(found(body, photos)["shape"][0, 3:], 0.5)


def test_the_network_sees_the_subject_in_colour_over_black(pixie, capture, parts):
    pixie()
    photos = capture([camera((0.0, 0.0, 3.0))], (150, 120, 250, 280))
    session = open_session(PIXIE.find().file(NETWORK))
    means = start._regressed(session, photos, view(photos)).shape[:3]
    window = crop_window(photos, 0)
    assert window.width == pytest.approx(160 / 0.9, abs=1)
    share = 100 * 160 / window.width**2
    np.testing.assert_allclose(means, share * np.array([200, 100, 50]) / 255, rtol=0.02)


def test_a_body_of_no_size(body, pixie, capture):
    pixie(camera=(-0.1, 0.0, 0.0))
    with pytest.raises(MethodError, match="a body of no size.*above 0"):
        found(body, capture([camera((0.0, 0.0, 3.0))]))


def test_the_setting_and_what_it_needs(parts, pixie):
    with pytest.raises(HarnessError, match="'start' cannot be 'pixie' where.*'model' is 'anny'"):
        FitSettings(start="pixie")
    chosen = {"body.start": "pixie", "body.model": "smplx"}
    with pytest.raises(MissingPart, match="no part 'pixie'.*pixie_model.tar.*pixie.is.tue.mpg.de"):
        _ = ChosenMethod.of("jmbo8", chosen).info
    pixie()
    for name in ("body-front", "body-average", "jmbo8", "econ", "mexecon8"):
        info = ChosenMethod.of(name, chosen).info
        assert info.parameters["body"]["start"] == "pixie"
        assert ("first body", "always the same") in [(part.role, part.name) for part in info.parts]
        differing = {deviation.what for deviation in info.deviations}
        assert not {"body.start", "body.model", "first body of each view"} & differing
        default = {deviation.what for deviation in ChosenMethod.of(name, {}).info.deviations}
        assert "first body of each view" in default
        assert "body.start" not in default


FINGER = Rotation.from_rotvec([0.0, 0.2, 0.7]).as_matrix()


def with_face_and_hands(answers: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The same body that opens its mouth, smiles, and bends one finger of each hand alike."""
    head = answers["head"].copy()
    head[200:250], head[-3:] = 0.25, (0.3, 0.0, 0.0)
    hands = {}
    for side in ("left_hand", "right_hand"):
        six_numbers = answers[side].copy().reshape(16, 6)
        # Both hands are regressed as right ones.
        six_numbers[3] = six(FINGER)
        hands[side] = six_numbers.ravel()
    return {**answers, "head": head, **hands}


def test_a_fit_keeps_pixies_hands_and_jaw(body, pixie, capture, monkeypatch):
    """SMPL-X poses them as PIXIE says, and what is exported says it too."""
    pixie(change=with_face_and_hands)
    photos = capture([camera((0.0, 0.0, 3.0))])
    (seen,) = pixie_sees((view(photos),), photos)
    held = body.holding(held_values(body, seen))
    rest = found(held, photos)
    turns = held.posed(rest).turns[0].double().numpy()
    plain = body.posed(rest).turns[0].double().numpy()

    def local(turns: np.ndarray, joint: str, parent: str) -> np.ndarray:
        index = body.joint_names.index
        return turns[index(parent)].T @ turns[index(joint)]

    right = local(turns, "right_index3", "right_index2")
    np.testing.assert_allclose(right, FINGER, atol=1e-5)
    np.testing.assert_allclose(
        local(turns, "left_index3", "left_index2"), FINGER * _MIRRORED, atol=1e-5
    )
    jaw = local(turns, "jaw", "head")
    np.testing.assert_allclose(jaw, Rotation.from_euler("X", 0.3).as_matrix(), atol=1e-5)
    np.testing.assert_allclose(local(plain, "jaw", "head"), np.eye(3), atol=1e-6)
    exported = held.export(rest)
    np.testing.assert_allclose(exported["jaw_pose"], [[0.3, 0, 0]], atol=1e-6)
    assert np.abs(exported["left_hand_pose"] - exported["right_hand_pose"]).max() > 0.1
    assert not exported["expression"].any(), "its values are of another model"
    monkeypatch.setattr(body, "has_pixie_shape", True)
    np.testing.assert_allclose(held_values(body, seen)["expression"], 0.25, atol=1e-6)
    assert not body.export(rest)["jaw_pose"].any(), "the body itself stays at rest"


def test_pixies_own_model_has_pixies_values(tmp_path, smplx_arrays, body):
    """200 shape and 50 expression values, from the columns of the file that are theirs."""
    shapes = np.zeros((10475, 3, 400))
    shapes[:, 1, 150], shapes[:, 2, 340] = 0.01, 0.02
    np.savez(tmp_path / "SMPLX_NEUTRAL_2020.npz", **{**smplx_arrays, "shapedirs": shapes})
    wide = SmplxBody(tmp_path / "SMPLX_NEUTRAL_2020.npz")
    assert (wide.shape_prior.shape, body.shape_prior.shape) == ((2, 200), (2, 10))
    parameters = neutral(wide)
    parameters["shape"][0, 150] = 2.0
    held = wide.holding({"expression": np.eye(50)[40]})
    moved = held.posed(parameters).vertices - wide.posed(neutral(wide)).vertices
    # The pelvis moves along with all vertices and is put back to its place.
    np.testing.assert_allclose(moved.numpy(), 0.0, atol=1e-6)
    root = held.rest_root(parameters["shape"][0].numpy()) - wide.rest_root(np.zeros(200))
    np.testing.assert_allclose(root, [0.0, 0.02, 0.02], atol=1e-6)


def test_pixies_model_is_meant_where_it_is_imported(parts, tmp_path, smplx_arrays):
    first = {**smplx_arrays, "shapedirs": smplx_arrays["shapedirs"][:, :, :20]}
    np.savez(tmp_path / "model.npz", **first)
    SMPLX.add(tmp_path / "model.npz", ImportOptions(name="SMPLX_NEUTRAL"))
    assert named_model("", for_pixie=True) == ""
    SMPLX.add(tmp_path / "model.npz", ImportOptions(name="SMPLX_NEUTRAL_2020"))
    assert named_model("", for_pixie=True) == "SMPLX_NEUTRAL_2020"
    assert named_model("", for_pixie=False) == ""
    assert named_model("SMPLX_MALE", for_pixie=True) == "SMPLX_MALE"

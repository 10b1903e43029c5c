"""Networks from a file: what goes in, what comes out, what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from harness.core.errors import DataError, MethodError, MissingPart
from methods.normals import NormalChoice
from methods.normals.onnx_estimator import OnnxNormals

WITH_MASK = ("body_front", "body_back", "mask")


def pictures_of(mask: np.ndarray) -> tuple[np.ndarray, ...]:
    """A noisy photo of a mask, and noise for a body that reaches beyond it and ends within it."""
    rng = np.random.default_rng(0)
    body = rng.normal(size=(2, *mask.shape, 3))
    body /= np.linalg.norm(body, axis=-1, keepdims=True)
    body[:, :10] = 0.0
    return rng.random((*mask.shape, 3)) * mask[..., None], mask, body[0], body[1]


@pytest.fixture
def pictures():
    mask = np.zeros((40, 50))
    mask[5:30, 10:45] = 1.0
    return pictures_of(mask)


class Spy:
    """Stands before a session and keeps what it is fed."""

    def __init__(self, session) -> None:
        self.session, self.feeds = session, {}

    def __getattr__(self, name):
        return getattr(self.session, name)

    def run(self, outputs, feeds):
        self.feeds = feeds
        return self.session.run(outputs, feeds)


def spied(path) -> tuple[OnnxNormals, Spy]:
    network = OnnxNormals(path)
    network._session = Spy(network._session)
    return network, network._session


def test_maps_go_in_and_out_in_place(tmp_path, pictures, save_network):
    choice = NormalChoice("onnx", str(save_network(tmp_path / "n.onnx")))
    found = choice.estimator(None, {})(*pictures)  # type: ignore[arg-type]
    inside = pictures[1][..., None]
    np.testing.assert_allclose(found.front, pictures[2] * inside, atol=1e-6)
    np.testing.assert_allclose(found.back, pictures[3] * inside, atol=1e-6)
    assert found.front_error_deg is None
    assert (choice.part.name, choice.part.licence) == ("mirror 1", "Apache-2.0")
    assert len(choice.part.sha256) == 64


def test_the_photo_is_centred_and_the_background_is_the_network_s_own(
    tmp_path, pictures, save_network
):
    copies = {"front": "image", "back": "body_back"}
    path = save_network(tmp_path / "n.onnx", copies, body_background="0.25")
    found = OnnxNormals(path)(*pictures)
    inside = pictures[1] > 0
    photo = 2 * pictures[0][inside] - 1
    np.testing.assert_allclose(
        found.front[inside], photo / np.linalg.norm(photo, axis=1, keepdims=True), atol=1e-5
    )
    np.testing.assert_allclose(found.back[7, 20], np.full(3, 3**-0.5), atol=1e-6)


@pytest.mark.parametrize("window", ["", "mask"])
def test_outside_the_picture_there_is_no_subject_and_no_body(
    tmp_path, pictures, save_network, window
):
    path = save_network(
        tmp_path / "n.onnx", inputs=WITH_MASK, body_background="0.25", window=window
    )
    network, spy = spied(path)
    network(*pictures)
    assert {name: feed.shape for name, feed in spy.feeds.items()} == {
        "image": (1, 3, 64, 64 if not window else 96),
        "body_front": (1, 3, 64, 64 if not window else 96),
        "body_back": (1, 3, 64, 64 if not window else 96),
        "mask": (1, 1, 64, 64 if not window else 96),
    }
    beyond = np.s_[0, :, -8:]
    assert (spy.feeds["image"][beyond] == 0).all()
    assert (spy.feeds["mask"][beyond] == 0).all()
    assert (spy.feeds["body_front"][beyond] == 0.25).all()


def test_the_mask_is_fed_as_nought_and_one_where_it_is_wanted(tmp_path, pictures, save_network):
    soft = pictures[1] * 0.7
    soft[0, :10] = 0.3
    copies = {"front": "mask", "back": "body_back"}
    network, spy = spied(save_network(tmp_path / "n.onnx", copies, inputs=WITH_MASK))
    front = network(pictures[0], soft, *pictures[2:]).front
    np.testing.assert_array_equal(spy.feeds["mask"][0, 0, :40, :50], pictures[1])
    np.testing.assert_allclose(front[pictures[1] > 0], 3**-0.5, atol=1e-6)
    assert (front[pictures[1] == 0] == 0).all()
    network, spy = spied(save_network(tmp_path / "without.onnx"))
    network(*pictures)
    assert "mask" not in spy.feeds


@pytest.mark.parametrize(
    ("rows", "columns"),
    [
        (slice(60, 130), slice(70, 90)),  # in the middle
        (slice(0, 20), slice(100, 133)),  # in a corner
        (slice(0, 201), slice(0, 133)),  # everywhere
        (slice(200, 201), slice(0, 1)),  # one pixel
    ],
)
def test_a_network_without_neighbours_does_not_mind_its_window(
    tmp_path, save_network, rows, columns
):
    mask = np.zeros((201, 133))
    mask[rows, columns] = 1.0
    pictures = pictures_of(mask)
    copies = {"front": "image", "back": "body_back"}
    whole = OnnxNormals(save_network(tmp_path / "whole.onnx", copies))(*pictures)
    network, spy = spied(save_network(tmp_path / "window.onnx", copies, window="mask"))
    windowed = network(*pictures)
    height, width = spy.feeds["image"].shape[2:]
    assert height == -(-(np.ptp(np.nonzero(mask)[0]) + 33) // 32) * 32
    assert width == -(-(np.ptp(np.nonzero(mask)[1]) + 33) // 32) * 32
    for alone, part in ((whole.front, windowed.front), (whole.back, windowed.back)):
        np.testing.assert_array_equal(part, alone)
        assert part.shape == (201, 133, 3)
        assert (part[mask == 0] == 0).all()
    np.testing.assert_allclose(np.linalg.norm(windowed.front[mask > 0], axis=1), 1.0)


def test_where_the_subject_stands_does_not_matter_to_a_window(tmp_path, pictures, save_network):
    network, spy = spied(save_network(tmp_path / "n.onnx", inputs=WITH_MASK, window="mask"))
    network(*pictures)
    before = spy.feeds
    network(*(np.pad(each, ((40, 7), (3, 90)) + ((0, 0),) * (each.ndim - 2)) for each in pictures))
    for name in ("image", "mask"):
        np.testing.assert_array_equal(spy.feeds[name], before[name])


def test_a_trial_is_on_a_size_that_halves_five_times_and_not_six(tmp_path, save_network):
    network, spy = spied(save_network(tmp_path / "n.onnx", window="mask"))
    network.trial()
    assert spy.feeds["image"].shape == (1, 3, 96, 96)


@pytest.mark.parametrize("window", ["", "mask"])
def test_no_subject_no_normals(tmp_path, pictures, save_network, window):
    network = OnnxNormals(save_network(tmp_path / "n.onnx", window=window))
    answers = network(pictures[0], 0 * pictures[1], *pictures[2:])
    assert not answers.front.any()
    assert not answers.back.any()


def test_all_cores_are_used(tmp_path, save_network, monkeypatch):
    monkeypatch.setattr("os.sched_getaffinity", lambda _: {3, 5, 6})
    options = OnnxNormals(save_network(tmp_path / "n.onnx"))._session.get_session_options()
    assert options.intra_op_num_threads == 3


def test_what_is_no_normal_estimator_is_refused(tmp_path, save_network):
    with pytest.raises(MissingPart, match="no network at"):
        _ = NormalChoice("onnx", str(tmp_path / "none.onnx")).part
    (tmp_path / "text.onnx").write_text("not a network")
    with pytest.raises(DataError, match="not a network that can be run"):
        OnnxNormals(tmp_path / "text.onnx")
    path = save_network(tmp_path / "in.onnx", {"front": "a", "back": "b"}, inputs=("a", "b"))
    with pytest.raises(DataError, match="other inputs"):
        OnnxNormals(path)
    with pytest.raises(DataError, match="other outputs"):
        OnnxNormals(save_network(tmp_path / "out.onnx", {"front": "body_front"}))


@pytest.mark.parametrize(
    ("about", "message"),
    [
        ({"licence": ""}, "does not say what it is"),
        ({"body_background": "grey"}, "not right.*a number.*grey"),
        ({"window": "door"}, "a window that is not known.*door"),
        ({"side_px": "wide"}, "not right.*a side of the picture.*wide"),
        ({"side_px": "99999"}, "not right.*up to 4096 pixels.*99999"),
    ],
)
def test_metadata_that_are_not_right(tmp_path, save_network, about, message):
    with pytest.raises(DataError, match=message):
        OnnxNormals(save_network(tmp_path / "n.onnx", **about))


def test_a_network_of_one_size_says_so(tmp_path, pictures, save_network):
    network = OnnxNormals(save_network(tmp_path / "n.onnx", side=96))
    network.trial()
    with pytest.raises(MethodError, match="mirror 1 cannot work on 64 x 64 pixels"):
        network(*pictures)


def test_a_trial_finds_networks_that_do_not_work(tmp_path, save_network):
    OnnxNormals(save_network(tmp_path / "good.onnx", inputs=WITH_MASK, window="mask")).trial()
    fixed = OnnxNormals(save_network(tmp_path / "fixed.onnx", side=512, window="mask"))
    with pytest.raises(DataError, match="cannot work on 288 x 288"):
        fixed.trial()

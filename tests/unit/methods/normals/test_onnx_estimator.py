"""Networks from a file: what goes in, what comes out, what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from harness.core.errors import DataError, MissingPart
from methods.normals import NormalChoice
from methods.normals.onnx_estimator import OnnxNormals

onnx = pytest.importorskip("onnx")
pytest.importorskip("onnxruntime")

ABOUT = {"name": "mirror 1", "licence": "Apache-2.0"}


def save_network(
    path: Path, pairs: dict[str, str], about: dict[str, str], names=("body_front", "body_back")
) -> Path:
    """A network whose outputs are copies: ``pairs`` is output by input."""
    helper, kind = onnx.helper, onnx.TensorProto.FLOAT
    shape = [1, 3, "height", "width"]
    inputs = [helper.make_tensor_value_info(n, kind, shape) for n in ("image", *names)]
    outputs = [helper.make_tensor_value_info(n, kind, shape) for n in pairs]
    nodes = [helper.make_node("Identity", [source], [name]) for name, source in pairs.items()]
    graph = helper.make_graph(nodes, "copies", inputs, outputs)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    for key, value in about.items():
        model.metadata_props.add(key=key, value=value)
    path.write_bytes(model.SerializeToString())
    return path


@pytest.fixture
def pictures():
    rng = np.random.default_rng(0)
    mask = np.zeros((40, 50))
    mask[5:30, 10:45] = 1.0
    body = rng.normal(size=(2, 40, 50, 3))
    body /= np.linalg.norm(body, axis=-1, keepdims=True)
    body[:, :10] = 0.0
    return rng.random((40, 50, 3)) * mask[..., None], mask, body[0], body[1]


def test_maps_go_in_and_out_in_place(tmp_path, pictures):
    path = save_network(tmp_path / "n.onnx", {"front": "body_front", "back": "body_back"}, ABOUT)
    choice = NormalChoice("onnx", str(path))
    front, back = choice.estimator(None, {})(*pictures)  # type: ignore[arg-type]
    inside = pictures[1][..., None]
    np.testing.assert_allclose(front, pictures[2] * inside, atol=1e-6)
    np.testing.assert_allclose(back, pictures[3] * inside, atol=1e-6)
    assert (choice.part.name, choice.part.licence) == ("mirror 1", "Apache-2.0")
    assert len(choice.part.sha256) == 64


def test_the_photo_is_centred_and_the_background_is_the_network_s_own(tmp_path, pictures):
    about = {**ABOUT, "body_background": "0.25"}
    path = save_network(tmp_path / "n.onnx", {"front": "image", "back": "body_back"}, about)
    front, back = OnnxNormals(path)(*pictures)
    inside = pictures[1] > 0
    photo = 2 * pictures[0][inside] - 1
    np.testing.assert_allclose(
        front[inside], photo / np.linalg.norm(photo, axis=1, keepdims=True), atol=1e-5
    )
    np.testing.assert_allclose(back[7, 20], np.full(3, 3**-0.5), atol=1e-6)


def test_what_is_no_normal_estimator_is_refused(tmp_path):
    both = {"front": "body_front", "back": "body_back"}
    with pytest.raises(MissingPart, match="no network at"):
        _ = NormalChoice("onnx", str(tmp_path / "none.onnx")).part
    (tmp_path / "text.onnx").write_text("not a network")
    with pytest.raises(DataError, match="not a network that can be run"):
        OnnxNormals(tmp_path / "text.onnx")
    path = save_network(tmp_path / "in.onnx", {"front": "a", "back": "b"}, ABOUT, names=("a", "b"))
    with pytest.raises(DataError, match="other inputs"):
        OnnxNormals(path)
    with pytest.raises(DataError, match="other outputs"):
        OnnxNormals(save_network(tmp_path / "out.onnx", {"front": "body_front"}, ABOUT))
    with pytest.raises(DataError, match="does not say what it is"):
        OnnxNormals(save_network(tmp_path / "who.onnx", both, {"name": "x"}))

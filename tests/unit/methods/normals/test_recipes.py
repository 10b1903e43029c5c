"""A network that sees photos alone becomes an estimator, whichever way its axes point."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from harness.core.errors import DataError, HarnessError
from harness.geometry.raycast import Raycaster
from methods.normals import NormalChoice, working_view
from methods.normals.estimators import NETWORKS, RECIPES, prepared
from methods.parts.kind import ImportOptions

onnx = pytest.importorskip("onnx")


def save_stand_in(
    path: Path, signs: tuple[float, float, float] = (1, 1, 1), side: int = 512, opset: int = 17
) -> Path:
    """Like DAViD's: one BGR picture in [0, 1]. It reads normals from their usual colours."""
    helper, real = onnx.helper, onnx.TensorProto.FLOAT
    given = helper.make_tensor_value_info("input", real, [1, 3, side, side])
    made = helper.make_tensor_value_info("output", real, [1, 3, side, side])
    kernel = np.zeros((3, 3, 1, 1), np.float32)
    for axis, sign in enumerate(signs):
        kernel[axis, 2 - axis] = 2 * sign
    weights = [
        onnx.numpy_helper.from_array(kernel, "kernel"),
        onnx.numpy_helper.from_array(-np.float32(signs), "bias"),
    ]
    node = helper.make_node("Conv", ["input", "kernel", "bias"], ["output"])
    graph = helper.make_graph([node], "stand-in", [given], [made], weights)
    ids = [helper.make_opsetid("", opset)]
    onnx.save(helper.make_model(graph, opset_imports=ids, ir_version=8), path)
    return path


@pytest.mark.parametrize("signs", [(1, 1, 1), (1, -1, -1), (-1, 1, 1), (-1, -1, -1)])
def test_the_front_is_the_networks_and_the_back_the_bodys(
    places, sphere, photograph, tmp_path, signs
):
    file = save_stand_in(tmp_path / "david.onnx", signs)
    part = NETWORKS.add(file, ImportOptions(recipe="david"))
    assert (part.name, part.licence) == ("david", "MIT")
    assert "surface.normals_model=david" in NETWORKS.usage(part)
    view = working_view(photograph(sphere(0.3)), 0, 128)
    truth = Raycaster(sphere(0.3)).normals(view.camera, "near")
    body = Raycaster(sphere(0.25))
    front, back = (body.normals(view.camera, side) for side in ("near", "far"))
    colours = np.where(view.mask[..., None], truth / 2 + 0.5, 0.0)
    estimator = NormalChoice("onnx", "david").estimator(view.camera, {})
    answer = estimator(colours, view.mask.astype(float), front, back)
    found, far = answer.front, answer.back
    inner = np.abs(front).sum(2) > 0
    cosine = (found[inner] * truth[inner]).sum(1)
    assert np.degrees(np.arccos(cosine.clip(-1, 1))).max() < 1.0
    np.testing.assert_allclose(far[inner], back[inner], atol=1e-6)


def test_other_networks_are_refused(places, save_network, tmp_path):
    own = save_network(tmp_path / "own.onnx")
    with pytest.raises(DataError, match=r"another network than the recipe.*\(1, 3, 512, 512\)"):
        NETWORKS.add(own, ImportOptions(recipe="david"))
    with pytest.raises(DataError, match="another network"):
        NETWORKS.add(save_stand_in(tmp_path / "s.onnx", side=256), ImportOptions(recipe="david"))
    with pytest.raises(DataError, match="too old a version.*13 or later; got 11"):
        NETWORKS.add(save_stand_in(tmp_path / "o.onnx", opset=11), ImportOptions(recipe="david"))
    (tmp_path / "page.onnx").write_text("<html>")
    with pytest.raises(DataError, match="not a network"):
        NETWORKS.add(tmp_path / "page.onnx", ImportOptions(recipe="david"))
    with pytest.raises(HarnessError, match="unknown recipe 'dav'.*Did you mean 'david'"):
        NETWORKS.add(own, ImportOptions(recipe="dav"))
    with pytest.raises(DataError, match="no file at"):
        NETWORKS.add(tmp_path / "none.onnx", ImportOptions(recipe="david"))
    assert not (places / "own").exists()


def test_every_recipe_says_what_it_makes(tmp_path):
    for name, recipe in RECIPES.items():
        assert recipe.about["name"]
        assert recipe.about["licence"]
        prepared(save_stand_in(tmp_path / "s.onnx", side=recipe.side_px), name, tmp_path / "o.onnx")

"""Networks of others that mark a person: imported, checked, shown a photo as they want it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from harness.core.errors import DataError, HarnessError, MethodError, MissingPart
from methods import masks as module
from methods.masks import MASK_NETWORKS, MASK_RECIPES, MaskNetwork, imported_network
from methods.parts.kind import ImportOptions

onnx = pytest.importorskip("onnx")


@pytest.fixture(autouse=True)
def places(tmp_path, monkeypatch) -> Path:
    monkeypatch.setenv("HARNESS_PARTS", str(tmp_path / "parts"))
    return tmp_path


def written(path: Path, side: int | str = "side", channels: int = 1, inputs: int = 1) -> Path:
    """A network whose answer is the picture's first channels, as it is shown to it."""
    helper, real = onnx.helper, onnx.TensorProto.FLOAT
    take = helper.make_tensor("take", onnx.TensorProto.INT64, [channels], list(range(channels)))
    graph = helper.make_graph(
        [helper.make_node("Gather", ["image", "take"], ["mask"], axis=1)],
        "first channels",
        [helper.make_tensor_value_info(name, real, [1, 3, side, side])
         for name in ("image", "other")[:inputs]],
        [helper.make_tensor_value_info("mask", real, [1, channels, side, side])],
        [take],
    )  # fmt: skip
    opset = [helper.make_opsetid("", 17)]
    onnx.save(helper.make_model(graph, opset_imports=opset, ir_version=9), path)
    return path


def photo() -> tuple[np.ndarray, np.ndarray]:
    """A red person before black, and where the person is."""
    inside = np.zeros((120, 80), dtype=bool)
    inside[20:110, 25:55] = True
    return np.where(inside[..., None], (200, 0, 0), (0, 0, 0)).astype(np.uint8), inside


def test_a_recipe_says_how_a_photo_is_shown_and_the_answer_is_read(tmp_path):
    """The first channel comes back: its colours, less the mean, over the deviation."""
    rgb, inside = photo()
    path = written(tmp_path / "n.onnx")
    stretched = MaskNetwork(path, MASK_RECIPES["u2net"], "n")(rgb)
    assert stretched.shape == inside.shape
    assert np.abs((stretched >= 0.5) ^ inside).mean() < 0.02
    logits = MaskNetwork(path, MASK_RECIPES["birefnet"], "n")(rgb)
    red, black = (200 / 255 - 0.485) / 0.229, -0.485 / 0.229
    middle, corner = logits[60, 40], logits[3, 3]
    assert middle == pytest.approx(1 / (1 + np.exp(-red)), abs=1e-3)
    assert corner == pytest.approx(1 / (1 + np.exp(-black)), abs=1e-3)


def test_colours_are_taken_of_the_brightest_where_the_recipe_says_so(tmp_path):
    rgb, _ = photo()
    path = written(tmp_path / "n.onnx")
    recipe = replace(MASK_RECIPES["isnet"], logits=True)
    bright = MaskNetwork(path, recipe, "n")(rgb)[60, 40]
    plain = MaskNetwork(path, replace(recipe, of_brightest=False), "n")(rgb)[60, 40]
    assert bright == pytest.approx(1 / (1 + np.exp(-0.5)), abs=1e-3)
    assert plain == pytest.approx(1 / (1 + np.exp(-(200 / 255 - 0.5))), abs=1e-3)


def test_an_imported_network_is_found_and_named(tmp_path):
    part = MASK_NETWORKS.add(written(tmp_path / "n.onnx"), ImportOptions(recipe="u2net"))
    assert (part.name, part.title) == ("u2net", "U2-Net (Apache-2.0)")
    assert MASK_NETWORKS.usage(part) == "harness capture import DIR --masks-by u2net"
    found = imported_network("u2net")
    rgb, inside = photo()
    assert found.title == part.title
    assert np.abs((found(rgb) >= 0.5) ^ inside).mean() < 0.02


def test_a_photo_that_is_the_same_everywhere_shows_nobody(tmp_path):
    network = MaskNetwork(written(tmp_path / "n.onnx"), MASK_RECIPES["u2net"], "n")
    assert not network(np.full((20, 30, 3), 90, np.uint8)).any()


def test_without_the_network_the_command_is_said():
    with pytest.raises(MissingPart, match="masks-onnx") as told:
        imported_network("u2net")
    assert "harness parts import masks-onnx" in str(told.value)


@pytest.mark.parametrize(
    ("made", "recipe", "kind", "said"),
    [
        ({"side": 64}, "u2net", DataError, "320 pixels"),
        ({"inputs": 2}, "u2net", DataError, "one input"),
        ({"channels": 2}, "u2net", DataError, "320 x 320 finite numbers"),
        ({}, "", HarnessError, "--recipe"),
        ({}, "u2nett", HarnessError, "u2net"),
    ],
)
def test_what_is_no_such_network_is_refused_and_nothing_is_kept(tmp_path, made, recipe, kind, said):
    path = written(tmp_path / "n.onnx", **made)
    with pytest.raises(kind, match=said):
        MASK_NETWORKS.add(path, ImportOptions(recipe=recipe))
    assert list(MASK_NETWORKS.installed()) == []


def test_an_answer_that_is_no_number_is_told(tmp_path, monkeypatch):
    network = MaskNetwork(written(tmp_path / "n.onnx"), MASK_RECIPES["u2net"], "n")
    monkeypatch.setattr(module, "answers", lambda *_: [np.full((1, 1, 320, 320), np.nan)])
    with pytest.raises(MethodError, match="does not answer with the mask"):
        network(photo()[0])


def test_a_network_in_two_files_is_refused(tmp_path):
    model = onnx.load(written(tmp_path / "whole.onnx", side=320))
    model.graph.initializer[0].CopyFrom(onnx.numpy_helper.from_array(np.array([0]), "take"))
    onnx.save(model, tmp_path / "n.onnx", save_as_external_data=True, location="n.onnx.data",
              size_threshold=0)  # fmt: skip
    assert (tmp_path / "n.onnx.data").is_file()
    with pytest.raises(DataError, match="cannot be used without other files beside it"):
        MASK_NETWORKS.add(tmp_path / "n.onnx", ImportOptions(recipe="u2net"))
    assert list(MASK_NETWORKS.installed()) == []

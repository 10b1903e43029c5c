"""ECON's networks as an estimator: what they are shown, and what becomes of their answers."""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np
import pytest

from harness.core.errors import HarnessError, MethodError, MissingPart
from harness.core.files.hashing import file_sha256
from harness.geometry.raycast import Raycaster
from harness.run.method_choice import ChosenMethod
from methods.normals import NormalChoice, view_maps, working_view
from methods.normals import econ_network as convert
from methods.normals.econ_network import NormalGenerator
from methods.normals.estimators import BACKGROUND, SIDE_PX, econ_normals
from methods.parts.conversion import bare, shapes_of
from methods.parts.converted import ECON_NORMALS, FILES
from methods.parts.kind import ImportOptions
from methods.parts.store import Examined

WIDTH = 4


@pytest.fixture
def copies(parts, tmp_path, monkeypatch):
    """``copies(netF="image", netB="body")``: an imported part whose networks copy an input."""
    onnx = pytest.importorskip("onnx")

    def install(**sources: str) -> None:
        def write(folder: Path) -> None:
            helper, real = onnx.helper, onnx.TensorProto.FLOAT
            size = [1, 3, SIDE_PX, SIDE_PX]
            for name, file in FILES.items():
                given = [helper.make_tensor_value_info(each, real, size)
                         for each in ("image", "body")]  # fmt: skip
                made = [helper.make_tensor_value_info("normals", real, size)]
                node = helper.make_node("Identity", [sources[name]], ["normals"])
                graph = helper.make_graph([node], "copy", given, made)
                opset = [helper.make_opsetid("", 17)]
                model = helper.make_model(graph, opset_imports=opset, ir_version=9)
                onnx.save(model, folder / file)

        examined = Examined("econ-normal", "copies", write)
        monkeypatch.setattr(convert, "examine", lambda file, options: examined)
        (tmp_path / "normal.ckpt").write_bytes(b"x")
        ECON_NORMALS.add(tmp_path / "normal.ckpt", ImportOptions(replace=True))

    return install


def scene(side: int = SIDE_PX) -> tuple[np.ndarray, ...]:
    """Photo, mask and body normals; the body is smaller than the mask."""
    random = np.random.default_rng(0)
    mask = np.zeros((side, side))
    mask[side // 8 : -side // 8, side // 4 : -side // 4] = 1.0
    rgb = random.uniform(0.2, 0.9, (side, side, 3)) * mask[..., None]
    body = np.zeros((side, side, 3))
    inner = slice(side // 4, -side // 4), slice(side // 3, -side // 3)
    body[inner] = np.array([0.6, 0.0, 0.8])
    return rgb, mask, body, body * (1, 1, -1)


def test_each_network_is_shown_its_own_side_and_the_grey_behind_it(copies):
    copies(netF="body", netB="body")
    rgb, mask, front, back = scene()
    found = econ_normals()(rgb, mask, front, back)
    there = np.abs(front).sum(2) > 0
    for made, body in zip((found.front, found.back), (front, back), strict=True):
        np.testing.assert_allclose(made[there], body[there], atol=1e-6)
        grey = np.full(3, 1 / np.sqrt(3))
        around = (mask > 0) & ~there
        np.testing.assert_allclose(made[around], np.tile(grey, (around.sum(), 1)), atol=1e-6)
        assert (made[mask == 0] == 0).all()
    assert pytest.approx(0.00392, abs=1e-5) == BACKGROUND


def test_both_are_shown_the_photo_between_minus_one_and_one(copies):
    copies(netF="image", netB="image")
    rgb, mask, front, back = scene()
    found = econ_normals()(rgb, mask, front, back)
    shown = 2 * rgb - 1
    wanted = shown / np.linalg.norm(shown, axis=2, keepdims=True) * mask[..., None]
    for made in (found.front, found.back):
        np.testing.assert_allclose(made, wanted, atol=1e-5)


@pytest.mark.parametrize("side", [128, 640])
def test_another_size_is_resampled_there_and_back(copies, side):
    copies(netF="body", netB="body")
    rgb, mask, front, back = scene(side)
    made = econ_normals()(rgb, mask, front, back).front
    assert made.shape == front.shape
    middle = slice(side // 4 + 6, -side // 4 - 6), slice(side // 3 + 6, -side // 3 - 6)
    np.testing.assert_allclose(made[middle], front[middle], atol=1e-5)
    assert np.abs(np.linalg.norm(made[mask > 0], axis=1) - 1).max() < 1e-9


def test_a_picture_that_is_not_square(copies):
    copies(netF="body", netB="body")
    rgb, mask, front, back = (each[:-16] for each in scene(64))
    with pytest.raises(MethodError, match="square pictures.*64 x 48"):
        econ_normals()(rgb, mask, front, back)


def test_a_reimported_part_is_loaded_anew(copies):
    copies(netF="body", netB="body")
    first = econ_normals()
    assert econ_normals() is first
    copies(netF="image", netB="image")
    assert econ_normals() is not first


def test_without_an_import_the_way_to_it_is_told(parts):
    with pytest.raises(MissingPart, match=r"no part 'econ-normal'.*normal.ckpt.*import econ-norm"):
        _ = NormalChoice("econ").part
    with pytest.raises(MissingPart, match="icon.is.tue.mpg.de"):
        _ = ChosenMethod.of("econ", {"surface.normals": "econ"}).info
    with pytest.raises(HarnessError, match="do not go together"):
        NormalChoice("econ", "mine")


def test_a_small_checkpoint_estimates_normals_of_a_view(
    parts, fill, save_checkpoint, tmp_path, monkeypatch, sphere, photograph
):
    """The whole way: checkpoint, import, estimator, maps of a view, record."""
    monkeypatch.setattr(convert, "examine", functools.partial(convert.examine, width=WIDTH))
    shapes = {}
    for name in FILES:
        shapes |= shapes_of(bare(NormalGenerator, width=WIDTH), f"netG.{name}.")
    path = save_checkpoint(tmp_path / "normal.ckpt", fill(shapes), "state_dict")
    imported = ECON_NORMALS.add(path, ImportOptions())
    assert imported.source_sha256 == file_sha256(path)
    choice = NormalChoice("econ")
    assert (choice.part.name, choice.part.sha256) == ("ECON netF and netB", imported.sha256)
    assert "non-commercial" in choice.part.licence
    view = working_view(photograph(sphere(0.3)), 0, SIDE_PX)
    maps = view_maps(view, Raycaster(sphere(0.28)), choice.estimator(view.camera, {}))
    for made in (maps.front, maps.back):
        np.testing.assert_allclose(np.linalg.norm(made[view.mask], axis=1), 1.0)
        assert (made[~view.mask] == 0).all()
    assert np.abs(maps.front - maps.back).max() > 0.1


def test_settings_as_published_are_no_deviation(copies):
    copies(netF="body", netB="body")
    chosen = {"surface.normals": "econ", "body.normals": "econ"}
    listed = {name: {each.what for each in ChosenMethod.of(name, chosen).info.deviations}
              for name in ("econ", "mexecon8")}  # fmt: skip
    for found in listed.values():
        assert not {"surface.normals", "body.normals", "normals"} & found
    info = ChosenMethod.of("econ", chosen).info
    assert [part.name for part in info.parts if part.role == "normal estimator"] == ["copies"]
    default = {each.what for each in ChosenMethod.of("econ", {}).info.deviations}
    assert {"surface.normals", "body.normals", "normals"} <= default

"""Depth Anything 3 and MapAnything through packages with their real signatures."""

from __future__ import annotations

import stat
import sys
from pathlib import Path

import numpy as np
import pytest

from harness.core.errors import DataError, HarnessError, MethodError, MissingPart
from harness.geometry.photo import open_photo
from harness.geometry.raycast import Raycaster
from harness.geometry.surface import SurfaceIndex
from harness.run.method_choice import chosen_methods
from methods.feedforward.parts import DA3, MAPANYTHING, NetworkPart
from methods.from_points.feedforward import da3_8, mapanything8
from methods.points.cloud import Frame, fitted_frame
from methods.points.method import PointsMethod
from tests.unit.methods.points.conftest import ball, capture, context  # noqa: F401

FAST = {"mesh.depth": "6", "mesh.cell_m": "0.008"}

#: Signatures as in depth_anything_3/api.py; the depth of the cameras' own frame comes from a file.
DA3_PACKAGE = """
import os
import numpy as np
from dataclasses import dataclass


@dataclass
class Prediction:
    depth: np.ndarray
    conf: np.ndarray
    extrinsics: np.ndarray
    intrinsics: np.ndarray


class DepthAnything3:
    @classmethod
    def from_pretrained(cls, folder):
        assert os.path.isfile(os.path.join(folder, "config.json"))
        return cls()

    def to(self, device):
        return self

    def eval(self):
        return self

    def inference(self, image, extrinsics=None, intrinsics=None, align_to_input_ext_scale=True,
                  infer_gs=False, render_exts=None, render_ixts=None, render_hw=None,
                  process_res=504, process_res_method="upper_bound_resize", export_dir=None,
                  export_format="mini_npz", export_feat_layers=None):
        golden = np.load(os.environ["FAKE_KIN"])
        assert process_res_method == "upper_bound_resize" and align_to_input_ext_scale
        assert all(each.dtype == np.uint8 and each.shape[2] == 3 for each in image)
        height, width = golden["depth"].shape[1:]
        if extrinsics is None:
            own = golden["extrinsics"], golden["intrinsics"]
            return Prediction(golden["own_depth"], golden["conf"], *own)
        assert extrinsics.shape == (len(image), 4, 4) and intrinsics.shape == (len(image), 3, 3)
        scale = np.array([width / image[0].shape[1], height / image[0].shape[0], 1])
        moved = extrinsics[:, :3].copy()
        moved[:, :, 3] += 0.5 if os.environ.get("FAKE_KIN_FALLS_BACK") else 0.0
        return Prediction(golden["depth"], golden["conf"], moved, scale[None, :, None] * intrinsics)
"""
MAPANYTHING_PACKAGE = """
import os
import numpy as np
import torch


class MapAnything:
    @classmethod
    def from_pretrained(cls, folder):
        assert os.path.isfile(os.path.join(folder, "config.json"))
        return cls()

    def to(self, device):
        return self

    def eval(self):
        return self

    def infer(self, views, memory_efficient_inference=True, minibatch_size=None, use_amp=True,
              amp_dtype="bf16", apply_mask=True, mask_edges=True, apply_confidence_mask=False,
              confidence_percentile=10):
        assert not apply_mask and not mask_edges and not apply_confidence_mask
        golden = np.load(os.environ["FAKE_KIN"])
        found = []
        for number, view in enumerate(views):
            assert view["img"].shape[:2] == (1, 3) and view["data_norm_type"] == ["dinov2"]
            white = (1 - torch.tensor((0.485, 0.456, 0.406))) / torch.tensor((0.229, 0.224, 0.225))
            assert torch.allclose(view["img"][0, :, 0, 0], white, atol=1e-5), "normalised otherwise"
            given = "camera_poses" in view
            assert not given or view["is_metric_scale"].tolist() == [True]
            if given:
                assert np.allclose(view["camera_poses"][0], golden["given"][number], atol=1e-5)
            depth = golden["depth" if given else "own_depth"][number]
            pose = np.eye(4)
            pose[:3] = golden["extrinsics"][number]
            found.append({
                "depth_z": torch.from_numpy(depth)[None, ..., None],
                "conf": torch.from_numpy(golden["conf"][number])[None],
                "intrinsics": torch.from_numpy(golden["intrinsics"][number])[None],
                "camera_poses": torch.from_numpy(np.linalg.inv(pose))[None],
            })
        return found
"""


@pytest.fixture
def parts_folder(tmp_path, monkeypatch) -> Path:
    monkeypatch.setenv("HARNESS_PARTS", str(tmp_path / "parts"))
    return tmp_path / "parts"


@pytest.fixture(scope="module")
def python(tmp_path_factory) -> Path:
    """One for all tests: what it has is asked once a process, which takes a second."""
    folder = tmp_path_factory.mktemp("interpreter")
    site = folder / "site"
    for package, module, source in (
        ("depth_anything_3", "api", DA3_PACKAGE),
        ("mapanything", "models", MAPANYTHING_PACKAGE),
    ):
        (site / package).mkdir(parents=True)
        (site / package / "__init__.py").write_text("")
        (site / package / f"{module}.py").write_text(source)
    program = folder / "python"
    program.write_text(f'#!/bin/sh\nPYTHONPATH={site} exec {sys.executable} "$@"\n')
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    return program


@pytest.fixture
def snapshot(tmp_path) -> Path:
    folder = tmp_path / "snapshot"
    folder.mkdir()
    (folder / "config.json").write_text("{}")
    (folder / "model.safetensors").write_bytes(b"weights")
    return folder


def answers(capture, ball, frames: list[Frame], path: Path) -> None:  # noqa: F811
    """Depth of the sphere on the pixels of frames, and in an own world of a tenth of the size."""
    caster = Raycaster(ball)
    said = {
        name: [] for name in ("depth", "own_depth", "conf", "extrinsics", "intrinsics", "given")
    }
    for view, frame in enumerate(frames):
        camera = frame.camera(open_photo(capture, view).camera)
        depth = np.nan_to_num(caster.depth(camera), nan=9.0).astype(np.float32)
        own = camera.world_to_camera[:3].copy()
        own[:, 3] *= 0.1
        for name, value in (
            ("depth", depth), ("own_depth", 0.1 * depth), ("conf", np.ones_like(depth)),
            ("extrinsics", own), ("intrinsics", camera.K), ("given", camera.camera_to_world),
        ):  # fmt: skip
            said[name].append(value)
    np.savez(path, **said)


KIN: dict[str, tuple[PointsMethod, NetworkPart]] = {
    "da3-8": (da3_8, DA3),
    "mapanything8": (mapanything8, MAPANYTHING),
}


@pytest.fixture
def told(capture, ball, tmp_path, monkeypatch):  # noqa: F811
    def make(name: str) -> None:
        photos = [open_photo(capture, view) for view in range(8)]
        if name == "da3-8":
            frames = [Frame.whole(photo.camera.size, (280, 504)) for photo in photos]
        else:
            frames = [fitted_frame(photo.camera.size, 518, 14, "fit") for photo in photos]
        answers(capture, ball, frames, tmp_path / "kin.npz")
        monkeypatch.setenv("FAKE_KIN", str(tmp_path / "kin.npz"))

    return make


@pytest.mark.nightly
@pytest.mark.parametrize("mode", ["native_posed", "sim3_cameras"])
@pytest.mark.parametrize("name", KIN)
def test_a_perfect_network_gives_the_sphere(
    name, mode, parts_folder, python, snapshot, told, capture, context, ball  # noqa: F811
):  # fmt: skip
    method, part = KIN[name]
    part.add(snapshot, python)
    told(name)
    result = method.configured({**FAST, "align.mode": mode}).reconstruct(capture, context)
    seen = np.abs(result.mesh.vertices[:, 1] - ball.bounds.mean(axis=0)[1]) < 0.35
    assert SurfaceIndex(ball).closest(result.mesh.vertices[seen])[1].mean() < 0.002
    if mode == "sim3_cameras":
        assert result.details["alignment"]["scale"] == pytest.approx(10.0, rel=1e-3)
    network, package = method.info.parts
    assert network.licence == package.licence == "Apache-2.0"


@pytest.mark.nightly
def test_cameras_that_the_network_did_not_keep_are_refused(
    parts_folder,
    python,
    snapshot,
    told,
    capture,  # noqa: F811
    context,  # noqa: F811
    monkeypatch,
):
    DA3.add(snapshot, python)
    told("da3-8")
    monkeypatch.setenv("FAKE_KIN_FALLS_BACK", "1")
    with pytest.raises(MethodError, match="did not keep the camera of photo 1"):
        da3_8.configured(FAST).reconstruct(capture, context)


@pytest.mark.parametrize("name", KIN)
def test_without_them_the_next_command_is_said(name, parts_folder):
    with pytest.raises(MissingPart, match=r"Get it from huggingface.*harness parts import"):
        chosen_methods([name], {})


@pytest.mark.parametrize("part", [DA3, MAPANYTHING], ids=lambda part: part.name)
def test_the_package_has_to_be_there_and_the_weights_complete(part, parts_folder, python, snapshot):
    with pytest.raises(MissingPart, match=r"Run: python3\.11 -m venv"):
        part.add(snapshot)
    (snapshot / "model.safetensors").unlink()
    with pytest.raises(DataError, match=r"no model\.safetensors"):
        part.add(snapshot, python)
    assert not part.folder.exists()


@pytest.mark.parametrize("setting", ["network.fit=crop", "network.precision=bf16"])
def test_settings_that_its_package_decides_are_refused(setting):
    name, value = setting.split("=")
    with pytest.raises(HarnessError, match=f"'{name}' of Depth Anything 3 cannot be '{value}'"):
        da3_8.configured({name: value})
    assert mapanything8.configured({name: value}).info.parameters["network"]

"""Depth Anything 3, MapAnything and Pi3 through packages with their real signatures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from harness.core.errors import HarnessError, MethodError, MissingPart
from harness.core.results import PhotoFrame
from harness.geometry.photo import open_photo
from harness.geometry.raycast import Raycaster
from harness.geometry.surface import SurfaceIndex
from harness.run.method_choice import chosen_methods
from methods.foreign.recipes import RecipeMethod, da3_8, mapanything8, pi3_8
from methods.points.surfacing import reconstructed
from tests.unit.methods.points.conftest import ball, capture, context  # noqa: F401
from tests.unit.methods.recipes.conftest import exchange, installed, python_with

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
        assert os.path.isfile(os.path.join(folder, "config.json")), folder
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
        assert os.path.isfile(os.path.join(folder, "config.json")), folder
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
PI3_PACKAGE = """
import os
import numpy as np
import torch


class Pi3:
    @classmethod
    def from_pretrained(cls, folder):
        assert os.path.isfile(os.path.join(folder, "config.json"))
        return cls()

    def to(self, device):
        return self

    def eval(self):
        return self

    def __call__(self, images):
        golden = np.load(os.environ["FAKE_KIN"])
        assert images.dim() == 5 and 0 <= images.min() and images.max() <= 1
        depth, K = golden["own_depth"], golden["intrinsics"]
        y, x = np.indices(depth.shape[1:]) + 0.5
        slopes = [((x - k[0, 2]) / k[0, 0], (y - k[1, 2]) / k[1, 1]) for k in K]
        rays = [np.stack([u, v, np.ones_like(u)], -1) for u, v in slopes]
        points = torch.from_numpy(depth[..., None] * np.array(rays))
        poses = []
        for each in golden["extrinsics"]:
            pose = np.eye(4)
            pose[:3] = each
            poses.append(np.linalg.inv(pose))
        return {"local_points": points[None], "conf": torch.zeros(1, *depth.shape, 1) + 3,
                "camera_poses": torch.from_numpy(np.array(poses))[None]}
"""


@pytest.fixture(scope="module")
def python(tmp_path_factory) -> Path:
    """One for all tests: what it has is asked once a process, which takes a second."""
    folder = tmp_path_factory.mktemp("interpreter")
    for package, module, source in (
        ("depth_anything_3", "api", DA3_PACKAGE),
        ("mapanything", "models", MAPANYTHING_PACKAGE),
        ("pi3", "models/pi3", PI3_PACKAGE),
    ):
        path = folder / "site" / package / f"{module}.py"
        path.parent.mkdir(parents=True)
        path.write_text(source)
    return python_with(folder / "site", folder / "python")


@pytest.fixture
def snapshot(tmp_path) -> Path:
    folder = tmp_path / "snapshot"
    folder.mkdir()
    (folder / "config.json").write_text("{}")
    (folder / "model.safetensors").write_bytes(b"weights")
    return folder


def answers(capture, ball, frames: list[PhotoFrame], path: Path) -> None:  # noqa: F811
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


KIN: dict[str, tuple[RecipeMethod, str]] = {
    "da3-8": (da3_8, "da3"),
    "mapanything8": (mapanything8, "mapanything"),
    "pi3-8": (pi3_8, "pi3"),
}


@pytest.fixture
def told(capture, ball, tmp_path, monkeypatch):  # noqa: F811
    def make(name: str) -> None:
        frames = []
        for photo in (open_photo(capture, view) for view in range(8)):
            size = photo.camera.size
            seen = exchange.fitted(photo.rgba, 518, 14, "fit", 255)
            frames.append(PhotoFrame.whole(size, (280, 504) if name == "da3-8" else seen.resized))
        answers(capture, ball, frames, tmp_path / "kin.npz")
        monkeypatch.setenv("FAKE_KIN", str(tmp_path / "kin.npz"))

    return make


@pytest.mark.nightly
@pytest.mark.parametrize("mode", ["native_posed", "sim3_cameras"])
@pytest.mark.parametrize("name", KIN)
def test_a_perfect_network_gives_the_sphere(
    name, mode, recipes_folder, python, snapshot, told, capture, context, ball  # noqa: F811
):  # fmt: skip
    method, recipe = KIN[name]
    if mode not in method.file.alignments:
        return
    installed(recipe, python, snapshot)
    told(name)
    chosen = method.configured({**FAST, "align.mode": mode})
    chosen.require_installed()
    result = reconstructed(chosen, capture, context)
    seen = np.abs(result.mesh.vertices[:, 1] - ball.bounds.mean(axis=0)[1]) < 0.35
    assert SurfaceIndex(ball).closest(result.mesh.vertices[seen])[1].mean() < 0.002
    if mode == "sim3_cameras":
        assert result.details["alignment"]["scale"] == pytest.approx(10.0, rel=1e-3)
    roles = [part.role for part in chosen.info.parts]
    assert roles == ["program", "environment", "network", "package"]


@pytest.mark.nightly
def test_cameras_that_the_network_did_not_keep_are_refused(
    recipes_folder, python, snapshot, told, capture, context, monkeypatch  # noqa: F811
):  # fmt: skip
    installed("da3", python, snapshot)
    told("da3-8")
    monkeypatch.setenv("FAKE_KIN_FALLS_BACK", "1")
    with pytest.raises(MethodError, match="did not keep the camera of photo 1"):
        reconstructed(da3_8.configured(FAST), capture, context)


@pytest.mark.parametrize("name", KIN)
def test_the_package_has_to_be_there_and_the_weights_complete(
    name, recipes_folder, python, snapshot
):
    method, recipe = KIN[name]
    with pytest.raises(MissingPart, match=f"Run: harness recipes install {recipe}$"):
        chosen_methods([name], {})
    installed(recipe, None, snapshot)
    with pytest.raises(MissingPart, match="does not have what"):
        method.require_installed()
    installed(recipe, python)
    method.require_installed()
    (snapshot / "model.safetensors").unlink()
    with pytest.raises(MissingPart, match=r"no model\.safetensors as it was noted.*huggingface"):
        method.require_installed()


@pytest.mark.parametrize("setting", ["network.fit", "network.precision"])
def test_settings_that_its_package_decides_are_none(setting):
    with pytest.raises(HarnessError, match=f"unknown setting '{setting}'"):
        da3_8.configured({setting: "crop"})
    assert mapanything8.configured({setting: "fit"}).info.parameters["network"]

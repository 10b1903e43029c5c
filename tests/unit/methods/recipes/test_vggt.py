"""``vggt8`` from weights to a mesh, through a package that has the layout of the real one."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from harness.core.camera import Camera
from harness.core.errors import HarnessError, MethodError, MissingPart
from harness.core.results import PhotoFrame
from harness.geometry.photo import open_photo
from harness.geometry.raycast import Raycaster
from harness.geometry.similarity import Similarity
from harness.geometry.surface import SurfaceIndex
from harness.run.method_choice import ChosenMethod, catalogued_methods, chosen_methods
from methods.foreign import recipes
from methods.foreign.recipes import vggt2, vggt8
from methods.points.surfacing import reconstructed
from tests.unit.methods.points.conftest import ball, capture, context  # noqa: F401
from tests.unit.methods.recipes.conftest import (
    decoded_cameras,
    exchange,
    installed,
    vggt,
    write_answer,
)
from tests.unit.methods.recipes.test_conventions import GOLDEN, golden, needs_golden

FAST = {"mesh.depth": "6", "mesh.cell_m": "0.008", "network.side": "266"}


def quaternion(rotation: np.ndarray) -> np.ndarray:
    """x, y, z, w of a rotation, by the eigenvector that it keeps."""
    w = np.sqrt(max(0.0, 1 + np.trace(rotation))) / 2
    if w > 1e-3:
        axis = [
            rotation[2, 1] - rotation[1, 2],
            rotation[0, 2] - rotation[2, 0],
            rotation[1, 0] - rotation[0, 1],
        ]
        return np.array([*(np.array(axis) / (4 * w)), w])
    values, vectors = np.linalg.eigh((rotation + rotation.T) / 2)
    return np.array([*vectors[:, np.argmax(values)], 0.0])


def encoded(camera: Camera) -> np.ndarray:
    fov = [2 * np.arctan(camera.height / 2 / camera.K[1, 1]),
           2 * np.arctan(camera.width / 2 / camera.K[0, 0])]  # fmt: skip
    return np.array([*camera.world_to_camera[:3, 3], *quaternion(camera.rotation), *fov])


@pytest.fixture
def answers(tmp_path, monkeypatch, capture, ball):  # noqa: F811
    """What a perfect network would say of the sphere, in a world and a unit of its own."""

    def make(views: tuple[int, ...], side: int = 266) -> Path:
        own = Similarity(0.37, np.linalg.qr(np.array([[1, 2, 3], [0, 1, 4], [5, 6, 0.0]]))[0],
                         np.array([0.3, -0.2, 0.5]))  # fmt: skip
        own = Similarity(own.scale, own.rotation * np.sign(np.linalg.det(own.rotation)), own.shift)
        caster = Raycaster(ball)
        images, poses, depths = [], [], []
        for view in views:
            photo = open_photo(capture, view)
            seen = exchange.fitted(photo.rgba, side, 14, "pad", 255)
            frame = PhotoFrame(photo.camera.size, seen.resized, seen.shift, (side, side))
            images.append(seen.picture)
            pose = encoded(own.camera(frame.camera(photo.camera))).astype(np.float32)
            # Depth as the network's own reading of its encoding would have it.
            (there,) = decoded_cameras(pose[None], frame.size)
            back = Similarity(1 / own.scale, own.rotation.T,
                              -own.rotation.T @ own.shift / own.scale)  # fmt: skip
            depth = own.scale * caster.depth(back.camera(there))
            poses.append(pose)
            depths.append(np.where(np.isfinite(depth), depth, 9.0).astype(np.float32))
        path = tmp_path / "answer.npz"
        confidence = 1 + np.exp(np.zeros(np.shape(depths), np.float32))
        write_answer(path, images=images, pose_enc=poses, depth=depths, confidence=confidence)
        monkeypatch.setenv("FAKE_VGGT", str(path))
        return path

    return make


def test_without_weights_the_next_command_is_said(recipes_folder):
    with pytest.raises(MissingPart, match=r"Run: harness recipes install vggt$") as error:
        chosen_methods(["vggt8"], {})
    assert error.value.exit_code == 4
    assert "\n" not in str(error.value)
    found = catalogued_methods()
    assert {"vggt8", "vggt2", "da3-8", "mapanything8"} <= set(found.missing)
    assert not found.failures
    # It can be described and configured all the same.
    info = ChosenMethod.of("vggt8", {"align.mode": "known_cameras"}).info
    assert info.title == "VGGT, 8 views, known_cameras"
    assert [part.role for part in info.parts] == ["program"]


def test_what_is_not_the_papers_is_listed_with_its_reason():
    listed = {entry.what: entry for entry in vggt8.info.deviations}
    assert {"network.fit", "keep.drop_share", "alignment", "surface"} <= set(listed)
    assert listed["alignment"].published == "not stated"
    assert all(entry.why for entry in listed.values())
    as_published = vggt8.configured({"network.fit": "crop", "keep.drop_share": "0.5"}).info
    assert not {"network.fit", "keep.drop_share"} & {e.what for e in as_published.deviations}
    # Two views are no row of the paper.
    assert vggt2.info.deviations == ()


@pytest.mark.nightly
@pytest.mark.parametrize("mode", ["sim3_cameras", "known_cameras", "oracle_icp"])
def test_a_perfect_network_gives_the_sphere(
    mode, recipes_folder, weights, foreign_python, answers, capture, context, ball  # noqa: F811
):  # fmt: skip
    answers(tuple(range(8)))
    installed("vggt", foreign_python, weights)
    method = vggt8.configured({**FAST, "align.mode": mode})
    method.require_installed()
    result = reconstructed(method, capture, context)
    seen = np.abs(result.mesh.vertices[:, 1] - ball.bounds.mean(axis=0)[1]) < 0.35
    off = SurfaceIndex(ball).closest(result.mesh.vertices[seen])[1]
    # Half a pixel of known_cameras is 4 mm: the network's pictures are 266 pixels high.
    assert off.mean() < 0.004
    assert result.details["alignment"]["centre_rms_mm"] < 0.1
    assert result.details["source"]["precision"] == "float32"
    parts = {part.role: part for part in method.info.parts}
    assert list(parts) == ["program", "environment", "network", "package"]
    assert all(part.sha256 for part in parts.values())
    assert "torch" in parts["package"].name
    assert mode in method.info.title


@pytest.mark.nightly
def test_two_views_and_bfloat16(
    recipes_folder, weights, foreign_python, answers, capture, context, ball  # noqa: F811
):  # fmt: skip
    answers((0, 4))
    installed("vggt", foreign_python, weights)
    method = vggt2.configured({**FAST, "network.precision": "bf16", "network.device": "cpu"})
    result = reconstructed(method, capture, context)
    assert result.details["source"]["precision"] == "bfloat16"
    assert result.details["alignment"]["angle_rms_deg"] < 0.1


@pytest.fixture
def small(weights, fake_package, tmp_path, monkeypatch):
    """The stored small network, or one like it where the stored numbers are not here."""
    if GOLDEN is not None:
        stored = golden("golden_vggt_tiny.npz")
        images = stored["images_u8"].transpose(0, 2, 3, 1)
        said = {
            "pose_enc": stored["h_pose_enc"][0],
            "depth": stored["h_depth"][0, ..., 0],
            "confidence": stored["h_depth_conf"][0],
        }
    else:
        rng = np.random.default_rng(0)
        images = rng.integers(0, 255, (3, 70, 98, 3), dtype=np.uint8)
        said = {
            "pose_enc": rng.uniform(0.5, 1, (3, 9)).astype(np.float32),
            "depth": rng.uniform(1, 2, (3, 70, 98)).astype(np.float32),
            "confidence": rng.uniform(1, 2, (3, 70, 98)).astype(np.float32),
        }
    path = tmp_path / "small.npz"
    write_answer(path, images=images, **said)
    monkeypatch.setenv("FAKE_VGGT", str(path))
    monkeypatch.delenv("FAKE_VGGT_FORK", raising=False)
    monkeypatch.syspath_prepend(str(fake_package))
    for name in ("vggt", "vggt.models", "vggt.models.vggt"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    return images, said, weights


def ask(images: np.ndarray, weights: Path):
    return vggt.answered(np.ascontiguousarray(images), weights, "cpu", "fp32")


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".pt", ".safetensors"])
def test_the_small_network_comes_through_bit_for_bit(suffix, small, tmp_path):
    images, said, weights = small
    if suffix == ".safetensors":
        import torch

        state = torch.load(weights, weights_only=True)
        weights = tmp_path / "model.safetensors"
        header, body = {}, b""
        for name, tensor in state.items():
            data = tensor.numpy().tobytes()
            where = [len(body), len(body) + len(data)]
            header[name] = {"dtype": "F32", "shape": list(tensor.shape), "data_offsets": where}
            body += data
        text = json.dumps(header).encode()
        weights.write_bytes(len(text).to_bytes(8, "little") + text + body)
    found, report = ask(images, weights)
    for name, value in said.items():
        np.testing.assert_array_equal(found[name], value)
    assert report["device"] == "cpu"


@needs_golden
@pytest.mark.slow
def test_the_small_network_gives_the_points_of_the_networks_own_code(small):
    images, _, weights = small
    stored = golden("golden_vggt_tiny.npz")
    found, _ = ask(images, weights)
    cameras = decoded_cameras(found["pose_enc"], (98, 70))
    for camera, depth, points in zip(
        cameras, found["depth"], stored["h_points_from_depth"], strict=True
    ):
        rows, columns = np.indices(depth.shape)
        pixels = np.stack([columns + 0.5, rows + 0.5], axis=-1).reshape(-1, 2)
        unprojected = camera.unproject(pixels, depth.ravel())
        most = 1e-5 * np.abs(points).max()
        np.testing.assert_allclose(unprojected, points.reshape(-1, 3), atol=most)


MISTAKES = {
    "colours exchanged": lambda images: images[..., ::-1],
    "views exchanged": lambda images: images[[1, 0, 2]],
    "mirrored": lambda images: images[:, :, ::-1],
    "darker by one level": lambda images: np.maximum(images, 1) - 1,
}


@pytest.mark.slow
@pytest.mark.parametrize("mistake", MISTAKES)
def test_other_pictures_are_noticed(mistake, small):
    images, _, weights = small
    with pytest.raises(AssertionError, match="other pictures than expected"):
        ask(MISTAKES[mistake](images), weights)


FORKS = {
    "stripped": "has no depth_head: it is a fork",
    "four values": "returns 4 values and not 2",
    "flat depth": "depth of this vggt package is",
    "logits": "it is a fork",
    "larger": "is of another network than the weights",
}


@pytest.mark.slow
@pytest.mark.parametrize("fork", FORKS)
def test_forks_that_mean_something_else_are_refused(fork, small, tmp_path, monkeypatch):
    images, said, weights = small
    if fork == "logits":
        low = {**said, "confidence": np.ones_like(said["confidence"])}
        write_answer(tmp_path / "low.npz", images=images, **low)
        monkeypatch.setenv("FAKE_VGGT", str(tmp_path / "low.npz"))
    monkeypatch.setenv("FAKE_VGGT_FORK", fork)
    # What a fork is like is asked when its module is loaded.
    with pytest.raises(SystemExit, match=f"^refused: .*{FORKS[fork]}"):
        ask(images, weights)


CHANGES = {
    "lacks": lambda state: {n: v for n, v in state.items() if n != "depth_head.norm.weight"},
    "holds more": lambda state: {**state, "semantic_head.x": state["depth_head.norm.weight"]},
    "another shape": lambda state: {**state, "depth_head.norm.weight": state["x"]},
}


@pytest.mark.slow
@pytest.mark.parametrize("change", CHANGES)
def test_weights_of_another_network_are_refused(change, small):
    import torch

    images, _, weights = small
    state = torch.load(weights, weights_only=True)
    state = CHANGES[change]({**state, "x": torch.zeros(5)})
    state.pop("x", None)
    torch.save(state, weights)
    with pytest.raises(SystemExit, match="^refused: .*another network than the weights"):
        ask(images, weights)


@pytest.mark.slow
@pytest.mark.parametrize("content", [b"", b"<!doctype html>", b"\xff" * 64])
def test_other_files_are_refused(content, small):
    images, _, weights = small
    weights.write_bytes(content)
    with pytest.raises(SystemExit, match="^refused: .*not a checkpoint of tensors"):
        ask(images, weights)


@pytest.mark.slow
def test_what_changed_or_does_not_fit_is_told_before_anything_is_loaded(
    recipes_folder, weights, foreign_python, monkeypatch
):
    installed("vggt", foreign_python, weights)
    vggt8.require_installed()
    monkeypatch.setattr(recipes, "available_bytes", lambda: 10**9)
    with pytest.raises(MethodError, match="cannot hold 'vggt8'.*GiB of free memory.*got 0.9 GiB"):
        vggt8.require_installed()
    weights.write_bytes(b"other")
    with pytest.raises(
        MissingPart, match="no weights as it was noted.*install vggt --weights PATH"
    ):
        vggt8.require_installed()
    with pytest.raises(MissingPart, match="no einops.*Run: harness recipes install vggt"):
        installed("vggt", Path(sys.executable), weights).require()


def test_an_alignment_that_makes_no_sense_is_refused():
    with pytest.raises(HarnessError, match="'vggt8' cannot be aligned by 'native_posed'"):
        vggt8.configured({"align.mode": "native_posed"})

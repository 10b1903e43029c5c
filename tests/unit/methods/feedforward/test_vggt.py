"""``vggt8`` from weights to a mesh, through a package that has the layout of the real one."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from harness.core.camera import Camera
from harness.core.errors import DataError, HarnessError, MethodError, MissingPart
from harness.geometry.photo import open_photo
from harness.geometry.raycast import Raycaster
from harness.geometry.similarity import Similarity
from harness.geometry.surface import SurfaceIndex
from harness.run.method_choice import ChosenMethod, catalogued_methods, chosen_methods
from methods.feedforward import source as memory
from methods.feedforward.kin import decoded_cameras
from methods.feedforward.parts import VGGT
from methods.foreign import running as exchange
from methods.foreign.interpreter import Interpreter
from methods.foreign.method_file import read_worker
from methods.foreign.running import asked
from methods.from_points.feedforward import vggt2, vggt8
from methods.points.cloud import fitted_frame, fitted_picture
from tests.fork_server import ForkServer
from tests.unit.methods.feedforward.conftest import write_answer
from tests.unit.methods.feedforward.test_conventions import GOLDEN, golden, needs_golden
from tests.unit.methods.points.conftest import ball, capture, context  # noqa: F401

FAST = {"mesh.depth": "6", "mesh.cell_m": "0.008", "network.side": "266"}
WORKERS = Path(__file__).parents[4] / "methods" / "feedforward" / "workers"


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
            frame = fitted_frame(photo.camera.size, side, 14, "pad")
            images.append(fitted_picture(photo.rgba, frame, 255))
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


def imported(weights: Path, python: Path | None):
    return VGGT.add(weights, python)


def test_without_weights_the_next_command_is_said(parts_folder):
    with pytest.raises(MissingPart, match=r"harness parts import vggt model\.pt$") as error:
        chosen_methods(["vggt8"], {})
    assert error.value.exit_code == 4
    assert "\n" not in str(error.value)
    found = catalogued_methods()
    assert {"vggt8", "vggt2", "da3-8", "mapanything8"} <= set(found.missing)
    assert not found.failures
    # It can be described and configured all the same.
    info = ChosenMethod.of("vggt8", {"align.mode": "known_cameras"}).info
    assert info.title == "VGGT, 8 views, known_cameras"
    assert info.parts == ()


def test_what_is_not_the_papers_is_listed_with_its_reason():
    listed = {entry.what: entry for entry in vggt8.info.deviations}
    assert {"network.fit", "keep.drop_share", "alignment", "surface"} <= set(listed)
    assert listed["alignment"].published == "not stated"
    assert all(entry.why for entry in listed.values())
    as_published = vggt8.configured({"network.fit": "crop", "keep.drop_share": "0.5"}).info
    assert not {"network.fit", "keep.drop_share"} & {e.what for e in as_published.deviations}
    # Two views are no row of the paper.
    assert vggt2.info.deviations == ()


def test_without_the_package_the_next_command_is_said(parts_folder, weights):
    """The harness's own environment has no vggt package here."""
    with pytest.raises(MissingPart, match="pip install") as error:
        imported(weights, None)
    assert "vggt.models.vggt" in str(error.value)
    assert not VGGT.folder.exists()


@pytest.mark.nightly
@pytest.mark.parametrize("mode", ["sim3_cameras", "known_cameras", "oracle_icp"])
def test_a_perfect_network_gives_the_sphere(
    mode, parts_folder, weights, foreign_python, answers, capture, context, ball  # noqa: F811
):  # fmt: skip
    answers(tuple(range(8)))
    installed = imported(weights, foreign_python)
    method = vggt8.configured({**FAST, "align.mode": mode})
    result = method.reconstruct(capture, context)
    seen = np.abs(result.mesh.vertices[:, 1] - ball.bounds.mean(axis=0)[1]) < 0.35
    off = SurfaceIndex(ball).closest(result.mesh.vertices[seen])[1]
    # Half a pixel of known_cameras is 4 mm: the network's pictures are 266 pixels high.
    assert off.mean() < 0.004
    assert result.details["alignment"]["centre_rms_mm"] < 0.1
    assert result.details["source"]["precision"] == "float32"
    weights_part, package = method.info.parts
    assert weights_part.sha256 == installed.sha256
    assert len(package.sha256) == 64
    assert "torch" in package.name
    assert mode in method.info.title


@pytest.mark.nightly
def test_two_views_and_bfloat16(
    parts_folder, weights, foreign_python, answers, capture, context, ball  # noqa: F811
):  # fmt: skip
    answers((0, 4))
    imported(weights, foreign_python)
    method = vggt2.configured({**FAST, "network.precision": "bf16", "network.device": "cpu"})
    result = method.reconstruct(capture, context)
    assert result.details["source"]["precision"] == "bfloat16"
    assert result.details["alignment"]["angle_rms_deg"] < 0.1


@pytest.mark.nightly
def test_it_runs_in_the_harness_own_environment_too(
    parts_folder, weights, fake_package, answers, capture, context, ball, monkeypatch  # noqa: F811
):  # fmt: skip
    monkeypatch.setenv("PYTHONPATH", f"{fake_package}:{os.environ.get('PYTHONPATH', '')}")
    answers((0, 4))
    imported(weights, None)
    result = vggt2.configured(FAST).reconstruct(capture, context)
    assert result.details["alignment"]["centre_rms_mm"] < 0.1


def ask(images: np.ndarray, weights: Path, python: Path):
    settings = {"weights": str(weights), "device": "cpu", "precision": "fp32", "side": 98}
    return asked(read_worker(WORKERS / "vggt"), Interpreter(python), {"images": images}, settings)


@pytest.fixture
def small(parts_folder, weights, foreign_python, tmp_path, monkeypatch):
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
    return images, said, VGGT.add(weights, foreign_python).weights


@pytest.mark.nightly
def test_the_small_network_comes_through_bit_for_bit(small, foreign_python):
    images, said, weights = small
    answer = ask(images, weights, foreign_python)
    for name, value in said.items():
        np.testing.assert_array_equal(answer.arrays[name], value)
    assert answer.report["device"] == "cpu"


@needs_golden
@pytest.mark.nightly
def test_the_small_network_gives_the_points_of_the_networks_own_code(small, foreign_python):
    images, _, weights = small
    stored = golden("golden_vggt_tiny.npz")
    arrays = ask(images, weights, foreign_python).arrays
    cameras = decoded_cameras(arrays["pose_enc"], (98, 70))
    for camera, depth, points in zip(
        cameras, arrays["depth"], stored["h_points_from_depth"], strict=True
    ):
        rows, columns = np.indices(depth.shape)
        pixels = np.stack([columns + 0.5, rows + 0.5], axis=-1).reshape(-1, 2)
        found = camera.unproject(pixels, depth.ravel())
        np.testing.assert_allclose(found, points.reshape(-1, 3), atol=1e-5 * np.abs(points).max())


@pytest.fixture(scope="module")
def torch_server() -> Iterator[ForkServer]:
    """Imports torch once."""
    server = ForkServer(["numpy", "torch"])
    yield server
    server.close()


@pytest.fixture
def warm(torch_server, fake_package, monkeypatch):
    """The worker's script runs in a fork of a process that has torch already.

    Only for workers that have to refuse or to fail: that the interpreter starts a worker that
    answers is shown above, and importing torch takes longer than all that they do.
    """

    def run(_worker, words: list[str], environment: dict[str, str], log: Path) -> int:
        script, *arguments = words[-3:]
        return torch_server.run(
            script,
            arguments,
            folder=log.parent,
            output=log,
            errors=log,
            environment={**environment, "PYTHONPATH": str(fake_package)},
        )

    monkeypatch.setattr(exchange, "_run", run)


MISTAKES = {
    "colours exchanged": lambda images: images[..., ::-1],
    "views exchanged": lambda images: images[[1, 0, 2]],
    "mirrored": lambda images: images[:, :, ::-1],
    "darker by one level": lambda images: np.maximum(images, 1) - 1,
}


@pytest.mark.nightly
@pytest.mark.parametrize("mistake", MISTAKES)
def test_other_pictures_are_noticed(mistake, small, foreign_python, warm):
    images, _, weights = small
    with pytest.raises(MethodError, match="other pictures than expected"):
        ask(np.ascontiguousarray(MISTAKES[mistake](images)), weights, foreign_python)


FORKS = {
    "stripped": "has no depth_head: it is a fork",
    "four values": "returns 4 values and not 2",
    "flat depth": "depth of this vggt package is",
    "logits": "it is a fork",
    "larger": "is of another network than the weights",
}


@pytest.mark.nightly
@pytest.mark.parametrize("fork", FORKS)
def test_forks_that_mean_something_else_are_refused(
    fork, small, foreign_python, warm, tmp_path, monkeypatch
):
    images, said, weights = small
    if fork == "logits":
        low = {**said, "confidence": np.ones_like(said["confidence"])}
        write_answer(tmp_path / "low.npz", images=images, **low)
        monkeypatch.setenv("FAKE_VGGT", str(tmp_path / "low.npz"))
    monkeypatch.setenv("FAKE_VGGT_FORK", fork)
    with pytest.raises(MethodError, match=FORKS[fork]):
        ask(images, weights, foreign_python)


@pytest.mark.nightly
def test_a_machine_without_the_memory_is_told_before_anything_is_loaded(
    parts_folder, weights, foreign_python, monkeypatch
):
    imported(weights, foreign_python)
    vggt8.require_installed()
    monkeypatch.setattr(memory, "available_bytes", lambda: 10**9)
    with pytest.raises(MethodError, match="cannot hold 'vggt'.*GiB of free memory.*got 0.9 GiB"):
        vggt8.require_installed()


def test_the_estimate_of_memory_grows_with_views_and_pixels():
    size = memory.NetworkSize(4_631_765_968)
    eight, two = (size.needed_bytes(n, (518, 518)) / 2**30 for n in (8, 2))
    assert 8 < eight < 12
    assert 5.5 < two < 8
    assert size.needed_bytes(8, (294, 518)) < size.needed_bytes(8, (518, 518))
    assert memory.available_bytes() > 0


@pytest.mark.nightly
def test_files_that_changed_are_refused(parts_folder, weights, foreign_python):
    imported(weights, foreign_python)
    with pytest.raises(HarnessError, match="imported already.*--replace"):
        imported(weights, foreign_python)
    VGGT.add(weights, foreign_python, replace=True)
    file = VGGT.find().weights
    file.write_bytes(file.read_bytes()[:-4])
    with pytest.raises(DataError, match="not the file that was imported"):
        VGGT.find()
    assert json.loads((VGGT.folder / "network.json").read_text())["licence"].startswith("CC-BY-NC")

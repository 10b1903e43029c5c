"""Round things with known normals, a photo of one, and networks that copy."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from harness.core.artifacts import Capture, image_name
from harness.core.camera import Camera
from harness.core.mesh import Mesh
from harness.core.rigs import RingRig
from harness.geometry.images import save_png
from harness.geometry.raycast import Raycaster
from methods.normals import installed


@pytest.fixture(scope="session")
def sphere() -> Callable[..., Mesh]:
    """``sphere(radius, centre)``: fine, closed, outward, with vertices on the sphere."""

    def build(radius: float = 0.4, centre: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Mesh:
        rings, segments = 120, 160
        polar = np.linspace(0, np.pi, rings + 1)[1:-1]
        around = np.arange(segments) * 2 * np.pi / segments
        v, u = np.meshgrid(polar, around, indexing="ij")
        ring = np.stack([np.sin(v) * np.sin(u), np.cos(v), np.sin(v) * np.cos(u)], axis=-1)
        points = np.concatenate([ring.reshape(-1, 3), [[0, 1, 0], [0, -1, 0]]])
        index = np.arange((rings - 1) * segments).reshape(rings - 1, segments)
        right = np.roll(index, -1, axis=1)
        a, b, c, d = (part.ravel() for part in (index[:-1], index[1:], right[1:], right[:-1]))
        top, low = len(points) - 2, len(points) - 1
        caps = [
            np.stack([np.full(segments, top), index[0], right[0]], axis=1),
            np.stack([np.full(segments, low), right[-1], index[-1]], axis=1),
        ]
        faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1), *caps])
        return Mesh(points * radius + centre, faces)

    return build


@pytest.fixture(scope="session")
def cameras() -> tuple[Camera, ...]:
    """Eight cameras around the origin at 3 m, portrait, small."""
    return RingRig().cameras(270, 480)


ABOUT = {"name": "mirror 1", "licence": "Apache-2.0", "training_set": "avatars-train t00001"}
COPIES = {"front": "body_front", "back": "body_back"}


@pytest.fixture(scope="session")
def save_network() -> Callable[..., Path]:
    """``save_network(path, copies, **about)``: a network whose outputs are copies of its inputs.

    ``copies`` is input by output; ``inputs`` names what it has beside the image, ``side`` fixes its
    height and width, and an empty value in ``about`` leaves that out of the metadata.
    """
    onnx = pytest.importorskip("onnx")
    pytest.importorskip("onnxruntime")

    def save(
        path: Path,
        copies: dict[str, str] = COPIES,
        *,
        inputs: tuple[str, ...] = ("body_front", "body_back"),
        side: int | None = None,
        **about: str,
    ) -> Path:
        helper, kind = onnx.helper, onnx.TensorProto.FLOAT
        size = [side or "height", side or "width"]
        given = [
            helper.make_tensor_value_info(name, kind, [1, 1 if name == "mask" else 3, *size])
            for name in ("image", *inputs)
        ]
        made = [helper.make_tensor_value_info(name, kind, [1, 3, *size]) for name in copies]
        nodes = [
            helper.make_node("Concat", [source] * 3, [name], axis=1)
            if source == "mask"
            else helper.make_node("Identity", [source], [name])
            for name, source in copies.items()
        ]
        graph = helper.make_graph(nodes, "copies", given, made)
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
        for key, value in {**ABOUT, **about}.items():
            if value:
                model.metadata_props.add(key=key, value=value)
        path.write_bytes(model.SerializeToString())
        return path

    return save


@pytest.fixture
def places(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where networks are shipped, ``shipped``, and imported, ``own``, below this folder."""
    shipped = installed.Place("shipped", tmp_path / "shipped")
    monkeypatch.setattr(installed, "shipped_places", lambda: (shipped,))
    monkeypatch.setenv("HARNESS_WEIGHTS", str(tmp_path / "own"))
    return tmp_path


@pytest.fixture
def photograph(tmp_path: Path, cameras) -> Callable[[Mesh], Capture]:
    """``photograph(mesh)``: views 0 and 1 of it, red on the left half of the picture, else blue."""

    def take(mesh: Mesh) -> Capture:
        caster = Raycaster(mesh)
        for view, camera in enumerate(cameras[:2]):
            alpha = np.round(255 * caster.coverage(camera)).astype(np.uint8)
            colour = np.zeros((*alpha.shape, 3), np.uint8)
            colour[:, : camera.width // 2, 0] = 255
            colour[:, camera.width // 2 :, 2] = 255
            save_png(tmp_path / image_name(view), np.dstack([colour, alpha]))
        return Capture("toy", "ball", "tiny", "key", tmp_path, cameras[:2])

    return take

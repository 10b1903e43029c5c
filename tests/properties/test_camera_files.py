"""Random camera sets, written as COLMAP text, COLMAP binary and nerfstudio, are read to 1e-9."""

from __future__ import annotations

import json
import struct
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from harness.core.camera import Camera
from harness.core.camera_frames import (
    BLENDER_TO_WORLD,
    quaternion_from_rotation,
    rotation_from_quaternion,
    write_colmap,
    write_transforms_json,
)
from harness.data.camera_files import read_cameras
from harness.data.colmap import write_colmap_binary
from harness.data.lens import Lens

_unit = st.floats(-1, 1)
_bend = st.floats(-0.3, 0.3)
#: COLMAP's number of a model, how many focal lengths and what of the lens it has, in its order.
MODELS = {
    "SIMPLE_PINHOLE": (0, 1, ()),
    "PINHOLE": (1, 2, ()),
    "SIMPLE_RADIAL": (2, 1, ("k1",)),
    "RADIAL": (3, 1, ("k1", "k2")),
    "OPENCV": (4, 2, ("k1", "k2", "p1", "p2")),
    "OPENCV_FISHEYE": (5, 2, ("k1", "k2", "k3", "k4")),
    "FULL_OPENCV": (6, 2, ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")),
    "SIMPLE_RADIAL_FISHEYE": (8, 1, ("k1",)),
    "RADIAL_FISHEYE": (9, 1, ("k1", "k2")),
}
NERFSTUDIO = ("PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE")
#: Names as people give them; none begins or ends with a blank.
_names = st.text("ab 0.ä-#_()", min_size=1, max_size=8).map(lambda text: f"x{text}.png")


@dataclass(frozen=True)
class Shot:
    """A photo: its camera, the model of it, and what of the lens is told."""

    name: str
    camera: Camera
    model: str
    bend: dict[str, float]

    @property
    def lens(self) -> Lens:
        k = tuple(self.bend.get(f"k{n}", 0.0) for n in range(1, 7))
        p = (self.bend.get("p1", 0.0), self.bend.get("p2", 0.0))
        return Lens.of(k, p, fisheye="FISHEYE" in self.model)

    @property
    def numbers(self) -> list[float]:
        K = self.camera.K
        focals = [K[0, 0], K[1, 1]][: MODELS[self.model][1]]
        return [*focals, K[0, 2], K[1, 2], *(self.bend[key] for key in MODELS[self.model][2])]

    @property
    def pose(self) -> list[float]:
        return [
            *quaternion_from_rotation(self.camera.rotation),
            *self.camera.world_to_camera[:3, 3],
        ]


@st.composite
def shots(draw: st.DrawFn, models: tuple[str, ...] = tuple(MODELS)) -> list[Shot]:
    made = []
    for name in draw(st.lists(_names, min_size=1, max_size=6, unique=True)):
        model = draw(st.sampled_from(models))
        quaternion = draw(
            st.tuples(_unit, _unit, _unit, _unit).filter(lambda q: np.linalg.norm(q) > 0.05)
        )
        pose = np.eye(4)
        pose[:3, :3] = rotation_from_quaternion(quaternion)
        pose[:3, 3] = draw(st.tuples(*[st.floats(-9, 9)] * 3))
        fx, fy, cx, cy = draw(st.tuples(*[st.floats(10, 5000)] * 4))
        fy = fx if MODELS[model][1] == 1 else fy
        size = draw(st.tuples(st.integers(1, 5000), st.integers(1, 5000)))
        camera = Camera(np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]), pose, *size)
        made.append(Shot(name, camera, model, {key: draw(_bend) for key in MODELS[model][2]}))
    return made


def assert_read(path: Path, written: list[Shot], to_world: np.ndarray | None = None) -> None:
    found = read_cameras(path).views
    assert [view.image for view in found] == [shot.name for shot in written]
    for view, shot in zip(found, written, strict=True):
        camera = view.camera if to_world is None else view.camera.in_frame(to_world)
        np.testing.assert_allclose(camera.K, shot.camera.K, atol=1e-9)
        np.testing.assert_allclose(camera.world_to_camera, shot.camera.world_to_camera, atol=1e-9)
        assert camera.size == shot.camera.size
        np.testing.assert_allclose([*view.lens.k, *view.lens.p], [*shot.lens.k, *shot.lens.p])
        assert view.lens.fisheye == shot.lens.fisheye


def words(values: list[float]) -> str:
    return " ".join(repr(float(value)) for value in values)


@given(
    shots(),
    st.permutations(range(6)),
    st.lists(st.sampled_from(["", None, "1 2 -1", "10 20 7 30.5 40 -1 5e1 60 12"]), min_size=6),
    st.sampled_from(["\n", "\r\n", "\r"]),
    st.booleans(),
    st.booleans(),
)
def test_colmap_text_there_and_back(written, order, points, newline, bom, counted):
    """Images stand in any order; their lines of points are full, empty or missing."""
    cameras, images = ["# Camera list"], ["# Image list"]
    if counted:
        images.append(f"# Number of images: {len(written)}, mean observations per image: 3")
    for number in (n for n in order if n < len(written)):
        shot = written[number]
        size = f"{shot.camera.width} {shot.camera.height}"
        cameras.append(f"{number + 40} {shot.model} {size} {words(shot.numbers)}")
        images.append(f"{number + 1} {words(shot.pose)} {number + 40} {shot.name}")
        images += [line for line in points[number : number + 1] if line is not None]
    with tempfile.TemporaryDirectory() as folder:
        for name, lines in (("cameras", cameras), ("images", images)):
            content = ("\ufeff" if bom else "") + newline.join([*lines, ""])
            Path(folder, f"{name}.txt").write_bytes(content.encode())
        assert_read(Path(folder), written)


@given(shots(), st.permutations(range(6)), st.lists(st.integers(0, 3), min_size=6))
def test_colmap_binary_there_and_back(written, order, points):
    numbers = [n for n in order if n < len(written)]
    cameras = images = struct.pack("<Q", len(written))
    for number in numbers:
        shot = written[number]
        model = MODELS[shot.model][0]
        cameras += struct.pack("<IiQQ", number + 40, model, *shot.camera.size)
        cameras += struct.pack(f"<{len(shot.numbers)}d", *shot.numbers)
        images += struct.pack("<I7dI", number + 1, *shot.pose, number + 40)
        images += shot.name.encode() + b"\0" + struct.pack("<Q", points[number])
        images += points[number] * struct.pack("<ddq", 1.5, 2.5, -1)
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "cameras.bin").write_bytes(cameras)
        Path(folder, "images.bin").write_bytes(images)
        assert_read(Path(folder), written)


@given(shots(NERFSTUDIO), st.booleans(), st.booleans())
def test_transforms_there_and_back(written, shared, flagged):
    """Intrinsics stand in each frame, or once for all where all have the same."""
    frames = []
    for shot in written:
        shot = Shot(shot.name, (written[0] if shared else shot).camera, shot.model, shot.bend)
        K, (width, height) = shot.camera.K, shot.camera.size
        pose = np.linalg.inv(shot.camera.world_to_camera) @ np.diag([1.0, -1.0, -1.0, 1.0])
        frame = {"fl_x": K[0, 0], "fl_y": K[1, 1], "cx": K[0, 2], "cy": K[1, 2], "w": width,
                 "h": height, "camera_model": shot.model, **shot.bend}  # fmt: skip
        if flagged:
            frame["is_fisheye"] = "FISHEYE" in frame.pop("camera_model")
        frames.append({**frame, "file_path": shot.name, "transform_matrix": pose.tolist()})
    document = {"frames": frames}
    if shared:
        document.update({key: frames[0][key] for key in ("fl_x", "fl_y", "cx", "cy", "w", "h")})
        for frame in frames:
            for key in ("fl_x", "fl_y", "cx", "cy", "w", "h"):
                del frame[key]
        written = [Shot(s.name, written[0].camera, s.model, s.bend) for s in written]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "transforms.json")
        path.write_text(json.dumps(document))
        assert_read(path, written)


@given(shots(("PINHOLE",)))
def test_what_is_exported_is_read(written):
    cameras, names = [shot.camera for shot in written], [shot.name for shot in written]
    with tempfile.TemporaryDirectory() as folder:
        write_colmap(Path(folder, "text"), cameras, names)
        write_colmap_binary(Path(folder, "binary"), cameras, names)
        write_transforms_json(Path(folder, "transforms.json"), cameras, names)
        assert_read(Path(folder, "text"), written)
        assert_read(Path(folder, "binary"), written)
        assert_read(Path(folder, "transforms.json"), written, BLENDER_TO_WORLD)

"""Files of the form of the licensed ones, with numbers that mean nothing.

Names, shapes and containers are those of the published files, so that ``harness parts import``
takes them. What comes out of a run with them says nothing about anybody's method.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from harness.core.arrays import Floats
from methods.body.pixie.network import PixieBody
from methods.ifnet import network as ifnet
from methods.ifnet.network import FEATURES, IfNet
from methods.normals.econ_network import NormalGenerator
from methods.parts.conversion import bare, shapes_of
from methods.parts.converted import FILES

Numbers = dict[str, NDArray[np.float32]]
_SEED = 0
#: Channels of ECON's normal networks at full resolution.
FULL_WIDTH = 64


def write_all(folder: Path, width: int = FULL_WIDTH) -> dict[str, tuple[Path, ...]]:
    """All files by kind of part, in the order of their import; 2.2 GB. Those there are kept."""
    folder.mkdir(parents=True, exist_ok=True)
    writers: dict[str, dict[str, Callable[[Path], Path]]] = {
        "econ-normal": {"normal.ckpt": functools.partial(write_normals, width=width)},
        "ifnet": {"ifnet.ckpt": write_ifnet},
        "pixie": {"pixie_model.tar": write_pixie},
        "smplx": dict.fromkeys(
            ("SMPLX_NEUTRAL.npz", "SMPLX_MALE.npz", "SMPLX_NEUTRAL_2020.npz"), write_smplx
        ),
    }
    for files in writers.values():
        for name, write in files.items():
            if not (folder / name).exists():
                partial = folder / f".partial-{name}"
                write(partial).replace(folder / name)
    return {kind: tuple(folder / name for name in files) for kind, files in writers.items()}


def write_normals(path: Path, width: int = FULL_WIDTH) -> Path:
    """ECON's networks: whatever they see, the surface faces the viewer, or away."""
    numbers: Numbers = {}
    for name in FILES:
        numbers |= _zeros(shapes_of(bare(NormalGenerator, width=width), f"netG.{name}."))
        numbers[f"netG.{name}.model.38.bias"][2] = 1.0 if name == "netF" else -1.0
    return _saved(path, {"state_dict": numbers, "epoch": 0, "global_step": 0})


def write_ifnet(path: Path) -> Path:
    """IF-Nets+: what the body's voxels hold is inside, whatever the sheets are."""
    numbers = _zeros(shapes_of(bare(IfNet), ifnet.PREFIX))
    for name, taken in (("conv_in_smpl", 0), ("SA.conv", 0), ("conv_0_fusion", 16),
                        ("conv_0_1_fusion", 0)):  # fmt: skip
        numbers[f"netG.{name}.weight"][0, taken, 1, 1, 1] = 1.0
    # The body is the first of the finest features, which come after the sheets' own voxel.
    numbers["netG.fc_0.weight"][0, 1] = 1.0
    assert FEATURES[0] > 1
    for layer in ("fc_1", "fc_2", "fc_out"):
        numbers[f"netG.{layer}.weight"][0, 0] = 1.0
    numbers["netG.fc_out.bias"][:] = -0.5
    return _saved(path, {"state_dict": numbers, "epoch": 0, "global_step": 0})


def write_pixie(path: Path) -> Path:
    """PIXIE: somebody upright near rest, a little other in each photo."""
    random = np.random.default_rng(_SEED)
    sections: dict[str, Numbers] = {}
    for section, layers in bare(PixieBody).named_children():
        numbers: Numbers = {}
        for name, shape in shapes_of(layers).items():
            if name.endswith(("running_var",)) or (name.endswith("weight") and len(shape) == 1):
                numbers[name] = np.ones(shape, np.float32)
            elif len(shape) > 1:
                deviation = 0.7 / np.sqrt(np.prod(shape[1:]))
                drawn = random.standard_normal(shape, dtype=np.float32)
                numbers[name] = (deviation * drawn).astype(np.float32)
            else:
                numbers[name] = np.zeros(shape, np.float32)
        sections[section] = numbers
    rest = np.array([1.0, 0.0, 0.0, 1.0, 0.0, 0.0], np.float32)
    _answer(sections["Regressor_body"], np.concatenate([[0.9, 0, 0], np.tile(rest, 19)]))
    head = np.concatenate([np.zeros(250), rest, np.zeros(3)])
    _answer(sections["Regressor_head_share"], head)
    _answer(sections["Regressor_hand_share"], np.tile(rest, 16))
    return _saved(path, dict(sections))


def _answer(numbers: Numbers, bias: Floats) -> None:
    """Let a section answer about ``bias``."""
    last = max(name for name in numbers if name.endswith("bias"))
    numbers[last][:] = bias
    weight = last.replace("bias", "weight")
    numbers[weight] *= np.float32(0.1)


def _zeros(shapes: Mapping[str, tuple[int, ...]]) -> Numbers:
    return {name: np.zeros(shape, np.float32) for name, shape in shapes.items()}


def _saved(path: Path, content: Mapping[str, object]) -> Path:
    torch.save(_tensors(content), path)
    return path


def _tensors(value: object) -> object:
    if isinstance(value, Mapping):
        return {name: _tensors(each) for name, each in value.items()}
    return torch.from_numpy(value) if isinstance(value, np.ndarray) else value


#: Where the joints are, metres, of somebody 1.7 m high with the arms out: x to the person's left.
_JOINTS = {
    "pelvis": (0, 0.95, 0), "left_hip": (0.09, 0.87, 0), "right_hip": (-0.09, 0.87, 0),
    "spine1": (0, 1.06, 0), "left_knee": (0.1, 0.48, 0), "right_knee": (-0.1, 0.48, 0),
    "spine2": (0, 1.18, 0), "left_ankle": (0.11, 0.08, -0.02), "right_ankle": (-0.11, 0.08, -0.02),
    "spine3": (0, 1.25, 0), "left_foot": (0.12, 0.03, 0.1), "right_foot": (-0.12, 0.03, 0.1),
    "neck": (0, 1.42, 0), "left_collar": (0.07, 1.36, 0), "right_collar": (-0.07, 1.36, 0),
    "head": (0, 1.52, 0.02), "left_shoulder": (0.17, 1.37, 0), "right_shoulder": (-0.17, 1.37, 0),
    "left_elbow": (0.42, 1.36, 0), "right_elbow": (-0.42, 1.36, 0),
    "left_wrist": (0.66, 1.36, 0), "right_wrist": (-0.66, 1.36, 0),
    "jaw": (0, 1.5, 0.05), "left_eye_smplhf": (0.03, 1.57, 0.08),
    "right_eye_smplhf": (-0.03, 1.57, 0.08),
}  # fmt: skip
#: Half thickness of the flesh around a joint and the way to the one that it hangs on, metres.
_FLESH = {"spine": 0.12, "pelvis": 0.14, "head": 0.1, "hip": 0.09, "knee": 0.07, "ankle": 0.05,
          "shoulder": 0.06, "elbow": 0.045, "wrist": 0.035, "neck": 0.06, "collar": 0.08,
          "foot": 0.04, "jaw": 0.04}  # fmt: skip
_VERTICES, _FACES, _RINGS, _AROUND = 10475, 20908, 12, 15


def write_smplx(path: Path, directions: int = 400) -> Path:
    """A person of 55 balls and rods in the form of SMPL-X; nothing of the model itself.

    Args:
        path: File to write.
        directions: Of shape and expression; 20 in the first version of the model.
    """
    from smplx.joint_names import JOINT_NAMES

    names = JOINT_NAMES[:55]
    parents = np.array([-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19,
                        15, 15, 15, *_finger_parents()])  # fmt: skip
    joints = np.array([_JOINTS.get(name, (np.nan,) * 3) for name in names], dtype=float)
    for index, name in enumerate(names):
        if np.isnan(joints[index, 0]):  # fingers, side by side along the arm
            side = 1.0 if name.startswith("left") else -1.0
            finger, knuckle = divmod(index - (25 if side > 0 else 40), 3)
            step = (side * (0.09 + 0.025 * knuckle), -0.01, 0.03 - 0.015 * finger)
            joints[index] = joints[20 if side > 0 else 21] + step
    vertices, faces, owner = _flesh(names, joints, parents)
    random = np.random.default_rng(_SEED)
    regressor = np.zeros((55, _VERTICES))
    for joint, place in enumerate(joints):
        regressor[joint, owner == joint] = _weights(vertices[owner == joint], place)
    shapes = np.zeros((_VERTICES, 3, directions), np.float32)
    shapes[:, :, 0] = 0.03 * vertices
    shapes[:, :, 1:10] = random.normal(0, 0.002, (55, 3, 9))[owner]
    arrays = {
        "v_template": vertices,
        "shapedirs": shapes,
        "posedirs": np.zeros((_VERTICES, 3, 486), np.float32),
        "J_regressor": regressor,
        "weights": np.eye(55)[owner],
        "kintree_table": np.array([np.maximum(parents, 0), np.arange(55)]),
        "f": faces,
        "hands_componentsl": np.eye(45),
        "hands_componentsr": np.eye(45),
        "hands_meanl": np.zeros(45),
        "hands_meanr": np.zeros(45),
        "lmk_faces_idx": np.zeros(51, dtype=np.int64),
        "lmk_bary_coords": np.full((51, 3), 1 / 3),
    }
    np.savez(path, **arrays)
    return path


def _weights(points: Floats, place: Floats) -> Floats:
    """(N,) weights, which sum to 1, of points (N, 3) whose weighted mean is a place."""
    away = points - points.mean(axis=0)
    slope = np.linalg.solve(away.T @ away / len(points), place - points.mean(axis=0))
    return (1.0 + away @ slope) / len(points)


def _finger_parents() -> list[int]:
    found = []
    for wrist, first in ((20, 25), (21, 40)):
        for root in range(first, first + 15, 3):
            found += [wrist, root, root + 1]
    return found


def _flesh(
    names: list[str], joints: Floats, parents: NDArray[np.int64]
) -> tuple[Floats, NDArray[np.int64], NDArray[np.int64]]:
    """Vertices, faces and the joint of each vertex: an ellipsoid around each joint."""
    polar = np.pi * (np.arange(_RINGS) + 1) / (_RINGS + 1)
    around = 2 * np.pi * np.arange(_AROUND) / _AROUND
    p, a = np.meshgrid(polar, around, indexing="ij")
    ring = np.stack([np.sin(p) * np.sin(a), np.cos(p), np.sin(p) * np.cos(a)], -1).reshape(-1, 3)
    unit = np.concatenate([ring, [[0, 1, 0], [0, -1, 0]]])
    index = np.arange(_RINGS * _AROUND).reshape(_RINGS, _AROUND)
    right = np.roll(index, -1, axis=1)
    b, c, d, e = (each.ravel() for each in (index[:-1], index[1:], right[1:], right[:-1]))
    top, low = len(ring), len(ring) + 1
    own = np.concatenate(
        [
            np.stack([b, c, d], 1),
            np.stack([b, d, e], 1),
            np.stack([np.full(_AROUND, top), index[0], right[0]], 1),
            np.stack([np.full(_AROUND, low), right[-1], index[-1]], 1),
        ]
    )
    children = {int(parent): child for child, parent in enumerate(parents) if parent >= 0}
    points, faces, owner = [], [], []
    for joint, name in enumerate(names):
        word = name.replace("left_", "").replace("right_", "").rstrip("123")
        thick = _FLESH.get(word, 0.012)
        way = (joints[children[joint]] - joints[joint]) if joint in children else np.zeros(3)
        middle = joints[joint] + (0 if word == "pelvis" else way / 2)
        radii = np.maximum(np.abs(way) / 2 + 0.02, thick)
        faces.append(own + len(unit) * joint)
        points.append(unit * radii + middle)
        owner.append(np.full(len(unit), joint))
    rest = _VERTICES - len(unit) * len(names)
    points.append(np.tile(points[0][:1], (rest, 1)))
    owner.append(np.zeros(rest, dtype=np.int64))
    found = np.concatenate(faces)
    padding = np.tile(found[:1], (_FACES - len(found), 1))
    return np.concatenate(points), np.concatenate([found, padding]), np.concatenate(owner)

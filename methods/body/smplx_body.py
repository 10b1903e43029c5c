"""SMPL-X as a body for the fit, from the user's own licensed model file.

Source: Pavlakos et al., Expressive Body Capture, CVPR 2019; PyPI ``smplx``. Its rest frame is the
world's (+Y up, facing +Z) and its local axes are parallel to it, so poses need no conversion.
"""

from __future__ import annotations

import functools
import pickle
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from harness.core.errors import DataError, MissingPart
from methods.body.anatomy import blend_landmarks, free_joint, table
from methods.body.model import MAIN_JOINTS, FreeJoint, LandmarkTable, Parameters, Posed
from methods.body.parts import body_part

if TYPE_CHECKING:
    from torch import Tensor

__all__ = ["SmplxBody"]

_WHERE = (
    "Register at https://smpl-x.is.tue.mpg.de, unpack models_smplx_v1_1.zip and pass "
    "--set body.model_file=<folder>/SMPLX_NEUTRAL.npz"
)
_VERTICES, _JOINTS, _BODY_JOINTS = 10475, 55, 21
_BETAS, _EXPRESSIONS, _HAND = 10, 10, 45
#: What the fit leaves as it is unless it is given: size of each of the model's other parameters.
_RESTING = {
    "expression": _EXPRESSIONS,
    "jaw_pose": 3,
    "leye_pose": 3,
    "reye_pose": 3,
    "left_hand_pose": _HAND,
    "right_hand_pose": _HAND,
}
_FREE_ROLES = {
    "spine1": "spine", "spine2": "spine", "spine3": "spine", "neck": "neck", "head": "head",
    "collar": "clavicle", "shoulder": "shoulder", "elbow": "elbow", "wrist": "wrist",
    "hip": "hip", "knee": "knee", "ankle": "ankle", "foot": "foot",
}  # fmt: skip
#: Single vertices that the package names: face and feet.
_POINTS = {0: "nose", 2: "leye", 5: "reye", 7: "lear", 8: "rear", 29: "LHeel", 30: "RHeel",
           31: "LBigToe", 32: "RBigToe"}  # fmt: skip
#: Landmarks at joints, as the model's own regressor blends them from the skin.
_AT_JOINTS = {11: "left_shoulder", 12: "right_shoulder", 13: "left_elbow", 14: "right_elbow",
              15: "left_wrist", 16: "right_wrist", 17: "left_pinky1", 18: "right_pinky1",
              19: "left_index1", 20: "right_index1", 21: "left_thumb2", 22: "right_thumb2",
              23: "left_hip", 24: "right_hip", 25: "left_knee", 26: "right_knee",
              27: "left_ankle", 28: "right_ankle"}  # fmt: skip
_KNUCKLE_TRUST = 0.3
_BLENDED = 32


class SmplxBody:
    """SMPL-X with 21 free joints and 10 shape values; face, eyes and hands rest unless given."""

    name = "smplx"

    def __init__(self, model_file: str | Path) -> None:
        import torch
        from smplx.joint_names import JOINT_NAMES

        path = Path(model_file) if model_file else None
        self._model = _load(path)
        self.part = body_part(self.name, str(model_file))
        self.faces: NDArray[np.int32] = np.asarray(self._model.faces).astype(np.int32)
        self.joint_names = tuple(JOINT_NAMES[:_JOINTS])
        self.roles: Mapping[str, int] = {
            role: self.joint_names.index(role) for role in (*MAIN_JOINTS, "head")
        }
        self.free = tuple(_free(name) for name in self.joint_names[1 : _BODY_JOINTS + 1])
        self.shape_prior = np.stack([np.zeros(_BETAS), np.ones(_BETAS)]).astype(np.float32)
        self.landmarks = _landmark_table(self._model, self.joint_names)
        self.regions: Mapping[str, NDArray[np.bool_]] = _regions(self._model, self.joint_names)
        self._parents = [int(parent) for parent in self._model.parents]
        self._torch = torch

    def __call__(self, parameters: Parameters) -> tuple[Tensor, Tensor]:
        """Vertices (B, 10475, 3) and joints (B, 55, 3), metres, world frame."""
        posed = self.posed(parameters)
        return posed.vertices, posed.joints

    def posed(self, parameters: Parameters) -> Posed:
        """The bodies of some parameters, world frame.

        ``pose`` may also be (B, 21, 3, 2), the first two columns of each rotation. ``expression``,
        ``jaw_pose``, ``leye_pose``, ``reye_pose``, ``left_hand_pose`` and ``right_hand_pose`` are
        taken as the package takes them, where they are given.
        """
        import roma

        torch = self._torch
        pose = parameters["pose"]
        if pose.ndim == 4:
            pose = roma.rotmat_to_rotvec(roma.special_gramschmidt(pose))
        batch = len(pose)
        resting = {
            name: parameters.get(name, pose.new_zeros(batch, size))
            for name, size in _RESTING.items()
        }
        output = self._model(
            betas=parameters["shape"],
            body_pose=pose.reshape(batch, -1),
            # The root is turned below: a rotation vector has no gradient at half a turn.
            global_orient=pose.new_zeros(batch, 3),
            transl=pose.new_zeros(batch, 3),
            return_full_pose=True,
            **resting,
        )
        root = roma.special_gramschmidt(parameters["orientation"])
        pelvis = output.joints[:, :1]
        place = parameters["translation"][:, None]
        local = roma.rotvec_to_rotmat(output.full_pose.reshape(batch, _JOINTS, 3))
        turns = [root]
        for joint in range(1, _JOINTS):
            turns.append(turns[self._parents[joint]] @ local[:, joint])
        return Posed(
            vertices=(output.vertices - pelvis) @ root.transpose(1, 2) + place,
            joints=(output.joints[:, :_JOINTS] - pelvis) @ root.transpose(1, 2) + place,
            turns=torch.stack(turns, 1),
        )

    def landmark_points(self, posed: Posed) -> Tensor:
        """(B, K, 3) metres: the landmarks of the table."""
        return blend_landmarks(self.landmarks, posed)

    def sparse(self) -> SmplxBody:
        """The body itself: the package computes all vertices or none."""
        return self

    def export(self, parameters: Parameters) -> dict[str, NDArray[Any]]:
        """``betas``, ``body_pose``, ``global_orient`` and ``transl`` as the package takes them."""
        import roma

        torch = self._torch
        with torch.no_grad():
            rest = self._model(
                betas=parameters["shape"][:1],
                **{name: torch.zeros(1, size) for name, size in _RESTING.items()},
                body_pose=torch.zeros(1, 3 * _BODY_JOINTS),
                global_orient=torch.zeros(1, 3),
                transl=torch.zeros(1, 3),
            )
            turn = roma.special_gramschmidt(parameters["orientation"][:1])
            transl = parameters["translation"][:1] - rest.joints[:, 0]
            return {
                "betas": parameters["shape"][:1].numpy(),
                "body_pose": parameters["pose"][:1].reshape(1, -1).numpy(),
                "global_orient": roma.rotmat_to_rotvec(turn).numpy(),
                "transl": transl.numpy(),
            }


def _load(path: Path | None) -> Any:
    if path is None or not path.is_file():
        raise MissingPart(
            "the body model SMPL-X has no model file" if path is None else f"no file at {path}",
            expected="SMPLX_NEUTRAL.npz or .pkl",
            hint=_WHERE,
        )
    if path.suffix not in (".npz", ".pkl"):
        raise DataError(f"{path} is no SMPL-X model", expected="an .npz or .pkl file", hint=_WHERE)
    return _loaded(path, path.stat().st_mtime_ns)


@functools.lru_cache(maxsize=1)
def _loaded(path: Path, changed_ns: int) -> Any:  # noqa: ARG001 - a changed file is read again
    try:
        import smplx
    except ImportError as error:
        raise MissingPart(
            "the package smplx is not installed", hint="Run: pip install smplx==0.1.28"
        ) from error
    try:
        model = smplx.SMPLX(
            str(path),
            ext=path.suffix[1:],
            num_betas=_BETAS,
            num_expression_coeffs=_EXPRESSIONS,
            use_pca=False,
            flat_hand_mean=True,
        )
    except (
        AttributeError, EOFError, ImportError, IndexError, KeyError, OSError, RuntimeError,
        TypeError, ValueError, pickle.UnpicklingError, zipfile.BadZipFile,
    ) as error:  # fmt: skip
        raise DataError(f"{path} is no SMPL-X model", got=repr(error), hint=_WHERE) from error
    shapes = {
        "v_template": (_VERTICES, 3),
        "J_regressor": (_JOINTS, _VERTICES),
        "lbs_weights": (_VERTICES, _JOINTS),
        "shapedirs": (_VERTICES, 3, _BETAS),
    }
    for name, shape in shapes.items():
        if tuple(getattr(model, name).shape) != shape:
            raise DataError(
                f"{path} is not SMPL-X but another model: its {name} has another shape",
                expected=str(shape),
                got=str(tuple(getattr(model, name).shape)),
                hint=_WHERE,
            )
    return model.requires_grad_(requires_grad=False)


def _free(name: str) -> FreeJoint:
    side, _, joint = name.rpartition("_")
    arm = {"left": (1.0, 0.0, 0.0), "right": (-1.0, 0.0, 0.0)}.get(side)
    return free_joint(name, _FREE_ROLES[joint], arm)


def _landmark_table(model: Any, joint_names: tuple[str, ...]) -> LandmarkTable:
    from smplx.vertex_ids import vertex_ids

    weights = model.lbs_weights.numpy()
    blends, carriers = {}, {}
    for landmark, name in _POINTS.items():
        vertex = vertex_ids["smplx"][name]
        blends[landmark] = (np.array([vertex]), np.ones(1))
        carriers[landmark] = int(weights[vertex].argmax())
    for landmark, name in _AT_JOINTS.items():
        joint = joint_names.index(name)
        row = model.J_regressor[joint].numpy()
        used = np.argsort(-row, kind="stable")[:_BLENDED]
        used = used[row[used] > 0]
        blends[landmark] = (used, row[used].astype(np.float64))
        carriers[landmark] = joint
    return table(blends, carriers, {}, dict.fromkeys(range(17, 23), _KNUCKLE_TRUST))


def _regions(model: Any, joint_names: tuple[str, ...]) -> dict[str, NDArray[np.bool_]]:
    mover = model.lbs_weights.numpy().argmax(axis=1)
    names = np.array(joint_names)[mover]
    head = np.isin(names, ["head", "jaw", "left_eye_smplhf", "right_eye_smplhf"])
    depth = model.v_template.numpy()[:, 2]
    fingers = [n for n in joint_names if n[-1] in "123" and n.split("_")[0] in ("left", "right")]
    return {
        **{
            f"{side}_hand": np.isin(
                names, [f"{side}_wrist", *(name for name in fingers if name.startswith(side))]
            )
            for side in ("left", "right")
        },
        "face": head & (depth > depth[head].mean()) if head.any() else head,
        "eyeballs": np.isin(names, ["left_eye_smplhf", "right_eye_smplhf"]),
    }

"""SMPL-X as a body for the fit, from the user's own licensed model file.

Source: Pavlakos et al., Expressive Body Capture, CVPR 2019; PyPI ``smplx``. Its rest frame is the
world's (+Y up, facing +Z) and its local axes are parallel to it, so poses need no conversion.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats
from harness.core.missing import compiler_left_out
from methods.body.models.anatomy import blend_landmarks, free_joint, table
from methods.body.models.model import MAIN_JOINTS, FreeJoint, LandmarkTable, Parameters, Posed
from methods.body.models.smplx_file import HAND, JOINTS, OWN, PIXIES, load_model
from methods.body.models.smplx_part import is_pixies, model_path, smplx_part
from methods.body.smplx_offsets import stored_offsets

if TYPE_CHECKING:
    from torch import Tensor

_BODY_JOINTS = 21
#: What the fit leaves as it is, besides the expression: size of each of the model's parameters.
_RESTING = {
    "jaw_pose": 3,
    "leye_pose": 3,
    "reye_pose": 3,
    "left_hand_pose": HAND,
    "right_hand_pose": HAND,
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
    """SMPL-X with 21 free joints; face, eyes and hands rest unless they are held or given.

    It has 10 shape values; 200 where they are those that PIXIE regresses.

    Attributes:
        has_pixie_shape: Whether its shape and expression values are those that PIXIE regresses.
    """

    name = "smplx"

    def __init__(self, model_file: str | Path) -> None:
        import torch
        from smplx.joint_names import JOINT_NAMES

        self.has_pixie_shape = is_pixies(str(model_file))
        spaces = PIXIES if self.has_pixie_shape else OWN
        self._model = load_model(model_path(str(model_file)), spaces)
        self.part = smplx_part(str(model_file))
        self.faces: NDArray[np.int32] = np.asarray(self._model.faces).astype(np.int32)
        self.joint_names = tuple(JOINT_NAMES[:JOINTS])
        self.roles: Mapping[str, int] = {
            role: self.joint_names.index(role) for role in (*MAIN_JOINTS, "head")
        }
        self.free = tuple(_free(name) for name in self.joint_names[1 : _BODY_JOINTS + 1])
        betas = int(self._model.num_betas)
        self.shape_prior = np.stack([np.zeros(betas), np.ones(betas)]).astype(np.float32)
        self.landmarks = _landmark_table(self._model, self.joint_names)
        self.regions: Mapping[str, NDArray[np.bool_]] = _regions(self._model, self.joint_names)
        self._parents = [int(parent) for parent in self._model.parents]
        self._torch = torch
        sizes = {"expression": int(self._model.num_expression_coeffs), **_RESTING}
        self._held = {name: torch.zeros(1, size) for name, size in sizes.items()}

    def holding(self, held: Mapping[str, Floats]) -> SmplxBody:
        """The same body with values (size,) of parameters that no fit changes.

        Args:
            held: By the package's names. Of more values than the model has, the first are taken.
        """
        other = copy.copy(self)
        other._held = dict(self._held)  # noqa: SLF001 - its own class
        for name, values in held.items():
            size = self._held[name].shape[1]
            row = self._torch.tensor(values[None, :size], dtype=self._held[name].dtype)
            other._held[name] = row  # noqa: SLF001 - its own class
        return other

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
        with compiler_left_out():
            import roma

        torch = self._torch
        pose = parameters["pose"]
        if pose.ndim == 4:
            pose = roma.rotmat_to_rotvec(roma.special_gramschmidt(pose))
        batch = len(pose)
        resting = {
            name: parameters.get(name, held.expand(batch, -1)) for name, held in self._held.items()
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
        local = roma.rotvec_to_rotmat(output.full_pose.reshape(batch, JOINTS, 3))
        turns = [root]
        for joint in range(1, JOINTS):
            turns.append(turns[self._parents[joint]] @ local[:, joint])
        return Posed(
            vertices=(output.vertices - pelvis) @ root.transpose(1, 2) + place,
            joints=(output.joints[:, :JOINTS] - pelvis) @ root.transpose(1, 2) + place,
            turns=torch.stack(turns, 1),
        )

    def landmark_points(self, posed: Posed) -> Tensor:
        """(B, K, 3) metres: the landmarks of the table."""
        return blend_landmarks(self.landmarks, posed)

    def sparse(self) -> SmplxBody:
        """The body itself: the package computes all vertices or none."""
        return self

    def precise(self) -> SmplxBody:
        """The same body in double precision."""
        other = copy.copy(self)
        other._model = copy.deepcopy(self._model).double()  # noqa: SLF001 - its own class
        other._held = {name: held.double() for name, held in self._held.items()}  # noqa: SLF001
        other.landmarks = replace(
            self.landmarks,
            weights=self.landmarks.weights.astype(np.float64),
            offsets=self.landmarks.offsets.astype(np.float64),
        )
        return other

    def export(self, parameters: Parameters) -> dict[str, NDArray[Any]]:
        """``betas``, ``body_pose``, ``transl`` and all others as the package takes them."""
        with compiler_left_out():
            import roma

        torch = self._torch
        with torch.no_grad():
            turn = roma.special_gramschmidt(parameters["orientation"][:1])
            root = self._rest_root(parameters["shape"][:1])
            transl = parameters["translation"][:1] - root
            return {
                "betas": parameters["shape"][:1].numpy(),
                "body_pose": parameters["pose"][:1].reshape(1, -1).numpy(),
                "global_orient": roma.rotmat_to_rotvec(turn).numpy(),
                "transl": transl.numpy(),
                **{name: held.numpy() for name, held in self._held.items()},
            }

    def rest_root(self, shape: Floats) -> Floats:
        """(3,) metres: where the root joint of a shape (S,) is before it is moved or turned."""
        torch = self._torch
        with torch.no_grad():
            root = self._rest_root(torch.tensor(shape[None], dtype=torch.float32))
        return root[0].double().numpy()

    def _rest_root(self, shape: Tensor) -> Tensor:
        torch = self._torch
        rest = self._model(
            betas=shape,
            **self._held,
            body_pose=torch.zeros(1, 3 * _BODY_JOINTS),
            global_orient=torch.zeros(1, 3),
            transl=torch.zeros(1, 3),
        )
        root: Tensor = rest.joints[:, 0]
        return root


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
    measured = stored_offsets()
    offsets_mm = dict(measured.offsets_mm) if measured else {}
    return table(blends, carriers, offsets_mm, dict.fromkeys(range(17, 23), _KNUCKLE_TRUST))


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

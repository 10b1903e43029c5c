"""Anny as a body for the fit: Apache-2.0, metres, shape from six phenotype values.

Source: Anny (NAVER Corp., PyPI ``anny``), pose parameterization ``local-ref``: rotations about the
model's own axes, here turned into the world's.
"""

from __future__ import annotations

import copy
import functools
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from harness.core.camera_frames import ANNY_TO_WORLD
from harness.core.files.atomic import exclusive_lock
from harness.core.missing import compiler_left_out, not_installed
from methods.body.models.anatomy import (
    ANNY_OFFSETS_MM,
    blend_landmarks,
    free_joint,
    sparse_vertices,
    table,
)
from methods.body.models.model import FreeJoint, LandmarkTable, Parameters, Posed
from methods.body.models.smplx_part import body_part

if TYPE_CHECKING:
    from torch import Tensor

_ANNY_TO_WORLD = ANNY_TO_WORLD.astype(np.float32)
_ARM = {"L": (0.7071, -0.7071, 0.0), "R": (-0.7071, -0.7071, 0.0)}
_SPINE = ("spine05", "spine04", "spine03", "spine02", "spine01")
_LIMBS = {
    "clavicle": "clavicle",
    "shoulder01": "clavicle",
    "upperarm01": "shoulder",
    "lowerarm01": "elbow",
    "wrist": "wrist",
    "upperleg01": "hip",
    "lowerleg01": "knee",
    "foot": "ankle",
}
_ROLES = {
    "shoulder": "upperarm01",
    "elbow": "lowerarm01",
    "wrist": "wrist",
    "hip": "upperleg01",
    "knee": "lowerleg01",
    "ankle": "foot",
}
#: A phenotype value is the logistic function of this times the fit's own number, so that a step of
#: that number changes the surface about as much as the same step of an angle does.
_LOGITS = 10.0
#: Phenotype values of grown people: mean, deviation.
_PHENOTYPE_PRIOR = {"age": (0.7, 0.10), "height": (0.38, 0.12)}
_OTHER_PRIOR = (0.5, 0.2)
#: MediaPipe index by keypoint of Anny's COCO regressor; the fingers' knuckles are bone heads.
_KEYPOINTS = {
    "nose": 0, "left_eye": 2, "right_eye": 5, "left_ear": 7, "right_ear": 8,
    "left_shoulder": 11, "right_shoulder": 12, "left_elbow": 13, "right_elbow": 14,
    "left_wrist": 15, "right_wrist": 16, "left_hip": 23, "right_hip": 24, "left_knee": 25,
    "right_knee": 26, "left_ankle": 27, "right_ankle": 28, "left_heel": 29, "right_heel": 30,
    "left_big_toe": 31, "right_big_toe": 32,
}  # fmt: skip
_KNUCKLES = {17: "finger5-1.L", 18: "finger5-1.R", 19: "finger2-1.L", 20: "finger2-1.R",
             21: "finger1-2.L", 22: "finger1-2.R"}  # fmt: skip
#: The hand that each knuckle is on: fingers are not fitted, so their landmarks count less.
_KNUCKLE_TRUST = 0.3
_CARRIERS = {0: "head", 2: "head", 5: "head", 7: "head", 8: "head",
             11: "upperarm01.L", 12: "upperarm01.R", 13: "upperarm01.L", 14: "upperarm01.R",
             15: "lowerarm01.L", 16: "lowerarm01.R", 17: "wrist.L", 18: "wrist.R", 19: "wrist.L",
             20: "wrist.R", 21: "wrist.L", 22: "wrist.R", 23: "root", 24: "root",
             25: "upperleg01.L", 26: "upperleg01.R", 27: "lowerleg01.L", 28: "lowerleg01.R",
             29: "foot.L", 30: "foot.R", 31: "foot.L", 32: "foot.R"}  # fmt: skip
#: Vertices of less than this share of a landmark's greatest weight are left out of it.
_LEAST_SHARE = 0.15


@functools.lru_cache(maxsize=1)
def _model() -> Any:
    try:
        with compiler_left_out():
            import anny
        import anny.paths
        import torch
    except ImportError as error:
        raise not_installed("anny", "the body model Anny") from error
    # Anny builds its model files on first use and does not write them atomically.
    with exclusive_lock(anny.paths.get_anny_cache_path() / "harness.lock"):
        # Its compact blend shapes come from a decomposition whose rounding, and even whose choice
        # of axes, depends on how many threads the machine had: fits would differ between machines.
        model = anny.Anny(topology="anny", skinning_method="lbs", phenotype_blendshapes="original")
        return model.to(torch.float32)


@functools.lru_cache(maxsize=1)
def _landmark_table() -> LandmarkTable:
    import anny

    model = _model()
    regressor = anny.KeypointsRegressor.coco(model)
    bones = list(model.bone_labels)
    dense = model.dense_vertex_bone_weights.numpy()
    blends = {}
    for name, landmark in _KEYPOINTS.items():
        weights = regressor.regression_weights[regressor.labels.index(name)].numpy()
        used = np.flatnonzero(weights >= _LEAST_SHARE * weights.max())
        blends[landmark] = (used, weights[used].astype(np.float64))
    for landmark, bone in _KNUCKLES.items():
        # The ring of skin that both bones of the knuckle move is centred on it.
        own = dense[:, bones.index(bone)]
        before = dense[:, model.bone_parents[bones.index(bone)]]
        ring = np.argsort(-np.minimum(own, before))[:24]
        blends[landmark] = (ring, np.ones(len(ring)))
    carriers = {landmark: bones.index(bone) for landmark, bone in _CARRIERS.items()}
    trust = dict.fromkeys(_KNUCKLES, _KNUCKLE_TRUST)
    return table(blends, carriers, ANNY_OFFSETS_MM, trust)


def forget() -> None:
    """Anny is read anew when it is next asked for."""
    _model.cache_clear()
    _landmark_table.cache_clear()


class AnnyBody:
    """Anny's default surface (13 718 vertices) with 25 free bones and 6 phenotype values."""

    name = "anny"

    def __init__(self) -> None:
        import torch

        self._model = _model()
        self.part = body_part(self.name)
        self.faces: NDArray[np.int32] = self._model.get_triangular_faces().numpy().astype(np.int32)
        self.joint_names = tuple(self._model.bone_labels)
        self.roles: Mapping[str, int] = {"head": self.joint_names.index("head")} | {
            f"{side}_{role}": self.joint_names.index(f"{bone}.{side[0].upper()}")
            for role, bone in _ROLES.items()
            for side in ("left", "right")
        }
        self.free = _free_joints()
        self.shape_prior = _shape_prior(self._model.phenotype_labels)
        self.landmarks = _landmark_table()
        self.regions: Mapping[str, NDArray[np.bool_]] = _regions(self._model)
        self._free_index = torch.tensor([self.joint_names.index(j.name) for j in self.free])
        self._to_world = torch.from_numpy(_ANNY_TO_WORLD)

    def __call__(self, parameters: Parameters) -> tuple[Tensor, Tensor]:
        """Vertices (B, V, 3) and joints (B, 104, 3), metres, world frame."""
        posed = self.posed(parameters)
        return posed.vertices, posed.joints

    def posed(self, parameters: Parameters) -> Posed:
        """The bodies of some parameters, world frame."""
        pose, shape = self._pose_parameters(parameters), parameters["shape"]
        rows = shape.detach().numpy()
        _, first, which = np.unique(rows, axis=0, return_index=True, return_inverse=True)
        if len(first) == len(shape):
            return self._in_world(self._output(pose, self._phenotypes(shape)))
        # Bodies of one shape, as differences of poses are, stand alike before they are posed.
        rest = self._output(None, self._phenotypes(shape[first]))
        vertices, bones = (
            rest[name][which.reshape(-1)] for name in ("rest_vertices", "rest_bone_poses")
        )
        moves, poses = self._model.get_bone_transforms(pose, bones)
        skinned = self._model.get_skinned_vertices(vertices, moves)
        return self._in_world({"vertices": skinned, "bone_poses": poses})

    def posed_as(
        self, pose_parameters: NDArray[np.float64], phenotype: Mapping[str, float]
    ) -> Posed:
        """One body from what ``export`` gives, or from a truth's file, world frame."""
        import torch

        pose = torch.as_tensor(pose_parameters, dtype=torch.float32)[None]
        with torch.no_grad():
            return self._in_world(self._output(pose, dict(phenotype)))

    def _output(
        self, pose: Tensor | None, phenotypes: Mapping[str, Tensor | float]
    ) -> dict[str, Tensor]:
        return self._model(pose_parameters=pose, phenotype_kwargs=phenotypes)

    def _in_world(self, output: Mapping[str, Tensor]) -> Posed:
        turn = self._to_world
        poses = output["bone_poses"]
        reference = self._model.reference_bone_orientations
        return Posed(
            vertices=output["vertices"] @ turn.T,
            joints=poses[:, :, :3, 3] @ turn.T,
            turns=turn @ poses[:, :, :3, :3] @ reference.transpose(-1, -2) @ turn.T,
        )

    def landmark_points(self, posed: Posed) -> Tensor:
        """(B, K, 3) metres: the landmarks of the table."""
        return blend_landmarks(self.landmarks, posed)

    def sparse(self) -> AnnyBody:
        """The same body with few vertices, enough for landmarks and extent; it has no faces."""
        used, landmarks = sparse_vertices(self.landmarks, len(self._model.template_vertices))
        return self._cut_to(used, landmarks)

    def precise(self) -> AnnyBody:
        """The same body in double precision with the vertices of its landmarks alone."""
        import torch

        used = np.unique(self.landmarks.vertices)
        landmarks = replace(
            self.landmarks,
            vertices=np.searchsorted(used, self.landmarks.vertices),
            weights=self.landmarks.weights.astype(np.float64),
            offsets=self.landmarks.offsets.astype(np.float64),
        )
        smaller = self._cut_to(used, landmarks)
        smaller._model = smaller._model.to(torch.float64)  # noqa: SLF001 - its own class
        smaller._to_world = self._to_world.double()  # noqa: SLF001 - its own class
        return smaller

    def _cut_to(self, used: NDArray[np.int64], landmarks: LandmarkTable) -> AnnyBody:
        import torch

        rows = torch.from_numpy(used)
        # What is cut to the rows anyway is not copied first: the shapes alone are 100 MB.
        large = ("template_vertices", "blendshapes", "dense_vertex_bone_weights")
        shared = [getattr(self._model, name) for name in large]
        model = copy.deepcopy(self._model, {id(values): values for values in shared})
        model.template_vertices = model.template_vertices[rows]
        model.blendshapes = model.blendshapes[:, rows]
        model.dense_vertex_bone_weights = model.dense_vertex_bone_weights[rows]
        smaller = copy.copy(self)
        smaller._model, smaller.landmarks = model, landmarks  # noqa: SLF001 - its own class
        smaller.faces = np.zeros((0, 3), dtype=np.int32)
        smaller.regions = {name: mask[used] for name, mask in self.regions.items()}
        return smaller

    def export(self, parameters: Parameters) -> dict[str, NDArray[Any]]:
        """Anny's ``pose_parameters`` (B, 4, 4) in its own axes, and the phenotype values."""
        import torch

        with torch.no_grad():
            pose = self._pose_parameters(parameters)[0].numpy()
            values = torch.sigmoid(_LOGITS * parameters["shape"])[0].numpy()
        return {
            "pose_parameters": pose,
            "phenotype": values,
            "phenotype_names": np.array(self._model.phenotype_labels),
        }

    def _phenotypes(self, shape: Tensor) -> dict[str, Tensor]:
        import torch

        values = torch.sigmoid(_LOGITS * shape)
        return {name: values[:, i] for i, name in enumerate(self._model.phenotype_labels)}

    def _pose_parameters(self, parameters: Parameters) -> Tensor:
        import roma
        import torch

        turn = self._to_world
        pose = parameters["pose"]
        deltas = torch.eye(4, dtype=pose.dtype).repeat(len(pose), len(self.joint_names), 1, 1)
        # Row vectors: v_anny = v_world @ turn is the inverse of v_world = v_anny @ turn.T.
        deltas[:, self._free_index, :3, :3] = roma.rotvec_to_rotmat(pose @ turn)
        root = roma.special_gramschmidt(parameters["orientation"])
        deltas[:, 0, :3, :3] = turn.T @ root @ turn
        deltas[:, 0, :3, 3] = parameters["translation"] @ turn
        return deltas


def _free_joints() -> tuple[FreeJoint, ...]:
    trunk = [free_joint(bone, "spine") for bone in _SPINE]
    top = [free_joint(bone, "neck") for bone in ("neck01", "neck03")] + [free_joint("head", "head")]
    limbs = [
        free_joint(f"{bone}.{side}", role, _ARM[side])
        for side in ("L", "R")
        for bone, role in _LIMBS.items()
    ]
    return (*trunk, *top, *limbs)


def _shape_prior(labels: list[str]) -> NDArray[np.float32]:
    rows = []
    for label in labels:
        mean, deviation = _PHENOTYPE_PRIOR.get(label, _OTHER_PRIOR)
        # d logit = d value / (value (1 - value)).
        rows.append((np.log(mean / (1 - mean)), deviation / (mean * (1 - mean))))
    return np.array(rows, dtype=np.float32).T / np.float32(_LOGITS)


def _regions(model: Any) -> dict[str, NDArray[np.bool_]]:
    bones = list(model.bone_labels)
    dense = model.dense_vertex_bone_weights.numpy()

    def moved_by(*prefixes: str) -> NDArray[np.bool_]:
        own = [index for index, bone in enumerate(bones) if bone.startswith(prefixes)]
        return dense[:, own].sum(1) > 0.5

    vertices = model.template_vertices.numpy() @ _ANNY_TO_WORLD.T
    head = vertices[moved_by("head")]
    low, high = head.min(0), head.max(0)
    # In front of the head's middle and below the hairline.
    front = (vertices[:, 2] > (low[2] + high[2]) / 2) & (
        vertices[:, 1] < low[1] + 0.75 * (high[1] - low[1])
    )
    return {
        **_hands(moved_by("wrist", "finger", "metacarpal"), vertices),
        "face": moved_by("head") & front,
        "eyeballs": moved_by("eye"),
    }


def _hands(hands: NDArray[np.bool_], vertices: NDArray[np.floating[Any]]) -> dict[str, Any]:
    """The two hands (V,) among vertices (V, 3) of the rest pose; the person's left is at +x."""
    is_left = vertices[:, 0] > 0
    return {"left_hand": hands & is_left, "right_hand": hands & ~is_left}

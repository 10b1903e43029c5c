"""What the fit needs of a parametric body, whichever model it is.

All bodies here live in the world frame (+Y up, facing +Z, metres). A pose is one rotation vector
for each free joint, about the world's axes as they are at the joint in the rest pose before its
parents move, so that priors and limits mean the same for every model.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from harness.core.protocols import Part

if TYPE_CHECKING:
    from torch import Tensor


#: ``orientation`` (B, 3, 2): the first two columns of the body's rotation, in any length;
#: ``translation`` (B, 3): where the root joint is, metres; ``pose`` (B, R, 3): rotation vectors of
#: the free joints, radians; ``shape`` (B, S): the model's own shape values.
Parameters = Mapping[str, Any]

#: The joints that errors are measured at, by the name of the role that every model gives them.
MAIN_JOINTS = tuple(
    f"{side}_{joint}"
    for joint in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
    for side in ("left", "right")
)


@dataclass(frozen=True, slots=True)
class FreeJoint:
    """A joint that the fit may turn, and what is known of it before any picture is seen.

    Attributes:
        name: The model's own name.
        stiffness: Weight of the squared rotation about x, y and z; 1 for a limb.
        hinge: Unit axis about which the joint bends, where it bends one way only.
        least_rad: Bending below this is against the joint's limit.
    """

    name: str
    stiffness: tuple[float, float, float] = (1.0, 1.0, 1.0)
    hinge: tuple[float, float, float] | None = None
    least_rad: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class LandmarkTable:
    """Where MediaPipe's landmarks are on a body: blends of vertices, moved along with a joint.

    Attributes:
        landmarks: (K,) MediaPipe indices of the landmarks that the body has.
        vertices: (K, S) vertex indices.
        weights: (K, S) their weights; each row sums to 1.
        carriers: (K,) joint whose rotation carries the offset.
        offsets: (K, 3) metres in the rest pose, from the blend to what MediaPipe marks.
        trust: (K,) factor on the detector's confidence.
    """

    landmarks: NDArray[np.int64]
    vertices: NDArray[np.int64]
    weights: NDArray[np.float32]
    carriers: NDArray[np.int64]
    offsets: NDArray[np.float32]
    trust: NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class Posed:
    """Bodies in the world frame.

    Attributes:
        vertices: (B, V, 3) metres.
        joints: (B, J, 3) metres.
        turns: (B, J, 3, 3) rotation of each joint from the rest pose to the world.
    """

    vertices: Tensor
    joints: Tensor
    turns: Tensor


class ParametricBody(Protocol):
    """A differentiable body: what a fit needs of it.

    Attributes:
        name: The model's, as records have it.
        part: As records name it.
        faces: (F, 3) vertex indices.
        joint_names: The model's own, in the order of its joints.
        roles: Joint index by role: the ``MAIN_JOINTS`` and ``head``.
        free: The joints that ``pose`` turns, in its order.
        shape_prior: (2, S) mean and standard deviation of the shape values.
        landmarks: MediaPipe's landmarks on this body.
        regions: (V,) masks ``left_hand``, ``right_hand``, ``face`` and ``eyeballs``.
    """

    name: str
    part: Part
    faces: NDArray[np.int32]
    joint_names: tuple[str, ...]
    roles: Mapping[str, int]
    free: tuple[FreeJoint, ...]
    shape_prior: NDArray[np.float32]
    landmarks: LandmarkTable
    regions: Mapping[str, NDArray[np.bool_]]

    def __call__(self, parameters: Parameters) -> tuple[Any, Any]:
        """Vertices (B, V, 3) and joints (B, J, 3), metres, world frame."""
        ...

    def posed(self, parameters: Parameters) -> Posed:
        """The same with the joints' rotations."""
        ...

    def landmark_points(self, posed: Posed) -> Tensor:
        """(B, K, 3) metres: the landmarks of the table."""
        ...

    def sparse(self) -> ParametricBody:
        """The same body with few vertices, enough for its landmarks and its extent."""
        ...

    def precise(self) -> ParametricBody:
        """The same body in double precision, for its landmarks."""
        ...

    def export(self, parameters: Parameters) -> dict[str, NDArray[Any]]:
        """The parameters of one body as the model's own software takes them."""
        ...


def box_middle(vertices: Tensor) -> Tensor:
    """(B, 3) middle of each body's box in the world's axes, of vertices (B, V, 3)."""
    return (vertices.amin(1) + vertices.amax(1)) / 2


def neutral(body: ParametricBody, batch: int = 1) -> dict[str, Tensor]:
    """Parameters of ``batch`` bodies of mean shape in the rest pose, upright at the origin."""
    import torch

    mean = torch.from_numpy(body.shape_prior[0])
    return {
        "orientation": torch.eye(3)[:, :2].repeat(batch, 1, 1),
        "translation": torch.zeros(batch, 3),
        "pose": torch.zeros(batch, len(body.free), 3),
        "shape": mean.repeat(batch, 1),
    }

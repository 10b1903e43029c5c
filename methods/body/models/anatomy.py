"""What every human body has in common: which joints bend how far, and where landmarks sit."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from methods.body.models.model import FreeJoint, LandmarkTable, Posed

Triple = tuple[float, float, float]

#: Stiffness about x, y, z by role: trunk and shoulder girdle move little, a knee turns about x.
_STIFFNESS: dict[str, Triple] = {
    "spine": (8.0, 8.0, 8.0),
    "neck": (8.0, 8.0, 8.0),
    "head": (2.0, 2.0, 2.0),
    "clavicle": (12.0, 12.0, 12.0),
    "shoulder": (1.0, 1.0, 1.0),
    "elbow": (1.0, 1.0, 1.0),
    "wrist": (4.0, 4.0, 4.0),
    "hip": (1.0, 1.0, 1.0),
    "knee": (1.0, 10.0, 10.0),
    "ankle": (4.0, 4.0, 4.0),
    "foot": (8.0, 8.0, 8.0),
}
_KNEE_LEAST_RAD = -0.05
_ELBOW_LEAST_RAD = -0.15
#: One vertex in so many gives a body's extent: with 13 718, the middle of its box to some 3 mm.
_EXTENT_STEP = 16


def free_joint(name: str, role: str, arm_axis: Triple | None = None) -> FreeJoint:
    """A free joint with the prior of its role.

    Args:
        name: The model's own.
        role: A key of the stiffness table.
        arm_axis: For an elbow: direction of the arm in the rest pose.
    """
    if role == "knee":
        return FreeJoint(name, _STIFFNESS[role], (1.0, 0.0, 0.0), _KNEE_LEAST_RAD)
    if role == "elbow" and arm_axis is not None:
        # Bending brings the forearm forward (+Z): it turns about arm x forward.
        axis = np.cross(arm_axis, (0.0, 0.0, 1.0))
        x, y, z = axis / np.linalg.norm(axis)
        return FreeJoint(name, _STIFFNESS[role], (float(x), float(y), float(z)), _ELBOW_LEAST_RAD)
    return FreeJoint(name, _STIFFNESS[role])


def table(
    blends: dict[int, tuple[NDArray[np.int64], NDArray[np.float64]]],
    carriers: dict[int, int],
    offsets_mm: dict[int, Triple],
    trust: dict[int, float],
) -> LandmarkTable:
    """The landmark table of blends (vertex indices and weights) by MediaPipe index."""
    order = sorted(blends)
    most = max(len(indices) for indices, _ in blends.values())
    vertices = np.zeros((len(order), most), dtype=np.int64)
    weights = np.zeros((len(order), most), dtype=np.float32)
    for row, landmark in enumerate(order):
        indices, share = blends[landmark]
        vertices[row, : len(indices)] = indices
        weights[row, : len(indices)] = share / share.sum()
    offsets = np.array([offsets_mm.get(landmark, (0.0, 0.0, 0.0)) for landmark in order]) / 1000.0
    return LandmarkTable(
        landmarks=np.array(order),
        vertices=vertices,
        weights=weights,
        carriers=np.array([carriers[landmark] for landmark in order]),
        offsets=offsets.astype(np.float32),
        trust=np.array([trust.get(landmark, 1.0) for landmark in order], dtype=np.float32),
    )


def sparse_vertices(
    landmarks: LandmarkTable, count: int
) -> tuple[NDArray[np.int64], LandmarkTable]:
    """The (N,) vertices out of ``count`` that give landmarks and extent, and their own table."""
    used = np.union1d(landmarks.vertices, np.arange(0, count, _EXTENT_STEP))
    return used, replace(landmarks, vertices=np.searchsorted(used, landmarks.vertices))


def blend_landmarks(landmarks: LandmarkTable, posed: Posed):  # noqa: ANN201
    """(B, K, 3) landmarks of posed bodies, metres."""
    import torch

    device = posed.vertices.device
    corners = posed.vertices[:, torch.from_numpy(landmarks.vertices).to(device)]
    weights = torch.from_numpy(landmarks.weights).to(device)
    points = (weights[None, :, :, None] * corners).sum(2)
    turns = posed.turns[:, torch.from_numpy(landmarks.carriers).to(device)]
    offsets = torch.from_numpy(landmarks.offsets).to(device)
    return points + (turns @ offsets[None, :, :, None])[..., 0]


#: MediaPipe's bodies in space lean this much towards the camera, about its x axis: the median over
#: eight views of six generated training subjects (standard deviation 3.3).
LEAN_DEG = 5.0

#: Millimetres in the world's axes of the rest pose, by MediaPipe index.
ANNY_OFFSETS_MM: dict[int, tuple[float, float, float]] = {
    0: (0, 18, -6),
    2: (-10, 20, -15),
    5: (10, 20, -15),
    7: (-22, 19, 14),
    8: (22, 19, 14),
    11: (15, 3, -2),
    12: (-15, 3, -2),
    13: (1, -15, -19),
    14: (-1, -15, -19),
    15: (3, -4, 3),
    16: (-3, -4, 3),
    17: (-11, 20, 11),
    18: (11, 20, 11),
    19: (-5, -4, -27),
    20: (5, -4, -27),
    21: (18, -17, -9),
    22: (-18, -17, -9),
    23: (9, -9, 0),
    24: (-9, -9, 0),
    25: (-20, -8, 13),
    26: (20, -8, 13),
    27: (-4, 6, 0),
    28: (4, 6, 0),
    29: (-16, 3, -5),
    30: (16, 3, -5),
    31: (16, 10, -20),
    32: (-16, 10, -20),
}

"""How well a fitted body agrees with the pictures, and with the true body where that is known.

The losses are those of the paper's first table, each per image and without unit: the square frame
around the subject that they refer to has an area of 1 and a half side of 1, whatever the picture's
size. Errors are in millimetres and without any alignment.

Source: MExECON, equations of the silhouette, normal and landmark loss and table "JMBO ablation".
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats, Mask
from harness.core.errors import DataError
from harness.core.mesh import Mesh
from harness.core.records import MetricValue
from harness.core.units import MM_PER_METRE, Unit
from harness.geometry.surface import SurfaceIndex, vertex_normals
from metrics.distance import nearest_surface_mm
from metrics.normals import angles_deg

#: Weights of the normal and the landmark loss in the total; the silhouette's is 1.
TOTAL_WEIGHTS = {"normal": 0.2, "landmark": 0.1}


def silhouette_loss(predicted: Mask, truth: Mask, side_px: float) -> float:
    """Area where two silhouettes (H, W) differ, as a share of the subject's frame."""
    _check_same_shape(predicted, truth)
    return float((predicted != truth).sum()) / side_px**2


def silhouette_iou(predicted: Mask, truth: Mask) -> float:
    """Intersection over union of two silhouettes (H, W); 1 where both are empty."""
    _check_same_shape(predicted, truth)
    union = float((predicted | truth).sum())
    return float((predicted & truth).sum()) / union if union else 1.0


def normal_loss(predicted: Floats, truth: Floats, side_px: float) -> float:
    """Mean absolute difference of two normal maps (H, W, 3) where both have one.

    The mean is over the three components and over the subject's whole frame, where pixels without
    both normals count as 0, as in ECON.
    """
    _check_same_shape(predicted, truth)
    known = predicted.any(axis=2) & truth.any(axis=2)
    return float(np.abs(predicted - truth)[known].mean(axis=1).sum()) / side_px**2


def landmark_loss(projected: Floats, detected: Floats, confidence: Floats, side_px: float) -> float:
    """Confidence-weighted mean distance of landmarks (K, 2), in half sides of the frame.

    NaN where nothing was detected: such an image has no landmark loss.
    """
    _check_same_shape(projected, detected)
    if not confidence.sum() > 0:
        return float("nan")
    distances_px = np.linalg.norm(projected - detected, axis=1)
    return float((confidence * distances_px).sum() / confidence.sum()) * 2.0 / side_px


def total_loss(silhouette: float, normal: float, landmark: float) -> float:
    """The weighted sum of the three losses, as in the paper's table."""
    return silhouette + TOTAL_WEIGHTS["normal"] * normal + TOTAL_WEIGHTS["landmark"] * landmark


def joint_error_mm(predicted: Floats, truth: Floats) -> Floats:
    """(J,) distances of joints (J, 3), metres, to the true ones, in mm; nothing is aligned."""
    return _distances_mm(predicted, truth)


def vertex_error_mm(predicted: Floats, truth: Floats) -> Floats:
    """(V,) distances of vertices (V, 3), metres, to the same vertices of the true body, in mm."""
    return _distances_mm(predicted, truth)


def _distances_mm(predicted: Floats, truth: Floats) -> Floats:
    _check_same_shape(predicted, truth)
    return np.linalg.norm(predicted - truth, axis=1) * MM_PER_METRE


def _check_same_shape(predicted: NDArray[Any], truth: NDArray[Any]) -> None:
    if predicted.shape != truth.shape:
        raise DataError(
            "two bodies or pictures cannot be compared: they have different shapes",
            expected=str(truth.shape),
            got=str(predicted.shape),
        )


SMPL_JOINTS = (
    "pelvis", "left_hip", "right_hip", "spine1", "left_knee", "right_knee", "spine2", "left_ankle",
    "right_ankle", "spine3", "left_foot", "right_foot", "neck", "left_collar", "right_collar",
    "head", "left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist",
    "right_wrist", "left_hand", "right_hand",
)  # fmt: skip
LSP_JOINTS = (
    "right_ankle", "right_knee", "right_hip", "left_hip", "left_knee", "left_ankle", "right_wrist",
    "right_elbow", "right_shoulder", "left_shoulder", "left_elbow", "left_wrist", "neck", "head",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class BodyProtocol:
    """Which joints count, and what is brought to the origin.

    Attributes:
        name: As in tables.
        version: Changes whenever the numbers may change for equal bodies.
        joints: Whose errors are averaged, and which Procrustes brings together.
        root: The mean of these comes to the origin first.
        turned: Whose rotations, in the world, are compared; none where it compares no angles.
    """

    name: str
    version: int
    joints: tuple[str, ...]
    root: tuple[str, ...]
    turned: tuple[str, ...] = ()


#: SMPL's 24 joints, about the middle of the hips; angles of nine.
EMDB = BodyProtocol(
    *("body-emdb", 1, SMPL_JOINTS, ("left_hip", "right_hip")),
    turned=tuple(SMPL_JOINTS[k] for k in (0, 1, 2, 4, 5, 16, 17, 18, 19)),
)
#: The 14 joints of LSP, regressed as for Human3.6M, about its pelvis, which is not one of them.
THREEDPW14 = BodyProtocol("body-3dpw14", 1, LSP_JOINTS, ("pelvis",))
BODY_PROTOCOLS: Mapping[str, BodyProtocol] = {each.name: each for each in (EMDB, THREEDPW14)}


@dataclass(frozen=True, slots=True, eq=False)
class BodyPose:
    """One body.

    Attributes:
        joints: (3,) metres, by name.
        vertices: (V, 3) metres, or None.
        rotations: (3, 3) of each joint, in the world, by name; empty where they are not known.
    """

    joints: Mapping[str, Floats]
    vertices: Floats | None = None
    rotations: Mapping[str, Floats] | None = None


def body_numbers(
    predicted: BodyPose, truth: BodyPose, protocol: BodyProtocol
) -> dict[str, MetricValue]:
    """MPJPE and PA-MPJPE in mm; PVE and PA-PVE where both have vertices, MPJAE where rotations.

    Procrustes is from the joints alone, with the scale of least squares and without reflection, and
    is applied to vertices and rotations as well.

    Raises:
        DataError: a joint that a body does not have, or vertices that are not the same.
    """
    mine, true = (_rooted(body, protocol) for body in (predicted, truth))
    scale, turn, shift = procrustes(mine.joints, true.joints)
    found = {
        "mpjpe": _mean_mm(mine.joints, true.joints),
        "pa_mpjpe": _mean_mm(scale * mine.joints @ turn.T + shift, true.joints),
    }
    if mine.vertices is not None and true.vertices is not None:
        if mine.vertices.shape != true.vertices.shape:
            raise DataError(
                "two bodies cannot be compared vertex by vertex",
                expected=str(true.vertices.shape),
                got=str(mine.vertices.shape),
            )
        found["pve"] = _mean_mm(mine.vertices, true.vertices)
        moved = scale * mine.vertices @ turn.T + shift
        found["pa_pve"] = _mean_mm(moved, true.vertices)
    if protocol.turned and predicted.rotations and truth.rotations:
        mine_r = _of(predicted.rotations, protocol.turned)
        true_r = _of(truth.rotations, protocol.turned)
        found["mpjae"] = _mean_deg(mine_r, true_r)
        found["pa_mpjae"] = _mean_deg(turn @ mine_r, true_r)
    return found


def procrustes(moving: Floats, fixed: Floats) -> tuple[float, Floats, Floats]:
    """Scale, (3, 3) rotation and (3,) shift that bring (N, 3) points nearest to (N, 3) others."""
    middle, target = moving.mean(axis=0), fixed.mean(axis=0)
    centred = moving - middle
    left, sizes, right = np.linalg.svd((fixed - target).T @ centred)
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    turn = (left * sign) @ right
    scale = float((sizes * sign).sum() / (centred**2).sum())
    return scale, turn, target - scale * turn @ middle


@dataclass(frozen=True, slots=True, eq=False)
class _Rooted:
    joints: Floats
    vertices: Floats | None


def _rooted(body: BodyPose, protocol: BodyProtocol) -> _Rooted:
    root = _of(body.joints, protocol.root).mean(axis=0)
    vertices = None if body.vertices is None else body.vertices - root
    return _Rooted(_of(body.joints, protocol.joints) - root, vertices)


def _of(values: Mapping[str, Floats], names: tuple[str, ...]) -> Floats:
    missing = [name for name in names if name not in values]
    if missing:
        raise DataError(
            "a body lacks joints of the protocol",
            expected=", ".join(names),
            got=f"no {', '.join(missing)}",
        )
    return np.stack([values[name] for name in names])


def _mean_mm(mine: Floats, true: Floats) -> MetricValue:
    lengths = np.linalg.norm(mine - true, axis=1) * MM_PER_METRE
    return MetricValue(float(lengths.mean()), Unit.millimetre.value, len(lengths), 0.0)


def _mean_deg(mine: Floats, true: Floats) -> MetricValue:
    """Mean angle of the turns between (N, 3, 3) rotations."""
    between = mine @ np.swapaxes(true, 1, 2)
    axis = np.stack([between[:, i, j] - between[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))], 1)
    along = np.trace(between, axis1=1, axis2=2) - 1
    angles = np.degrees(np.arctan2(np.linalg.norm(axis, axis=1), along))
    return MetricValue(float(angles.mean()), Unit.degree.value, len(angles), 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class VertexErrors:
    """One number of each kind for every vertex.

    Attributes:
        distance_mm: (V,) to the nearest point of the true surface.
        normal_deg: (V,) between the vertex's normal and the smooth normal of that point; NaN where
            one of them does not exist, as at a vertex without faces.
    """

    distance_mm: Floats
    normal_deg: Floats


def vertex_errors(mesh: Mesh, truth: SurfaceIndex) -> VertexErrors:
    """The errors of every vertex of a mesh; both in metres, in one frame.

    Raises:
        DataError: a vertex that is absurdly far away.
    """
    nearest, distance_mm = nearest_surface_mm(mesh.vertices, truth)
    own, true = vertex_normals(mesh), truth.smooth_normals(nearest)
    has_normal = own.any(axis=1) & np.isfinite(true[:, 0])
    normal_deg = np.full(len(own), np.nan)
    normal_deg[has_normal] = angles_deg(own[has_normal], true[has_normal])
    return VertexErrors(distance_mm, normal_deg)

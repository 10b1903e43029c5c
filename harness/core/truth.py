"""What is known of a generated subject besides its surface: true body, parameters and regions.

The files lie beside the scan. Datasets of real people have none of them.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from harness.core.arrays import Floats, Ints, Mask
from harness.core.artifacts import Scan
from harness.core.errors import DataError
from harness.core.files.npz import read_array_npz
from harness.core.mesh import Mesh
from harness.core.units import MM_PER_METRE

#: In the file of a true body: how far (r.m.s., metres) its surface is from what the body model
#: gives for its parameters; absent where the model gives the surface itself.
OFF_MODEL = "off_model_rms_m"
#: Labels of the person; what has any other label is worn.
BODY_REGIONS = frozenset({"head", "eyes", "hair", "skin", "torso", "arms", "hands", "legs", "feet"})

_BODY_ARRAYS = ("vertices", "joints", "joint_names")
_POSE = "pose_parameters"
_PARAMETER_ARRAYS = (_POSE, "phenotype", "phenotype_names")
_LABEL_ARRAYS = ("face_labels", "names")


@dataclass(frozen=True, slots=True, eq=False)
class TrueBody:
    """A subject's true body in the world frame."""

    vertices: Floats
    """(V, 3) metres."""
    joints: Floats
    """(J, 3) metres, in the order of ``joint_names``."""
    joint_names: tuple[str, ...]
    """As the body model that generated the subject names them."""
    off_model_mm: float = 0.0
    """How far the vertices are (root mean square) from the surface that the body model gives for
    the subject's parameters; 0 where the body is one of the model's."""
    pose: Floats | None = None
    """(J, 4, 4) Anny's pose parameters, in its own axes; None where the file has none."""
    turn: Floats = field(default_factory=lambda: np.eye(3))
    """(3, 3) turns the frame in which the pose holds into the world."""


@dataclass(frozen=True, slots=True, eq=False)
class TrueParameters:
    """What re-creates a generated subject's Anny body, in the scan's own frame."""

    pose_parameters: Floats
    """(J, 4, 4) in Anny's axes, ``local-ref``."""
    phenotype: Mapping[str, float]
    """Values in [0, 1] by name."""
    off_model_m: float = 0.0
    """How far the true surface is (root mean square) from the one that these give; 0 where the body
    is one of Anny's. Joints are where these put them either way."""


@dataclass(frozen=True, slots=True, eq=False)
class FaceRegions:
    """Which region each face of a true surface belongs to."""

    names: tuple[str, ...]
    """Names of the regions."""
    of_face: Ints
    """(F,) indices of ``names``."""

    @property
    def worn(self) -> Mask:
        """(F,) whether a face is of a garment or a shoe."""
        return np.array([name not in BODY_REGIONS for name in self.names], dtype=bool)[self.of_face]


def true_body(scan: Scan) -> TrueBody | None:
    """The true body beside a scan, or None where the dataset has none.

    Raises:
        DataError: the file is not one that the avatars' generator writes.
    """
    if scan.body_path is None:
        return None
    try:
        file = read_array_npz(scan.body_path, (*_BODY_ARRAYS, OFF_MODEL, _POSE))
        vertices, joints = file["vertices"], file["joints"]
        names = tuple(str(name) for name in file["joint_names"])
        off_m = float(file[OFF_MODEL]) if OFF_MODEL in file else 0.0
    except (DataError, KeyError, ValueError) as error:
        raise DataError(f"{scan.body_path} is no true body", got=repr(error)) from error
    turn, shift = scan.scan_to_world[:3, :3], scan.scan_to_world[:3, 3]
    return TrueBody(
        vertices=vertices @ turn.T + shift,
        joints=joints @ turn.T + shift,
        joint_names=names,
        off_model_mm=off_m * MM_PER_METRE,
        pose=file.get(_POSE),
        turn=turn / np.cbrt(np.linalg.det(turn)),
    )


def true_parameters(scan: Scan) -> TrueParameters:
    """What re-creates the subject's Anny body.

    For a body that was moved off the model, ``off_model_m`` says how far: its joints are
    re-created, its surface only to that distance, as far as any fit of the model can come.

    Raises:
        DataError: no true body beside the scan, or not one of Anny's.
    """
    if scan.body_path is None:
        raise DataError(f"scan of '{scan.subject}' has no true body", expected="a body.npz")
    file = read_array_npz(scan.body_path, (*_PARAMETER_ARRAYS, OFF_MODEL))
    missing = [name for name in _PARAMETER_ARRAYS if name not in file]
    if missing:
        raise DataError(
            f"{scan.body_path} is no Anny body",
            expected=", ".join(_PARAMETER_ARRAYS),
            got=", ".join(file) or "none of them",
        )
    names = [str(name) for name in file["phenotype_names"]]
    values = [float(value) for value in file["phenotype"]]
    off_m = float(file[OFF_MODEL]) if OFF_MODEL in file else 0.0
    return TrueParameters(file[_POSE], dict(zip(names, values, strict=True)), off_m)


def face_regions(scan: Scan, truth: Mesh) -> FaceRegions | None:
    """The regions of a scan's faces, or None where the dataset has no labels.

    Args:
        scan: Where the labels lie.
        truth: The scan's mesh, with its faces in the file's order.

    Raises:
        DataError: the file is not one that the avatars' generator writes, or is of another mesh.
    """
    path = scan.labels_path
    if path is None:
        return None
    try:
        file = read_array_npz(path, _LABEL_ARRAYS)
        labels = file["face_labels"].astype(np.int64)
        names = tuple(str(name) for name in file["names"])
    except (DataError, KeyError, ValueError) as error:
        raise DataError(f"{path} holds no labels of faces", got=repr(error)) from error
    if labels.shape != (len(truth.faces),):
        raise DataError(
            f"{path} does not fit {scan.mesh_path.name}",
            expected=f"{len(truth.faces)} labels, one per face",
            got=f"shape {labels.shape}",
        )
    if not 0 <= labels.min() <= labels.max() < len(names):
        raise DataError(
            f"{path} has faces of no named region",
            expected=f"labels from 0 to {len(names) - 1}",
            got=f"{labels.min()} to {labels.max()}",
        )
    return FaceRegions(names, labels)

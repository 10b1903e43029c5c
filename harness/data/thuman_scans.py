"""A scan of THuman becomes metres in the world frame by its SMPL-X fit, wherever the fit lies.

Scans whose rules need no fit are placed as all others are (``harness/data/scans.py``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from harness.core.array_files.pickles import read_array_pickle
from harness.core.arrays import Floats
from harness.core.artifacts import Scan
from harness.core.errors import DataError
from harness.core.files.hashing import file_sha256
from harness.core.mesh import Mesh
from harness.core.process.source_digest import SourceTree
from harness.core.units import UNITS_RULE
from harness.data.scans import height_warnings, load_scan, locate_scan
from harness.data.stature import stature
from harness.data.thuman_trees import ThumanFiles, find_thuman

if TYPE_CHECKING:
    from harness.data.manifest import Dataset

#: Vertices of SMPL-X: a mesh of so many is the body of a fit.
_BODY_VERTICES = 10475
#: The scans of version 2.0; later ones stand in frames of their own.
_LAST_UPRIGHT = 525
#: A fit whose body leans more than this stands in a frame that is not upright.
_LEAN_DEG = 40.0


@dataclass(frozen=True, slots=True)
class _Placed:
    """How a fit places its scan.

    Attributes:
        units_per_metre: What it says of the size.
        upright: (3, 3) rotation that makes the scan stand, the identity for most.
        yaw_rad: Where the upright scan faces, from +Z about +Y.
        warnings: What was done that is out of the ordinary.
    """

    units_per_metre: float
    upright: Floats
    yaw_rad: float
    warnings: tuple[str, ...] = ()


def locate_thuman(name: str, dataset: Dataset, root: Path, subject: str) -> Scan:
    """A subject's scan as it lies on disk; arguments and errors as ``locate_scan``."""
    files = find_thuman(root, subject)
    return _located(name, dataset, files, subject)


def load_thuman(name: str, dataset: Dataset, root: Path, subject: str) -> tuple[Scan, Mesh]:
    """A subject's scan, and its textured mesh in world metres.

    Raises:
        DataError: as ``load_scan``; the body of a fit in place of a scan; a scan that does not
            stand upright and that its fit cannot put upright.
    """
    files = find_thuman(root, subject)
    scan = _located(name, dataset, files, subject)
    in_file = dataset.model_copy(update={"scale": UNITS_RULE, "facing": "+z"})
    if "fit" not in (dataset.scale, dataset.facing):
        in_file = dataset
    placed, mesh = load_scan(name, in_file, files.mesh.parent.parent, subject)
    _refuse_a_body(mesh)
    if in_file is dataset:
        warnings = (*placed.warnings, *files.warnings)
        return replace(
            scan,
            scan_to_world=placed.scan_to_world,
            warnings=warnings,
            front_yaw_deg=placed.front_yaw_deg,
        ), mesh
    rule = _of_fit(files, subject)
    if dataset.scale == UNITS_RULE:
        if not np.allclose(rule.upright, np.eye(3)):
            raise _lying(subject, "its own frame is kept under the rule 'units'")
        return replace(
            scan, front_yaw_deg=math.degrees(rule.yaw_rad), warnings=files.warnings
        ), mesh
    scan_to_world = _placement(mesh, dataset, rule, subject)
    world = mesh.transformed(scan_to_world)
    heights = height_warnings(
        subject,
        "by its fit",
        float(world.extent[1]),
        "Its fit is of another scan, or of an early release: get the latest fits",
    )
    warnings = (*heights, *rule.warnings, *files.warnings)
    return replace(scan, scan_to_world=scan_to_world, warnings=warnings), world


def _located(name: str, dataset: Dataset, files: ThumanFiles, subject: str) -> Scan:
    found = locate_scan(name, dataset, files.mesh.parent.parent, subject)
    sha256 = dict(found.sha256)
    if "fit" in (dataset.scale, dataset.facing) and files.fit:
        sha256[files.fit.name] = file_sha256(files.fit)
    reader = SourceTree.installed().digest([__name__], [SourceTree.__module__]).to_dict()
    return replace(found, sha256=sha256, reader=reader)


def _refuse_a_body(mesh: Mesh) -> None:
    if len(mesh.vertices) == _BODY_VERTICES:
        raise DataError(
            f"{mesh.source} is the body of a fit and not a scan",
            expected="the scan, with some hundred thousand vertices",
            got=f"{_BODY_VERTICES} vertices, which are SMPL-X's",
            hint="Unpack the archive of the scans; mesh_smplx.obj is not one of them",
        )


def _of_fit(files: ThumanFiles, subject: str) -> _Placed:
    if files.fit is None:
        raise DataError(
            f"subject '{subject}' has no SMPL-X fit, which the manifest's rule 'fit' needs",
            expected=f"{subject}/smplx_param.pkl below the root, or in a folder beside it",
            hint="Unpack the dataset's fits beside the scans, or give other rules in the manifest",
        )
    fit = read_array_pickle(files.fit)
    scale, orientation = fit.get("scale"), fit.get("global_orient")
    if scale is None or scale.size != 1 or not scale.item() > 0:
        raise DataError(
            f"the fit of subject '{subject}' has no usable scale",
            expected="one positive number 'scale'",
            got=str(scale),
        )
    if orientation is None or orientation.size != 3 or not np.isfinite(orientation).all():
        raise DataError(f"the fit of subject '{subject}' has no global_orient of three numbers")
    turn = rotation_of(orientation.reshape(3).astype(np.float64))
    upright, warnings = np.eye(3), ()
    if subject.isdecimal() and int(subject) > _LAST_UPRIGHT:
        upright, warnings = _stood_up(turn, subject)
    forward = upright @ turn @ (0.0, 0.0, 1.0)
    yaw = math.atan2(forward[0], forward[2])
    return _Placed(float(scale.item()), upright, yaw, warnings)


def _stood_up(turn: Floats, subject: str) -> tuple[Floats, tuple[str, ...]]:
    """The quarter turns after which a fit's body stands, and what to say of them.

    People bend, so that the body's own axis is no measure of the ground: only frames whose axes
    are exchanged are told apart.
    """
    up = turn @ (0.0, 1.0, 0.0)
    if up[1] > math.cos(math.radians(_LEAN_DEG)):
        return np.eye(3), ()
    axis = int(np.abs(up).argmax())
    if abs(up[axis]) <= math.cos(math.radians(_LEAN_DEG)):
        raise _lying(subject, "its fit leans too far to say which way is up")
    across = np.cross(np.eye(3)[axis] * np.sign(up[axis]), (0.0, 1.0, 0.0))
    if axis == 1:  # on its head
        across = np.array([2.0, 0.0, 0.0])
    angle = math.pi if axis == 1 else math.pi / 2.0
    stood = np.round(rotation_of(across / np.linalg.norm(across) * angle))
    return stood, (
        f"the scan was turned by {math.degrees(angle):.0f} degrees to stand upright, as its fit "
        "says",
    )


def _lying(subject: str, why: str) -> DataError:
    return DataError(
        f"the scan of subject '{subject}' does not stand upright, and {why}",
        expected=f"+Y up, as in the scans up to {_LAST_UPRIGHT:04d}",
        hint="Leave this subject out",
    )


def rotation_of(vector_rad: Floats) -> Floats:
    """(3, 3) rotation about a vector (3,) by its length, radians."""
    angle = float(np.linalg.norm(vector_rad))
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = vector_rad / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross


def _placement(mesh: Mesh, dataset: Dataset, rule: _Placed, subject: str) -> Floats:
    """(4, 4) similarity that stands, scales, turns to +Z and centres the bounding box."""
    yaw = math.radians(dataset.facing[subject]) if isinstance(dataset.facing, dict) else 0.0
    yaw = rule.yaw_rad if dataset.facing == "fit" else yaw
    turn = rotation_of(np.array([0.0, -yaw, 0.0])) @ rule.upright
    if dataset.scale.startswith("height="):
        height = float(stature(replace(mesh, vertices=mesh.vertices @ turn.T)).extent[1])
        scale = float(dataset.scale.removeprefix("height=")) / height
    else:
        scale = 1.0 if dataset.scale == "metres" else 1.0 / rule.units_per_metre
    transform = np.eye(4)
    transform[:3, :3] = scale * turn
    low, high = mesh.transformed(transform).bounds
    transform[:3, 3] = -0.5 * (low + high)
    return transform

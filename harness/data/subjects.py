"""A dataset's subjects, read in the way that its kind asks for."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from harness.core.arrays import Floats
from harness.core.artifacts import Scan
from harness.core.errors import DataError
from harness.core.files.hashing import file_sha256
from harness.core.files.pickles import read_array_pickle
from harness.core.mesh import Mesh
from harness.core.process.source_digest import SourceTree
from harness.core.units import UNITS_RULE
from harness.data.scans import height_warnings, load_scan, locate_scan, stature
from harness.data.thuman import (
    CheckedSurface,
    FileCheck,
    ThumanFiles,
    check_file,
    check_thuman,
    find_subject,
    find_thuman,
    name_below,
)
from harness.files.mesh_files import load_mesh
from harness.files.mtl import material_files, texture_image
from harness.geometry.coinciding import open_edges
from harness.geometry.occlusion import hidden_share

if TYPE_CHECKING:
    from harness.data.manifest import Dataset


def check_scan(root: Path, subject: str, *, sha256: Mapping[str, str]) -> list[FileCheck]:
    """A scan's mesh, material files and picture, each with its state.

    Args:
        root: The dataset's folder.
        subject: One of its ids.
        sha256: Expected checksums by path below the root, where there are any.
    """
    try:
        mesh = find_subject(root, subject).mesh
    except DataError:
        return [FileCheck(f"model/{subject}/{subject}.obj", "missing")]
    found = [check_file(mesh, root, sha256)]
    if found[0].state != "present":
        return found
    found += [check_file(file, root, sha256) for file in material_files(mesh)]
    if any(entry.state != "present" for entry in found):
        return found
    try:
        picture = texture_image(mesh)
    except DataError as error:
        return [*found, FileCheck(name_below(root, mesh.parent), "missing", str(error))]
    return [*found, check_file(picture, root, sha256)]


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


#: The kind of a user's own licensed copy of THuman.
_THUMAN = "thuman"


def locate_subject(name: str, dataset: Dataset, root: Path, subject: str) -> Scan:
    """As ``locate_scan``, also for scans whose fit lies beside the root."""
    locate = locate_thuman if dataset.kind == _THUMAN else locate_scan
    return locate(name, dataset, root, subject)


def load_subject(name: str, dataset: Dataset, root: Path, subject: str) -> tuple[Scan, Mesh]:
    """As ``load_scan``, also for scans whose fit lies beside the root."""
    load = load_thuman if dataset.kind == _THUMAN else load_scan
    return load(name, dataset, root, subject)


def fit_of(dataset: Dataset, root: Path, subject: str) -> Path | None:
    """The SMPL-X fit of a subject of THuman, wherever it lies; None for others.

    Raises:
        DataError: there is no scan.
    """
    return find_thuman(root, subject).fit if dataset.kind == _THUMAN else None


def check_files(
    dataset: Dataset, root: Path, subject: str, sha256: Mapping[str, str]
) -> list[FileCheck]:
    """What of a subject is there, by file, compared with checksums where there are any.

    A user's mesh is read, too: a note says how much of its area no outside ray reaches.
    """
    needs_fit = "fit" in (dataset.scale, dataset.facing)
    if dataset.kind == _THUMAN:
        found = check_thuman(root, subject, needs_fit=needs_fit, sha256=sha256)
    else:
        found = check_scan(root, subject, sha256=sha256)
    if dataset.kind == "generated" or any(entry.state != "present" for entry in found):
        return found
    try:
        mesh = load_mesh(find_thuman(root, subject).mesh)
        surface = CheckedSurface(subject, hidden_share(mesh), open_edges(mesh))
        hidden = f"{surface.hidden:.0%} hidden"
    except DataError as error:
        return [replace(found[0], state="corrupt", note=str(error)), *found[1:]]
    note = ", ".join(filter(None, (found[0].note, hidden)))
    return [replace(found[0], note=note, surface=surface), *found[1:]]

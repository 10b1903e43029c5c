"""A scan file becomes metres in the world frame, by the manifest's explicit rule.

Before: ``harness/core/artifacts.py``. After: ``renderers/blender/scene.py``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats
from harness.core.artifacts import Scan
from harness.core.errors import DataError
from harness.core.files.atomic import read_json
from harness.core.files.hashing import file_sha256
from harness.core.files.pickles import read_array_pickle
from harness.core.mesh import Mesh
from harness.core.process.source_digest import SourceTree
from harness.core.units import UNITS_RULE
from harness.data.thuman import find_subject
from harness.files.mesh_files import load_mesh
from harness.geometry.coinciding import edges_of, pieces_of
from harness.geometry.surface import merged_positions

if TYPE_CHECKING:
    # What a manifest says of a dataset is in a scan's rules; how it was read decides nothing.
    from harness.data.manifest import Dataset

#: A piece with less than this share of the area is a speck; if these are more together than this
#: share, the surface consists of such pieces, and none is one.
_SPECK, _MOST_SPECKS = 1e-3, 0.05
#: Specks that change a side by less than this share of it do not matter.
_SAME = 5e-3
#: So few vertices are a spike that are beyond all others by this share of the longest side, and by
#: this many times the mean edge.
_FEW, _SPIKE, _EDGES = 3, 0.02, 4.0


@dataclass(frozen=True, slots=True, eq=False)
class Stature:
    """What a scan measures.

    Attributes:
        extent: (3,) sides of its bounding box in its units, without specks.
        told: What is out of the ordinary, in words.
    """

    extent: Floats
    told: tuple[str, ...]


def stature(mesh: Mesh) -> Stature:
    """The size of a scan; loose specks beyond it do not count, and spikes are told."""
    group = merged_positions(mesh.vertices)
    faces = group[mesh.faces]
    pieces = pieces_of(faces, int(group.max()) + 1)
    areas = np.bincount(pieces.of_face, mesh.face_areas(), len(pieces.face_counts))
    specks = areas < _SPECK * areas.sum()
    extent, told = mesh.extent, list[str]()
    is_body = ~specks[pieces.of_face]
    if specks.any() and areas[specks].sum() < _MOST_SPECKS * areas.sum():
        body = mesh.submesh(is_body)
        if (extent - body.extent > _SAME * extent).any():
            told.append(
                f"loose specks lie beyond the person, which measures {_sides(body.extent)} without "
                f"them, {_sides(extent)} with them; they do not count for its height"
            )
            mesh, extent = body, body.extent
    return Stature(extent, (*told, *_spikes(mesh)))


def _spikes(mesh: Mesh) -> list[str]:
    places = np.unique(mesh.vertices[np.unique(mesh.faces)], axis=0)
    if len(places) <= 2 * _FEW:
        return []
    ends = edges_of(mesh.faces).ends
    edge = float(np.linalg.norm(np.diff(mesh.vertices[ends], axis=1), axis=2).mean())
    least = max(_SPIKE * float(mesh.extent.max()), _EDGES * edge)
    found: list[str] = []
    for axis, letter in enumerate("xyz"):
        ordered = np.sort(places[:, axis])
        gaps = {"-": ordered[1 : _FEW + 1] - ordered[:_FEW], "+": np.diff(ordered[-_FEW - 1 :])}
        found += [
            f"a spike sticks out by {gap.max():.2g} towards {sign}{letter} and counts: is it right?"
            for sign, gap in gaps.items()
            if gap.max() > least
        ]
    return found


def _sides(extent: Floats) -> str:
    return " x ".join(f"{side:.4g}" for side in extent)


#: A subject outside this range is reported: its scale is probably wrong.
PLAUSIBLE_HEIGHT_M = (1.2, 2.2)
#: Beyond this, in metres, it is no person at all: millimetres, centimetres, another object.
_POSSIBLE_HEIGHT_M = (0.3, 3.0)
#: Beside a scan that was converted: what it was made from, and how.
ADDED = "added.json"
APPEARANCE_SUFFIXES = (".mtl", ".jpeg", ".jpg", ".png")


def locate_scan(name: str, dataset: Dataset, root: Path, subject: str) -> Scan:
    """A subject's scan as it lies on disk: hashed, but not yet read or placed.

    Args:
        name: The dataset's name in the manifest.
        dataset: Its entry.
        root: Its folder.
        subject: One of its ids.

    Raises:
        DataError: no scan below the root, or one whose hidden layers were not left out although
            the entry says so.
    """
    files = find_subject(root, subject)
    if dataset.hidden == "dropped" and not is_outer(files.mesh.with_name(ADDED)):
        raise DataError(
            f"the hidden layers of {files.mesh} were not left out, as 'hidden: dropped' says",
            hint="Add the scans with 'harness data add --drop-hidden', which writes that entry",
        )
    uses_fit = "fit" in (dataset.scale, dataset.facing)
    content = [
        path
        for path in sorted(files.mesh.parent.iterdir())
        if path == files.mesh or path.suffix.lower() in APPEARANCE_SUFFIXES
    ]
    if uses_fit and files.fit:
        content.append(files.fit)
    facing = dataset.facing if isinstance(dataset.facing, str) else dataset.facing.get(subject)
    return Scan(
        dataset=name,
        subject=subject,
        mesh_path=files.mesh,
        scale_rule=dataset.scale,
        facing_rule=str(facing),
        hidden_rule=dataset.hidden,
        scan_to_world=np.eye(4),
        sha256={path.name: file_sha256(path) for path in content},
        body_path=files.body,
        labels_path=files.labels,
        truth_sha256={
            path.name: file_sha256(path) for path in (files.body, files.labels) if path is not None
        },
        reader=SourceTree.installed().digest([__name__], [SourceTree.__module__]).to_dict(),
    )


def is_outer(mark: Path) -> bool:
    """Whether the mark of a converted scan says that its hidden layers were left out."""
    return mark.is_file() and bool(read_json(mark).get("conversion", {}).get("outer"))


def load_scan(name: str, dataset: Dataset, root: Path, subject: str) -> tuple[Scan, Mesh]:
    """A subject's scan, and its textured mesh in world metres.

    The world frame has +Y up, the subject facing +Z, and the bounding box centred at the origin.
    Under the rule ``units`` the world is the file's own frame and 1 unit counts as 1 m; no height
    is then out of the ordinary, and the facing rule only tells where the front is.

    Raises:
        DataError: missing files, a broken mesh, a fit that is needed but not there, or a height
            that no person has under the scale rule.
    """
    scan = locate_scan(name, dataset, root, subject)
    mesh = load_mesh(scan.mesh_path, texture=True)
    fit = find_subject(root, subject).fit
    yaw = _facing_yaw(dataset, subject, fit)
    if dataset.scale == UNITS_RULE:
        return replace(scan, front_yaw_deg=math.degrees(yaw)), mesh
    scale = _metres_per_unit(dataset, subject, fit, mesh)
    scan_to_world = _placement(mesh, scale, yaw)
    world_mesh = mesh.transformed(scan_to_world)
    # Specks beyond the person do not count for a height that is given.
    given_m = dataset.scale.removeprefix("height=")
    high_m = float(world_mesh.extent[1] if given_m == dataset.scale else given_m)
    warnings = height_warnings(
        subject,
        f"under the rule 'scale: {dataset.scale}'",
        high_m,
        "Its file is in other units: correct 'scale' in the manifest (fit, metres, "
        "height=<metres>; units keeps them)",
    )
    return replace(scan, scan_to_world=scan_to_world, warnings=warnings), world_mesh


def load_world_mesh(scan: Scan) -> Mesh:
    """The scan's surface in world metres, without texture."""
    return load_mesh(scan.mesh_path).transformed(scan.scan_to_world)


def _metres_per_unit(dataset: Dataset, subject: str, fit_path: Path | None, mesh: Mesh) -> float:
    if dataset.scale == "metres":
        return 1.0
    if dataset.scale.startswith("height="):
        return float(dataset.scale.removeprefix("height=")) / float(stature(mesh).extent[1])
    fit = _fit(subject, fit_path, "scale: fit")
    if "scale" not in fit or fit["scale"].size != 1 or not fit["scale"].item() > 0:
        raise DataError(
            f"the fit of subject '{subject}' has no usable scale",
            expected="one positive number 'scale'",
            got=str(fit.get("scale")),
        )
    return 1.0 / float(fit["scale"].item())


def _facing_yaw(dataset: Dataset, subject: str, fit_path: Path | None) -> float:
    """Radians from +Z to the direction that the subject faces, about +Y."""
    if dataset.facing == "+z":
        return 0.0
    if isinstance(dataset.facing, dict):
        if subject not in dataset.facing:
            raise DataError(
                f"the manifest does not say where subject '{subject}' faces",
                hint=f"Add 'facing: {{\"{subject}\": <yaw in degrees>}}'; it is never guessed",
            )
        return math.radians(dataset.facing[subject])
    orientation = _fit(subject, fit_path, "facing: fit").get("global_orient")
    if orientation is None or orientation.size != 3:
        raise DataError(f"the fit of subject '{subject}' has no global_orient of three numbers")
    axis_angle = orientation.reshape(3).astype(np.float64)
    forward = _rotate(axis_angle, np.array([0.0, 0.0, 1.0]))
    return math.atan2(forward[0], forward[2])


def _fit(subject: str, fit_path: Path | None, rule: str) -> dict[str, NDArray[Any]]:
    if fit_path is None:
        raise DataError(
            f"subject '{subject}' has no SMPL-X fit, which the manifest's '{rule}' needs",
            expected=f"smplx/{subject}/smplx_param.pkl",
            hint="Unpack the dataset's fits, or give another rule in the manifest",
        )
    return read_array_pickle(fit_path)


def _rotate(axis_angle: Floats, vector: Floats) -> Floats:
    """Rodrigues' formula."""
    angle = float(np.linalg.norm(axis_angle))
    if angle < 1e-12:
        return vector
    axis = axis_angle / angle
    return (
        vector * math.cos(angle)
        + np.cross(axis, vector) * math.sin(angle)
        + axis * float(axis @ vector) * (1 - math.cos(angle))
    )


def _placement(mesh: Mesh, scale: float, yaw: float) -> Floats:
    """(4, 4) similarity that scales, turns to +Z and centres the bounding box."""
    transform = np.eye(4)
    cos, sin = math.cos(-yaw), math.sin(-yaw)
    transform[:3, :3] = scale * np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]])
    low, high = mesh.transformed(transform).bounds
    transform[:3, 3] = -0.5 * (low + high)
    return transform


def height_warnings(subject: str, by: str, height_m: float, hint: str) -> tuple[str, ...]:
    """What is to be said of a subject's height.

    Args:
        subject: Its id.
        by: What tells its height, for the message.
        height_m: The height in metres.
        hint: What to do if it is no person's.

    Raises:
        DataError: no person is so high.
    """
    low, high = _POSSIBLE_HEIGHT_M
    if not low <= height_m <= high:
        raise DataError(
            f"subject '{subject}' is {height_m:.4g} m high {by}",
            expected=f"{low} to {high} m",
            hint=hint,
        )
    low, high = PLAUSIBLE_HEIGHT_M
    if low <= height_m <= high:
        return ()
    return (f"height {height_m:.2f} m is outside {low} to {high} m: check the scale rule",)

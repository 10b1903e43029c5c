"""A dataset's subjects, read in the way that its kind asks for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from harness.core.artifacts import Scan
from harness.core.errors import DataError
from harness.core.formats.mesh_files import load_mesh
from harness.core.mesh import Mesh
from harness.data.file_checks import FileCheck
from harness.data.scan_files import check_scan
from harness.data.scans import load_scan, locate_scan
from harness.data.thuman_scans import load_thuman, locate_thuman
from harness.data.thuman_trees import check_thuman, find_thuman
from harness.geometry.occlusion import hidden_share

if TYPE_CHECKING:
    from harness.data.manifest import Dataset

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
        hidden = f"{hidden_share(load_mesh(find_thuman(root, subject).mesh)):.0%} hidden"
    except DataError as error:
        return [replace(found[0], state="corrupt", note=str(error)), *found[1:]]
    return [replace(found[0], note=", ".join(filter(None, (found[0].note, hidden)))), *found[1:]]

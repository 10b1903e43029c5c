"""Scoring a folder of meshes, clouds or splats made elsewhere, one per subject."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from harness.core.errors import DataError, HarnessError, did_you_mean
from harness.core.files.hashing import file_sha256
from harness.core.files.names import checked_name, named_from
from harness.core.files.reach import inside
from harness.core.protocols import MethodInfo, Privilege
from harness.core.records import CaptureStamp, ProtocolStamp, Record, Scores, Status
from harness.core.settings import MetricProtocol
from harness.core.truth import face_regions
from harness.files.mesh_files import MESH_SUFFIXES, save_mesh
from harness.files.point_files import load_points
from harness.run.mesh_scores import mesh_scores
from harness.run.progress import Progress
from harness.run.publication import MESH_FILE
from harness.run.record_inputs import Inputs, environment, scored_elsewhere, utc_now
from harness.run.sources import ScanSet
from harness.run.store import CellFolder, Outcome, RunStore
from methods.catalog import METHODS
from methods.points.surfacing import load_surface

_SEAMS = (
    "normals end at the seams of its texture, which the mesh that is kept does not have: hand in "
    "results of a mesh without texture coordinates, such as a PLY"
)


@dataclass(frozen=True, slots=True)
class FolderRequest:
    """A folder of meshes named by subject, to be filed as a method.

    Attributes:
        folder: Holds ``<id>.ply``, ``.obj``, ``.glb``, ``.off`` or ``.stl``: metres, world frame. A
            PLY without faces is a cloud or Gaussians.
        name: The method's name in records and tables.
        title: Its title in tables.
        truth: What it is measured against.
        protocol: How it is measured.
        store: Where records go.
    """

    folder: Path
    name: str
    title: str
    truth: ScanSet
    protocol: MetricProtocol
    store: RunStore

    def told(self, message: str) -> str:
        """The message, with meshes and scans named from their own folders, as a record has it."""
        for folder in (self.folder, self.truth.root):
            message = named_from(message, folder.parent)
        return message


def score_folder(request: FolderRequest, progress: Progress) -> list[Outcome]:
    """One record per subject of the dataset; a subject without a mesh is ``missing``, not dropped.

    Raises:
        HarnessError: no such folder, not one mesh named by a subject, or a link out of it, a name
            that no method may have or that one run here has.
    """
    checked_name("method", request.name)
    if request.name in METHODS.targets():
        raise HarnessError(
            f"'{request.name}' is a method that is run here",
            hint="File meshes made elsewhere under another --name",
        )
    if not request.folder.is_dir():
        raise HarnessError(f"no folder at {request.folder}")
    subjects = request.truth.subjects
    meshes = {subject: _mesh_of(request.folder, subject) for subject in subjects}
    if not any(meshes.values()):
        present = sorted(path.stem for path in request.folder.iterdir())
        raise DataError(
            f"{request.folder} holds no mesh of dataset '{request.truth.name}'",
            expected=f"files such as {subjects[0]}.ply",
            got=", ".join(present[:5]) or "an empty folder",
            hint=did_you_mean(present[0], subjects) if present else "",
        )
    request.store.begin()
    progress.expect("meshes", len(subjects))
    outcomes: list[Outcome] = []
    for subject, path in meshes.items():
        folder = request.store.cell(request.name, subject)
        with folder.locked():
            outcome = _score_subject(request, folder, subject, path)
        if outcome.status != "ok":
            progress.say(outcome.line)
        progress.done("meshes")
        outcomes.append(outcome)
    return outcomes


def _mesh_of(folder: Path, subject: str) -> Path | None:
    found = [folder / f"{subject}{suffix}" for suffix in MESH_SUFFIXES]
    found = [path for path in found if path.is_file()]
    if len(found) > 1:
        raise DataError(
            f"{folder} holds several meshes of subject '{subject}'",
            expected="one",
            got=", ".join(path.name for path in found),
        )
    return inside(folder, found[0], folder) if found else None


@dataclass(frozen=True, slots=True)
class _Scored:
    """How scoring one subject's mesh ended; ``by_mesh`` is False where the truth is unreadable."""

    status: Status
    reason: str = ""
    by_mesh: bool = True
    scores: Scores = field(default_factory=Scores)
    inputs: Inputs | None = None
    files: Mapping[str, str] = field(default_factory=dict[str, str])
    details: Mapping[str, object] = field(default_factory=dict[str, object])


def _score_subject(
    request: FolderRequest, folder: CellFolder, subject: str, path: Path | None
) -> Outcome:
    """The subject's record, filed; an earlier good one stays where the truth cannot be read."""
    method = MethodInfo(request.name, request.title, privileges=(Privilege.MADE_ELSEWHERE,))
    attempt = folder.new_attempt()
    found = _scored(request, method, subject, path, attempt.results / MESH_FILE)
    record = Record(
        key=found.inputs.key if found.inputs else "",
        method=method,
        dataset=request.truth.name,
        subject=subject,
        # Made elsewhere: nobody here knows from which photos.
        recipe="",
        protocol=ProtocolStamp.of(request.protocol),
        capture=CaptureStamp(),
        seed=request.protocol.seed,
        status=found.status,
        reason=request.told(found.reason),
        metrics=found.scores.metrics,
        regions=found.scores.regions,
        warnings=tuple(map(request.told, found.scores.warnings)),
        diagnostics=found.scores.diagnostics,
        environment=environment(),
        created_utc=utc_now(),
        scale_rule=request.truth.dataset.scale,
        identity=request.truth.dataset.person_of(subject),
        inputs=found.inputs.to_dict() if found.inputs else {},
        files=found.files,
        details=found.details,
    )
    return folder.file(record, attempt, own_failure=found.by_mesh)


def _scored(
    request: FolderRequest, method: MethodInfo, subject: str, path: Path | None, kept: Path
) -> _Scored:
    """A mesh's scores; what was scored is kept, so that it can be looked at and handed in.

    Of a mesh with texture coordinates this loses the seams, at which normals end.
    """
    if path is None:
        return _Scored("missing", f"no mesh of {subject} in {request.folder}")
    try:
        scan, truth = request.truth.load(subject)
        face_regions(scan, truth)
    except HarnessError as error:
        return _Scored("failed", str(error), by_mesh=False)
    inputs: Inputs | None = None
    try:
        is_points = load_points(path) is not None
        inputs = scored_elsewhere(
            method, file_sha256(path), scan, request.protocol, is_points=is_points
        )
        surface = load_surface(path)
        predicted = surface.mesh
        scores = mesh_scores(predicted, scan, truth, request.protocol, misplaced="refuse")
    except HarnessError as error:
        return _Scored("failed", str(error), inputs=inputs)
    if file_sha256(path) != inputs.mesh:
        return _Scored("failed", f"{path} changed while it was scored")
    save_mesh(kept, predicted.geometry())
    files = {kept.name: file_sha256(kept)}
    if predicted.uv is not None and request.protocol.texture_seams == "split":
        scores = replace(scores, warnings=(*scores.warnings, _SEAMS))
    return _Scored("ok", scores=scores, inputs=inputs, files=files, details=surface.details)

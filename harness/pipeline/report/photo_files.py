"""The figures without a scan of a run's cells: kept beside each record, made where they are not.

``photos.json`` lies beside ``record.json``. It holds the figures and the key of everything that
they depend on: mesh, normal maps, photos, and the code that compares them. A record does not depend
on that code, so these figures never make a record stale; they are themselves made anew when their
key changes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from harness.core.artifacts import Capture
from harness.core.errors import DataError, HarnessError
from harness.core.files.atomic import read_json, write_json
from harness.core.files.hashing import content_hash
from harness.core.formats.mesh_files import load_mesh
from harness.core.formats.typed_json import from_json, to_json
from harness.core.quality.photo_scores import PhotoScores
from harness.core.records import Record
from harness.pipeline.inputs.workspace import Workspace
from harness.pipeline.progress import Progress
from harness.pipeline.run.result_files import MESH_FILE, NORMALS_FILE, load_normals
from harness.pipeline.run.store import RunStore
from harness.pipeline.scoring.photos import photo_quality, photo_scoring_code

PHOTOS_FILE = "photos.json"
_SCHEMA = 1
_TASK = "compared"


@dataclass(frozen=True, slots=True)
class PhotoFigures:
    """The figures of some records.

    Attributes:
        scores: By method and subject.
        absent: Why a record has none, likewise.
    """

    scores: Mapping[tuple[str, str], PhotoScores]
    absent: Mapping[tuple[str, str], str]


class PhotoFiles:
    """The stored figures of a run, and how they are made.

    Args:
        store: The run.
        workspace: Where its photos lie.
    """

    def __init__(self, store: RunStore, workspace: Workspace) -> None:
        self._store = store
        self._workspace = workspace
        self._code = photo_scoring_code().to_dict()

    def waiting(self, records: Sequence[Record]) -> list[Record]:
        """The records with a result whose figures are not there, or are of something else."""
        return [r for r in records if r.status == "ok" and r.recipe and self._stored(r) is None]

    def figures(self, records: Sequence[Record], progress: Progress) -> PhotoFigures:
        """The figures of all records with a result; what is missing is made and kept.

        Raises:
            DataError: a file of a result is not what its record measured, or nothing can be
                written.
        """
        waiting = self.waiting(records)
        if waiting:
            progress.expect(_TASK, len(waiting))
        scores: dict[tuple[str, str], PhotoScores] = {}
        absent: dict[tuple[str, str], str] = {}
        for record in records:
            cell = (record.method_name, record.subject)
            if record.status != "ok":
                continue
            if not record.recipe:
                absent[cell] = "the mesh was made elsewhere, from photos that are not known"
                continue
            found = self._stored(record)
            if found is None:
                capture = self._capture(record)
                if isinstance(capture, str):
                    absent[cell] = capture
                else:
                    found = self._made(record, capture)
                progress.done(_TASK)
            if found is not None:
                scores[cell] = found
        return PhotoFigures(scores, absent)

    def _path(self, record: Record) -> Path:
        folder = self._store.cell(record.method_name, record.subject)
        return folder.directory / PHOTOS_FILE

    def _key(self, record: Record) -> str:
        return content_hash(
            {
                "mesh": record.files.get(MESH_FILE, ""),
                "normals": record.files.get(NORMALS_FILE, ""),
                "photos": record.capture.key,
                **self._code,
            }
        )

    def _stored(self, record: Record) -> PhotoScores | None:
        path = self._path(record)
        if not path.is_file():
            return None
        document = read_json(path)
        if (document.get("schema"), document.get("key")) != (_SCHEMA, self._key(record)):
            return None
        return from_json(PhotoScores, document.get("scores"), path, "figures of photos")

    def _capture(self, record: Record) -> Capture | str:
        """The photos that a record's method saw, counted from the front; or why they are gone."""
        folder = self._workspace.capture(record.dataset, record.subject, record.recipe)
        try:
            capture = Capture.load(folder)
        except HarnessError:
            return "its photos are not there any more"
        if capture.key != record.capture.key:
            return "its photos were made anew since"
        if damage := capture.damage():
            raise DataError(damage, hint="Delete the folder and render again")
        return capture.from_front()

    def _made(self, record: Record, capture: Capture) -> PhotoScores:
        mesh = load_mesh(self._store.result(record, MESH_FILE))
        maps = ()
        if NORMALS_FILE in record.files:
            maps = load_normals(self._store.result(record, NORMALS_FILE))
        found = photo_quality(mesh, capture, maps)
        document = {"schema": _SCHEMA, "key": self._key(record), "scores": to_json(found)}
        write_json(self._path(record), document)
        return found

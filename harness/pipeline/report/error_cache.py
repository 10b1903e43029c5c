"""Errors by vertex of stored meshes, measured once: figures and pages show the same ones."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from harness.core.array_files.npz import read_required_arrays, write_npz
from harness.core.artifacts import Scan
from harness.core.files.hashing import content_hash
from harness.core.formats.mesh_files import load_mesh
from harness.core.mesh import Mesh
from harness.core.records import Record
from harness.geometry.surface import SurfaceIndex
from harness.pipeline.run.record_inputs import require_scan
from harness.pipeline.run.result_files import MESH_FILE
from harness.pipeline.run.store import RunStore
from metrics.vertices import VertexErrors, vertex_errors

_FOLDER = ".vertex-errors"
#: Grows when ``metrics.vertices`` measures something else.
_VERSION = 1
_ARRAYS = ("distance_mm", "normal_deg")


class TrueSurface:
    """A subject's true surface, prepared for queries on the first one.

    Attributes:
        scan: Where it came from.
        mesh: World metres.
        identity: Content id of the scan and its rules.
    """

    def __init__(self, scan: Scan, mesh: Mesh) -> None:
        self.scan, self.mesh = scan, mesh
        self.identity = content_hash(scan.identity())
        self._index: SurfaceIndex | None = None

    @property
    def index(self) -> SurfaceIndex:
        """The surface as an index, built once."""
        if self._index is None:
            self._index = SurfaceIndex(self.mesh)
        return self._index


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredMesh:
    """A record's mesh, world metres, with the errors of its vertices."""

    mesh: Mesh
    errors: VertexErrors


def measured_mesh(store: RunStore, record: Record, truth: TrueSurface) -> MeasuredMesh:
    """The mesh of a record with its errors; measured now, unless they were before.

    They are kept in the run's folder, by the digests of both surfaces, in single precision. A run
    in a folder that may not be written is measured each time.

    Raises:
        DataError: mesh or scan is gone or is not the one that was scored, or kept errors are
            damaged.
    """
    require_scan(record, truth.scan)
    mesh = load_mesh(store.result(record, MESH_FILE))
    path = _path(store, record, truth)
    if path.is_file():
        hint = "Delete it: it will be measured again"
        kept = read_required_arrays(path, _ARRAYS, "errors of vertices", hint)
        return MeasuredMesh(mesh, VertexErrors(*(kept[name].astype(float) for name in _ARRAYS)))
    found = vertex_errors(mesh, truth.index)
    arrays = {name: getattr(found, name).astype(np.float32) for name in _ARRAYS}
    if os.access(store.directory, os.W_OK):
        write_npz(path, arrays, compressed=False)
    # What is kept and what is not must be the same numbers.
    return MeasuredMesh(mesh, VertexErrors(*(arrays[name].astype(float) for name in _ARRAYS)))


def _path(store: RunStore, record: Record, truth: TrueSurface) -> Path:
    key = {"mesh": record.files[MESH_FILE], "truth": truth.identity, "version": _VERSION}
    return store.directory / _FOLDER / f"{content_hash(key)}.npz"

"""A cell's results on disk: made in an attempt's folder, visible by the rename of the record alone.

    runs/<run>/<method>/<subject>/
        record.json               names its files with their sha256
        results-<id>/             these files; the id is the hash of their names and hashes
        mesh.ply, log.txt, ...    links to them, for people and other programs
        .attempt-<owner>-<id>/    what an attempt makes; it goes away

An attempt becomes ``results-<id>`` by a rename, and nobody looks there until a record names its
files. A run that is killed at any moment, or several that work on one cell on machines whose locks
do not reach each other, can therefore not pair the mesh of one attempt with the record of another.
Runs of earlier versions have the files beside the record, and are read, too.
"""

from __future__ import annotations

import contextlib
import functools
import json
import os
import platform
import shutil
import time
import uuid
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.core.artifacts import Body, NormalMaps
from harness.core.camera import Camera
from harness.core.errors import DataError, MethodError
from harness.core.files.atomic import writing
from harness.core.files.hashing import content_hash, file_sha256
from harness.core.files.npz import read_array_npz, read_required_arrays, write_npz
from harness.core.mesh import Mesh
from harness.core.records import Record
from harness.geometry.images import packed_normals, unit_normals

LOG_FILE = "log.txt"
#: What a failure that leaves a good record printed.
_FAILED_LOG = "failed-attempt.log"
_WORK = "work"
_RECORD_FILE = "record.json"
_RESULTS = "results-"
_ATTEMPT = ".attempt-"
#: Inside an attempt: what the worker fills, and what becomes ``results-<id>``.
_MADE = "made"
#: Says on which machine results were made.
_OWNER_FILE = ".owner"
_BOOT_ID = Path("/proc/sys/kernel/random/boot_id")
#: What other machines left is rubbish after this time; they may still be about to name it.
_OTHERS_S = 24 * 3600.0
#: What a cell may have had beside its record, or has as links.
_NAMES = ("mesh.ply", "body.npz", "normals.npz", LOG_FILE, _WORK)


@functools.cache
def _owner() -> str:
    """This machine since it was started; locks of all its processes reach each other."""
    try:
        name = _BOOT_ID.read_text().strip()
    except OSError:
        name = platform.node()
    return content_hash({"machine": name})[:8]


@dataclass(frozen=True, slots=True)
class Attempt:
    """The folder of one attempt at a cell.

    Attributes:
        folder: Goes away with the attempt.
    """

    folder: Path

    @classmethod
    def begin(cls, cell: Path) -> Attempt:
        """A fresh one.

        Raises:
            WriteError: a full disk or a missing right.
        """
        attempt = cls(cell / f"{_ATTEMPT}{_owner()}-{uuid.uuid4().hex[:12]}")
        with writing(attempt.results):
            attempt.results.mkdir(parents=True)
        return attempt

    @property
    def results(self) -> Path:
        """Where mesh, body and normals are put."""
        return self.folder / _MADE

    @property
    def log(self) -> Path:
        """What the worker prints."""
        return self.folder / LOG_FILE

    def keep_log(self, cell: Path) -> None:
        """Leave what was printed beside a record that stays."""
        if self.log.is_file():
            self.log.replace(cell / _FAILED_LOG)


def abandon(cell: Path) -> None:
    """Remove this machine's attempts at a cell that is held, whatever is in them."""
    for folder in cell.glob(f"{_ATTEMPT}{_owner()}-*"):
        shutil.rmtree(folder, ignore_errors=True)


def publish(cell: Path, attempt: Attempt, record: Record) -> Record:
    """Put an attempt's results and its record in the place of what the cell holds.

    Returns:
        The record with the log among its files.

    Raises:
        WriteError: a full disk or a missing right.
    """
    if attempt.log.is_file():
        attempt.log.replace(attempt.results / LOG_FILE)
        _sync(attempt.results / LOG_FILE)
        sha256 = file_sha256(attempt.results / LOG_FILE)
        record = replace(record, files={**record.files, LOG_FILE: sha256})
    for path in attempt.results.iterdir():
        # A worker that died may have left half of something.
        if path.name not in record.files and (path.name != _WORK or record.status != "ok"):
            _remove(path)
    if record.files:
        _put(attempt.results, _folder(cell, record.files), record.files)
    record.save(cell / _RECORD_FILE)
    (cell / _FAILED_LOG).unlink(missing_ok=True)
    link_results(cell, record)
    collect(cell, record)
    return record


def _folder(cell: Path, files: Mapping[str, str]) -> Path:
    return cell / f"{_RESULTS}{content_hash(dict(files))}"


def file_of(cell: Path, record: Record, name: str) -> Path:
    """Where a file of a record lies, or would lie."""
    folder = _folder(cell, record.files)
    return (folder if folder.is_dir() else cell) / name


def _put(made: Path, target: Path, files: Mapping[str, str]) -> None:
    """Rename results to their place; the same results may be there already."""
    with writing(made / _OWNER_FILE):
        (made / _OWNER_FILE).write_text(_owner())
    if target.is_dir() and not _is_whole(target, files):
        shutil.rmtree(target)
    try:
        made.rename(target)
    except OSError:
        if not _is_whole(target, files):
            raise
        # What is kept of intermediate results is not among the files that the id is made of.
        if (made / _WORK).is_dir():
            shutil.rmtree(target / _WORK, ignore_errors=True)
            (made / _WORK).rename(target / _WORK)
        (made / _OWNER_FILE).replace(target / _OWNER_FILE)


def _is_whole(folder: Path, files: Mapping[str, str]) -> bool:
    return all(
        (folder / name).is_file() and file_sha256(folder / name) == sha256
        for name, sha256 in files.items()
    )


def link_results(cell: Path, record: Record) -> None:
    """Let the names beside the record lead to its files; nothing of the harness reads them.

    A file system without links has none.
    """
    folder = _folder(cell, record.files)
    for name in _NAMES:
        path, target = cell / name, folder / name
        if target.exists():
            wanted = Path(folder.name, name)
            if not (path.is_symlink() and path.readlink() == wanted):
                _link(path, wanted)
        elif folder.is_dir() or name not in record.files:
            _remove(path)


def _link(path: Path, target: Path) -> None:
    temporary = path.with_name(f".{path.name}.{uuid.uuid4().hex[:12]}.part")
    with contextlib.suppress(OSError):
        temporary.symlink_to(target)
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        temporary.replace(path)
    temporary.unlink(missing_ok=True)


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def collect(cell: Path, record: Record | None) -> None:
    """Remove what no record names: results that were replaced, and attempts that were killed.

    Call it only while holding the cell's lock, with the record that the cell has.
    """
    kept = _folder(cell, record.files) if record and record.files else None
    for folder in (*cell.glob(f"{_RESULTS}*"), *cell.glob(f"{_ATTEMPT}*")):
        if folder != kept and folder.is_dir() and _is_rubbish(folder):
            shutil.rmtree(folder, ignore_errors=True)
    for leftover in cell.glob(".*.part"):
        if leftover.is_symlink():
            leftover.unlink(missing_ok=True)
    # A name of the only attempt's folder in versions before this one.
    shutil.rmtree(cell / ".attempt", ignore_errors=True)


def _is_rubbish(folder: Path) -> bool:
    """Whether no attempt that still runs can be about to name a folder: the lock is held here."""
    try:
        if folder.name.startswith(_ATTEMPT):
            owner = folder.name.removeprefix(_ATTEMPT).partition("-")[0]
        else:
            owner = (folder / _OWNER_FILE).read_text()
        changed = folder.stat().st_mtime
    except OSError:
        return False
    return owner == _owner() or time.time() - changed > _OTHERS_S


def _sync(path: Path) -> None:
    with path.open("rb") as stream:
        os.fsync(stream.fileno())


MESH_FILE = "mesh.ply"
BODY_FILE = "body.npz"
NORMALS_FILE = "normals.npz"
_MAPS = ("front", "back", "body_front", "body_back")
_EVALUATE = "Evaluate the method again"


def save_body(path: Path, body: Body) -> None:
    """Write a fitted body atomically."""
    write_npz(path, body.to_arrays())


def load_body_mesh(path: Path, source: str) -> Mesh:
    """The surface of a stored body, world metres, named as coming from ``source``.

    Raises:
        DataError: no such file, or not one that ``save_body`` wrote.
    """
    arrays = read_required_arrays(path, ("vertices", "faces"), "fitted body", _EVALUATE)
    return Mesh(arrays["vertices"], arrays["faces"], source=source)


def save_normals(path: Path, views: Sequence[NormalMaps]) -> None:
    """Write normal maps atomically; directions are kept to half a degree, enough for pictures."""
    arrays: dict[str, NDArray[Any]] = {}
    for maps in views:
        mark = f"{maps.view:02d}"
        arrays[f"camera_{mark}"] = np.array(json.dumps(maps.camera.to_dict()))
        arrays[f"mask_{mark}"] = maps.mask
        for name in _MAPS:
            arrays[f"{name}_{mark}"] = packed_normals(getattr(maps, name))
    write_npz(path, arrays)


def load_normals(path: Path) -> tuple[NormalMaps, ...]:
    """The maps in a file, by view, of unit length again.

    Raises:
        DataError: no such file, or not one that ``save_normals`` wrote.
    """
    try:
        arrays = read_array_npz(path)
        marks = sorted(name[len("mask_") :] for name in arrays if name.startswith("mask_"))
        return tuple(_view(arrays, mark) for mark in marks)
    except (DataError, KeyError, ValueError, MethodError) as error:
        raise DataError(
            f"{path} holds no normal maps",
            expected=f"a file {NORMALS_FILE} as an evaluation writes it",
            got=str(error),
            hint=_EVALUATE,
        ) from error


def _view(arrays: Mapping[str, NDArray[Any]], mark: str) -> NormalMaps:
    camera = Camera.from_dict(json.loads(str(arrays[f"camera_{mark}"])))
    maps = [unit_normals(arrays[f"{name}_{mark}"].astype(float)) for name in _MAPS]
    return NormalMaps(int(mark), camera, arrays[f"mask_{mark}"], *maps)

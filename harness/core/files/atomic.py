"""Atomic writes, and locks that are released when their process dies."""

import contextlib
import errno
import fcntl
import glob
import json
import os
import shutil
import tempfile
import time
import uuid
from collections.abc import Generator, Mapping
from pathlib import Path
from typing import Any, TypeGuard

from harness.core.errors import DataError, WriteError
from harness.core.process.interrupts import require_not_stopped

_LOCK_POLL_S, _MOST_BYTES = 0.05, 64 * 2**20
#: Where files that are open already have names, such as what a shell sends the output to.
_OPEN_FILES = ("/dev/std", "/dev/fd/", "/proc/")
#: How old a temporary folder must be where nobody can say whether its writer lives.
_ABANDONED_S = 24 * 3600.0
#: Numbers of errors that only writing can cause; the kernel does not say for which file.
NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS)


@contextlib.contextmanager
def atomic_path(path: Path) -> Generator[Path]:
    """A temporary path beside ``path`` that becomes ``path`` when the block succeeds.

    The file is synced and renamed. If the block raises, nothing is left behind. A link stays, and
    what it leads to is replaced. What is no file, such as a device or a FIFO, is written to.

    Raises:
        WriteError: the disk is full or a permission is missing; the message names ``path``.
            Any other error in the block, such as an unreadable input, passes unchanged.
    """
    if _is_stream(path):
        with tempfile.TemporaryDirectory() as folder:
            made = Path(folder, path.name)
            yield made
            with writing(path), made.open("rb") as source, path.open("wb") as stream:
                shutil.copyfileobj(source, stream)
        return
    path = _without_link(path)
    temporary = _temporary_sibling(path)
    try:
        with _explained(path, temporary):
            path.parent.mkdir(parents=True, exist_ok=True)
            yield temporary
            _sync(temporary)
            temporary.replace(path)
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink()


@contextlib.contextmanager
def atomic_directory(path: Path) -> Generator[Path]:
    """A temporary folder that replaces ``path`` as a whole when the block succeeds.

    Folders that killed writers of ``path`` left are removed; those of living ones are locked. A
    link stays, and the folder that it leads to is replaced.

    Raises:
        WriteError: as ``atomic_path``.
    """
    path = _without_link(path)
    temporary = _temporary_sibling(path)
    try:
        with _explained(path, temporary):
            path.parent.mkdir(parents=True, exist_ok=True)
            with _locked_folder(temporary):
                for leftover in _leftovers(path):
                    _remove_if_abandoned(leftover)
                yield temporary
                for file in temporary.rglob("*"):
                    if file.is_file():
                        _sync(file)
                _put_in_place(temporary, path)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


@contextlib.contextmanager
def _locked_folder(path: Path) -> Generator[None]:
    """A new folder that this process has locked, where the file system can lock folders."""
    while True:
        path.mkdir()
        descriptor = os.open(path, os.O_RDONLY)
        with contextlib.suppress(OSError):
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if os.fstat(descriptor).st_nlink:
            break
        os.close(descriptor)  # another writer took it for abandoned before it was locked
    try:
        yield
    finally:
        os.close(descriptor)


def _remove_if_abandoned(folder: Path) -> None:
    """Remove a temporary folder that no living process has locked."""
    with contextlib.suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            try:
                is_free = _locked(descriptor)
            except OSError:  # no such locks, as on some network file systems
                is_free = time.time() - folder.stat().st_mtime > _ABANDONED_S
            if is_free:
                shutil.rmtree(folder, ignore_errors=True)
        finally:
            os.close(descriptor)


def _is_stream(path: Path) -> bool:
    """Whether a path is written to and not replaced: a device, a FIFO, an open file's number."""
    is_kept = path.is_dir() or (path.is_file() and not str(path).startswith(_OPEN_FILES))
    return path.exists() and not is_kept


def _without_link(path: Path) -> Path:
    # The current folder and the one above have no name of their own there.
    is_named = path.name not in ("", "..") and not path.is_symlink()
    return path if is_named else Path(os.path.realpath(path))


def _put_in_place(temporary: Path, path: Path) -> None:
    """Rename a folder to ``path``; the old one is removed last, or restored on failure."""
    retired = _temporary_sibling(path)
    if path.exists():
        path.rename(retired)
    try:
        temporary.rename(path)
    except OSError:
        if retired.exists():
            retired.rename(path)
        raise
    shutil.rmtree(retired, ignore_errors=True)


@contextlib.contextmanager
def _explained(path: Path, temporary: Path) -> Generator[None]:
    """Turn an ``OSError`` about writing ``path`` into a ``WriteError``; let others pass."""
    try:
        yield
    except OSError as error:
        file = Path(error.filename) if isinstance(error.filename, str) else None
        ours = file is not None and (file.is_relative_to(temporary) or path.is_relative_to(file))
        if not ours and error.errno not in NO_ROOM:
            raise
        raise WriteError(
            f"could not write {path}: {error.strerror or error}",
            hint="Nothing half-written was left: free space or fix the rights, and run again",
        ) from error


@contextlib.contextmanager
def writing(path: Path) -> Generator[None]:
    """A block that does nothing but make ``path``, in place, and says so where it cannot.

    Raises:
        WriteError: an ``OSError`` in the block.
    """
    try:
        yield
    except OSError as error:
        raise WriteError(
            f"could not write {path}: {error.strerror or error}",
            hint="Free space or fix the rights, or name another folder",
        ) from error


def _temporary_sibling(path: Path) -> Path:
    if path == path.parent:
        raise WriteError(f"could not write {path}: it is the root of all files", hint="Name a file")
    # The suffix stays last, because writers such as Pillow and numpy choose the format by it.
    return path.with_name(f".{path.name}.{uuid.uuid4().hex[:12]}.part{path.suffix}")


def remove_leftovers(path: Path) -> None:
    """Remove temporary files that killed writers of ``path`` left beside it.

    Call it only while holding the lock under which ``path`` is written.
    """
    for leftover in _leftovers(path):
        if not leftover.is_dir():
            leftover.unlink(missing_ok=True)


def _leftovers(path: Path) -> list[Path]:
    return list(path.parent.glob(f".{glob.escape(path.name)}.*.part*"))


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def write_text(path: Path, text: str) -> None:
    """Write UTF-8 text atomically."""
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_json(path: Path, value: Mapping[str, object]) -> None:
    """Write indented JSON atomically; refuses NaN and infinity, which JSON does not have."""
    write_text(path, json.dumps(value, indent=2, allow_nan=False) + "\n")


def read_json(path: Path) -> dict[str, Any]:
    """The object in a JSON file.

    Raises:
        DataError: no such file, one of more than 64 MiB, or as ``parsed_json``.
    """
    try:
        with path.open("rb") as stream:
            content = stream.read(_MOST_BYTES + 1)
    except FileNotFoundError as error:
        raise DataError(f"no file at {path}") from error
    except OSError as error:
        raise DataError(f"could not read {path}: {error.strerror or error}") from error
    if len(content) > _MOST_BYTES:
        raise DataError(f"{path} is too large", expected=f"at most {_MOST_BYTES} bytes")
    return parsed_json(content, path)


def parsed_json(content: str | bytes, source: str | Path) -> dict[str, Any]:
    """The object in JSON text, or in its bytes in UTF-8.

    Args:
        content: The text.
        source: Where it comes from, for messages.

    Raises:
        DataError: not JSON (with line and column), NaN or infinity, or not an object.
    """
    try:
        text = content if isinstance(content, str) else content.decode("utf-8-sig")
        value: object = json.loads(
            text, parse_constant=refuse_constant, object_pairs_hook=_each_name_once
        )
    except (ValueError, RecursionError) as error:
        raise DataError(f"{source} is not valid JSON: {error}") from error
    if not _is_object(value):
        raise DataError(
            f"{source} is not a JSON object", expected="{ ... }", got=type(value).__name__
        )
    return value


def _each_name_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """The object of these pairs; of a name that stands twice, Python would take the last one."""
    found = dict(pairs)
    if len(found) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"the name {twice!r} stands twice in one object")
    return found


def refuse_constant(name: str) -> float:
    """Nothing: NaN and infinity are no JSON, though Python reads them; for ``json.loads``.

    Raises:
        ValueError: always.
    """
    raise ValueError(f"{name} is no number in JSON")


def _is_object(value: object) -> TypeGuard[dict[str, Any]]:
    return isinstance(value, dict)


@contextlib.contextmanager
def exclusive_lock(path: Path) -> Generator[None]:
    """Hold the lock file ``path``; waits while another process or thread holds it.

    The kernel releases it when its holder dies, however it dies, so no stale lock can remain.

    Raises:
        Interrupted: the run was stopped while it waited.
        WriteError: the file cannot be made.
    """
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        stream = path.open("a")
    with stream:
        while not _locked(stream.fileno()):
            require_not_stopped()
            time.sleep(_LOCK_POLL_S)
        try:
            yield
        finally:
            fcntl.flock(stream, fcntl.LOCK_UN)


def _locked(descriptor: int) -> bool:
    """Whether the lock could be taken at once.

    The call never blocks, because a thread that waits in the kernel would not notice a stop.
    """
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True

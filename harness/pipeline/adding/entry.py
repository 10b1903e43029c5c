"""The manifest that ``harness data add`` writes: checked before it replaces the old one."""

from __future__ import annotations

import os
from pathlib import Path

from harness.core.errors import DataError, HarnessError
from harness.core.files.atomic import atomic_path, exclusive_lock
from harness.data.adding.manifest_text import check_addable, with_dataset
from harness.data.manifest import Dataset, Manifest, installed_manifest_path, load_manifest


def manifest_to_write(named: Path | None) -> Path:
    """The named manifest, the one of ``HARNESS_MANIFEST``, or that of the current folder.

    Never the installed one: it may not exist yet.
    """
    path = named or Path(os.environ.get("HARNESS_MANIFEST") or "data_manifest.yaml")
    return path.resolve()


def check_name(path: Path, name: str, *, replace: bool) -> None:
    """Refuse a dataset's name that ``write_entry`` would refuse, before anything is done.

    Raises:
        HarnessError: a split or another dataset has the name.
        DataError: the manifest is not valid as it is.
    """
    manifest = load_manifest(_source(path))
    if name in manifest.splits:
        raise HarnessError(
            f"'{name}' is the name of a split in {manifest.path}", hint="Choose another name"
        )
    check_addable(_text(manifest.path), name, replace=replace)


def write_entry(path: Path, name: str, dataset: Dataset, *, replace: bool) -> bool:
    """Write a manifest with one more dataset; whether the file is new.

    A file that is not there begins as a copy of the installed manifest. Of two commands at once,
    the second adds to what the first wrote.

    Raises:
        HarnessError: the name is taken.
        DataError: the manifest would not be valid, or cannot be written.
    """
    with exclusive_lock(path.parent / f".{path.name}.lock"):
        check_name(path, name, replace=replace)
        created = not path.is_file()
        text = with_dataset(_text(_source(path)), name, dataset, replace=replace)
        with atomic_path(path) as temporary:
            temporary.write_bytes(text.encode())
            _check_reads_back(temporary, path, name, dataset)
    return created


def _source(path: Path) -> Path:
    return path if path.is_file() else installed_manifest_path()


def _text(path: Path) -> str:
    # Bytes, because reading as text would make other line ends of those that are there.
    return path.read_bytes().decode("utf-8")


def _check_reads_back(temporary: Path, path: Path, name: str, dataset: Dataset) -> None:
    try:
        found = Manifest(temporary).datasets.get(name)
    except HarnessError as error:
        what = str(error).replace(str(temporary), path.name)
        raise DataError(f"{path} would not be valid with '{name}', and was left as it is",
                        got=what) from error  # fmt: skip
    if found != dataset:
        raise DataError(
            f"the entry '{name}' would not be read back as it is meant, and was not written",
            expected=repr(dataset),
            got=repr(found),
        )

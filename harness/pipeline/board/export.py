"""``harness results export``: records and meshes of a run become a submission."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

from harness.core.errors import HarnessError
from harness.core.files.atomic import atomic_directory
from harness.core.privileges import Privilege
from harness.core.records import Record
from harness.data.manifest import Manifest
from harness.pipeline.board.entries import Entry
from harness.pipeline.run.result_files import MESH_FILE
from harness.pipeline.run.store import RunStore


def withheld(records: Sequence[Record], manifest: Manifest) -> dict[str, str]:
    """Methods whose meshes are scans that may not be passed on, with the licence, by name."""
    found: dict[str, str] = {}
    for record in records:
        dataset = manifest.datasets.get(record.dataset)
        if Privilege.GROUND_TRUTH_MESH in record.privileges and (
            dataset is None or not dataset.may_be_passed_on
        ):
            licence = "unknown" if dataset is None else dataset.licence
            found[record.method_name] = f"dataset '{record.dataset}', licence {licence}"
    return found


def export_results(
    store: RunStore, records: Sequence[Record], version: str, root: Path
) -> tuple[Entry, ...]:
    """One entry for each method of some records, with the meshes that were scored.

    Records without a mesh go along, with the reason why there is none.

    Raises:
        HarnessError: this version is there already.
        DataError: a mesh that is gone, or is not the one that was scored.
    """
    names = tuple(dict.fromkeys(record.method_name for record in records))
    entries = tuple(Entry(root, name, version) for name in names)
    for entry in entries:
        if entry.directory.exists():
            raise HarnessError(
                f"{entry.directory} is there already",
                hint="Give another --version, or remove it",
            )
    for entry in entries:
        with atomic_directory(entry.directory) as temporary:
            for record in records:
                if record.method_name == entry.method:
                    _write(store, record, temporary)
    return entries


def _write(store: RunStore, record: Record, folder: Path) -> None:
    record.save(folder / f"{record.subject}.json")
    if record.status == "ok":
        shutil.copyfile(store.result(record, MESH_FILE), folder / f"{record.subject}.ply")

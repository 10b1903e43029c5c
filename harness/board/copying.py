"""``harness results export`` and ``merge``: records and meshes are copied, and nothing else."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from harness.board.entries import Entry, versions
from harness.board.verify import Verification
from harness.core.errors import HarnessError
from harness.core.files.atomic import atomic_directory
from harness.core.files.reach import inside
from harness.core.protocols import Privilege
from harness.core.records import Record
from harness.data.manifest import Manifest
from harness.run.publication import MESH_FILE
from harness.run.store import RunStore


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
    names = dict.fromkeys(record.method_name for record in records)
    entries = tuple(Entry(root, name, version) for name in names)
    for entry in entries:
        if entry.directory.exists():
            raise HarnessError(
                f"{entry.directory} is there already", hint="Give another --version, or remove it"
            )
    for entry in entries:
        with atomic_directory(entry.directory) as folder:
            for record in (each for each in records if each.method_name == entry.method):
                record.save(folder / f"{record.subject}.json")
                if record.status == "ok":
                    mesh = store.result(record, MESH_FILE)
                    shutil.copyfile(mesh, folder / f"{record.subject}.ply")
    return entries


@dataclass(frozen=True, slots=True)
class MergedEntry:
    """An entry that is on the board now.

    Attributes:
        entry: Its place on the board.
        subjects: How many it has.
        means: By metric's id, over its subjects with numbers.
        before: The same of the version of this method that was on the board last, by name.
        last: That version; empty if this is the method's first.
    """

    entry: Entry
    subjects: int
    means: dict[str, float]
    before: dict[str, float]
    last: str

    def __str__(self) -> str:
        numbers = ", ".join(
            f"{name} {mean:.2f}" + (f" ({mean - self.before[name]:+.2f})" if self.last else "")
            for name, mean in self.means.items()
            if not self.last or name in self.before
        )
        against = f", against {self.last}" if self.last else ", new"
        return f"{self.entry.title}{against}: {self.subjects} subjects, {numbers}"


def merge_entry(entry: Entry, verified: Verification, board: Entry) -> MergedEntry:
    """Copy a verified entry to its place on a board.

    Args:
        entry: What was handed in.
        verified: What was found in it.
        board: Its place: the same method and version.

    Raises:
        HarnessError: something was found; this version is on the board; or subjects would be lost
            that the method's last version on the board has.
        DataError: its place on the board leads out of it.
    """
    if verified.findings:
        raise HarnessError(
            f"{entry.title} does not go on the board",
            got="; ".join(map(str, verified.findings)),
            hint="'harness results verify' lists what is wrong",
        )
    inside(board.root, board.directory, board.root)
    if board.directory.exists():
        raise HarnessError(
            f"{board.title} is on the board already", hint="Hand it in as another version"
        )
    last = next(reversed(versions(board)), None)
    lost = sorted(set(last.proven) - set(verified.scored)) if last else []
    if last and lost:
        raise HarnessError(
            f"{entry.title} has lost subjects that {last.entry.title} has", got=", ".join(lost)
        )
    records = [entry.record_path(each) for each in (*verified.scored, *verified.failed)]
    with atomic_directory(board.directory) as folder:
        # What was not verified stays away, and a link is not followed.
        for path in (*records, *map(entry.mesh_path, verified.scored)):
            shutil.copyfile(path, folder / path.name, follow_symlinks=False)
    found = board.read()
    return MergedEntry(
        entry=board,
        subjects=len(found.proven),
        means=found.means(),
        before=last.means() if last else {},
        last=last.entry.version if last else "",
    )

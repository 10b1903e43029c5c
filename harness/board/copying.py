"""``harness results export``, ``merge`` and ``compare``: what is handed in, and what it changes.

Records and meshes are copied, and nothing else. A version stays as it was once it is on a board: a
changed or removed one is a fault, and so is a new version without subjects that the method's last
version has.
"""

import shutil
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from harness.board.entries import Entry, entries_in, versions
from harness.board.verify import Verification
from harness.core.errors import HarnessError, ProtocolMismatch
from harness.core.files.atomic import atomic_directory
from harness.core.files.hashing import file_sha256
from harness.core.files.names import inside
from harness.core.metric_catalog import METRICS
from harness.core.protocols import Privilege
from harness.core.records import Record
from harness.data.manifest import Manifest
from harness.run.publication import MESH_FILE
from harness.run.store import RunStore
from reports.tables.geometry import GEOMETRY_METRICS
from reports.tables.selection import check_comparable


@dataclass(frozen=True, slots=True)
class EntryChange:
    """An entry that is not the same on two boards.

    Attributes:
        entry: Method and version.
        against: The method's last version on the earlier board; empty if this is its first.
        subjects: How many have numbers now.
        failed: Subjects that were handed in without numbers.
        means: By metric's id, over subjects with numbers now.
        changes: By metric's id, how the mean differs from that of ``against`` over the subjects
            that both have; empty where they cannot be compared.
        apart: Why they cannot be compared; empty where they can.
        faults: Why the board should not take it, as sentences without a full stop.
    """

    entry: str
    against: str = ""
    subjects: int = 0
    failed: tuple[str, ...] = ()
    means: dict[str, float] = field(default_factory=dict[str, float])
    changes: dict[str, float] = field(default_factory=dict[str, float])
    apart: str = ""
    faults: tuple[str, ...] = ()


def changed_entries(base: Path, head: Path) -> tuple[Entry, ...]:
    """The entries of ``head`` that ``base`` does not have, or has with other files."""
    return tuple(
        entry for entry in _entries_there(head) if _files(entry) != _files(_there(entry, base))
    )


def compare_boards(base: Path, head: Path) -> tuple[EntryChange, ...]:
    """What is not the same on two boards, by method and version.

    Args:
        base: The board as it was; it may have nothing, or not be there.
        head: The board as it would be; what cannot be read on it is a fault of its entry.

    Raises:
        HarnessError: the board as it would be is no folder.
    """
    if not head.is_dir():
        hint = "A board without results is an empty folder"
        raise HarnessError(f"there is no board at {head}", hint=hint)
    removed = [entry for entry in _entries_there(base) if not _there(entry, head).subjects()]
    changes = [_change(entry, _there(entry, base)) for entry in changed_entries(base, head)]
    changes += [EntryChange(entry.title, faults=("removed",)) for entry in removed]
    return tuple(sorted(changes, key=lambda change: change.entry))


def changes_markdown(changes: Sequence[EntryChange]) -> str:
    """What changes, for people: a table, and a list of faults."""
    if not changes:
        return "No results change.\n"
    heads = [f"{METRICS[name].title} ({METRICS[name].unit})" for name in GEOMETRY_METRICS]
    lines = [
        "### What changes on the board",
        "",
        f"| Results | against | subjects | failed | {' | '.join(heads)} |",
        f"| :--- | :--- | ---: | ---: |{' ---: |' * len(heads)}",
        *(_line(change) for change in changes if change.subjects or change.failed),
    ]
    if any(change.changes for change in changes):
        lines += ["", "In brackets: the change over the subjects that both versions have."]
    lines += [
        f"\n`{change.entry}` cannot be compared with `{change.against}`: {_quoted(change.apart)}."
        for change in changes
        if change.apart
    ]
    faults = [
        f"* `{change.entry}`: {_told(fault)}" for change in changes for fault in change.faults
    ]
    if faults:
        lines += ["", "### Faults", "", *faults]
    return "\n".join(lines) + "\n"


def _change(entry: Entry, before: Entry) -> EntryChange:
    now, there = entry.read(), before.read()
    last = there if before.subjects() else next(reversed(versions(before)), None)
    faults = [f"cannot be read: {subject}: {why}" for subject, why in now.left_out.items()]
    if before.subjects():
        old, new = _files(before), _files(entry)
        names = sorted(name for name in {*new, *old} if new.get(name) != old.get(name))
        faults.append(f"is on the board already and would change: {', '.join(names)}")
    apart, changes = "", dict[str, float]()
    if last is not None:
        if lost := sorted(set(last.proven) - set(now.proven)):
            faults.append(f"lost subjects that `{last.entry.title}` has: {', '.join(lost)}")
        both = sorted(set(last.proven) & set(now.proven))
        try:
            check_comparable([each.records[subject] for subject in both for each in (last, now)])
            means, then = now.means(both), last.means(both)
            changes = {name: means[name] - then[name] for name in means if name in then}
        except ProtocolMismatch as error:
            apart = str(error)
    return EntryChange(
        entry=entry.title,
        against=last.entry.title if last else "",
        subjects=len(now.proven),
        failed=tuple(each for each in entry.subjects() if each not in now.proven),
        means=now.means(),
        changes=changes,
        apart=apart,
        faults=tuple(faults),
    )


def _entries_there(root: Path) -> tuple[Entry, ...]:
    try:
        return entries_in(root)
    except HarnessError:
        return ()


def _there(entry: Entry, root: Path) -> Entry:
    return Entry(root, entry.method, entry.version)


def _files(entry: Entry) -> dict[str, str]:
    """Sums of an entry's files by name; of a link, which is not followed, where it leads."""
    return {
        path.name: f"link to {path.readlink()}" if path.is_symlink() else file_sha256(path)
        for suffix in ("json", "ply")
        for path in entry.directory.glob(f"*.{suffix}")
        if path.is_symlink() or path.is_file()
    }


def _line(change: EntryChange) -> str:
    cells = [_number(change, name) for name in GEOMETRY_METRICS]
    against = f"`{change.against}`" if change.against else "new"
    counts = f"{change.subjects} | {len(change.failed)}"
    return f"| `{change.entry}` | {against} | {counts} | {' | '.join(cells)} |"


def _number(change: EntryChange, name: str) -> str:
    if name not in change.means:
        return "–"
    digits = METRICS[name].digits
    text = f"{change.means[name]:.{digits}f}"
    return text + (f" ({change.changes[name]:+.{digits}f})" if name in change.changes else "")


def _quoted(text: str) -> str:
    """Text out of records as it is, whatever Markdown it holds."""
    return "`" + text.replace("`", "'").replace("\n", " ").rstrip(".") + "`"


def _told(fault: str) -> str:
    """A fault as Markdown; only what it says of lost subjects is of names alone."""
    what, colon, rest = fault.partition(": ")
    return f"{what}{colon}{rest if what.startswith('lost') else _quoted(rest)}" if rest else what


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

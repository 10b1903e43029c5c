"""``harness results compare``: what a board would show that it did not show before.

A version stays as it was once it is on a board: a changed or removed one is a fault, and so is a
new version without subjects that the method's last version has.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from harness.board.entries import Entry, entries_in, versions
from harness.core.errors import HarnessError, ProtocolMismatch
from harness.core.files.hashing import file_sha256
from harness.core.metric_catalog import METRICS
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
    return tuple(entry for entry in _entries(head) if _files(entry) != _files(_there(entry, base)))


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
    removed = [entry for entry in _entries(base) if not _there(entry, head).subjects()]
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


def _entries(root: Path) -> tuple[Entry, ...]:
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

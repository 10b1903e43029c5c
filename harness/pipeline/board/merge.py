"""``harness results merge``: results without faults go on a board, and what changes is said."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

from harness.core.errors import HarnessError
from harness.core.files.atomic import atomic_directory
from harness.pipeline.board.entries import Entry
from harness.pipeline.board.standing import last_version, means, proven
from harness.pipeline.board.verify import Verification


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
    """
    if verified.findings:
        raise HarnessError(
            f"{entry.title} does not go on the board",
            got="; ".join(map(str, verified.findings)),
            hint="'harness results verify' lists what is wrong",
        )
    if board.directory.exists():
        raise HarnessError(
            f"{board.title} is on the board already", hint="Hand it in as another version"
        )
    last = last_version(board)
    lost = sorted(set(proven(last)) - set(verified.scored)) if last else []
    if last and lost:
        raise HarnessError(
            f"{entry.title} has lost subjects that {last.title} has", got=", ".join(lost)
        )
    with atomic_directory(board.directory) as temporary:
        # What was not verified stays away, and a link is not followed.
        for subject in (*verified.scored, *verified.failed):
            _copy(entry.record_path(subject), temporary)
        for subject in verified.scored:
            _copy(entry.mesh_path(subject), temporary)
    return MergedEntry(
        entry=board,
        subjects=len(proven(board)),
        means=means(board),
        before=means(last) if last else {},
        last=last.version if last else "",
    )


def _copy(path: Path, folder: Path) -> None:
    shutil.copyfile(path, folder / path.name, follow_symlinks=False)

"""The sealed split: nobody looks at it without a reason, and every look is logged.

A dataset is sealed by ``sealed: true`` in the manifest. Making and rendering it is only announced;
evaluating it, scoring meshes on it and drawing it needs a reason and adds a line to the log, before
the work begins, so that an interrupted look is in the log as well.
"""

from dataclasses import dataclass
from pathlib import Path

from harness.core.errors import HarnessError
from harness.core.files.atomic import exclusive_lock, write_text
from harness.data.manifest import Manifest
from harness.run.progress import Progress
from harness.run.record_inputs import SEALED_LOG, checkout, environment, utc_now
from harness.run.workspace import Workspace

_COLUMNS = ("Date (UTC)", "Commit", "What", "Reason", "Methods", "Recipe", "Subjects")
_HEAD = f"""\
# Looks at sealed data

| {" | ".join(_COLUMNS)} |
|{"---|" * len(_COLUMNS)}
"""


@dataclass(frozen=True, slots=True)
class Look:
    """What is asked of a dataset.

    Attributes:
        what: ``evaluation``, ``scores of meshes``, ``contact sheet`` or ``figure NAME``.
        dataset: Its name, never a split's.
        subjects: Which of its subjects.
        reason: Why; may be empty where the dataset is not sealed.
        methods: Whose results are seen.
        recipe: Recipe of the photos; empty where there are none.
    """

    what: str
    dataset: str
    subjects: tuple[str, ...]
    reason: str
    methods: tuple[str, ...] = ()
    recipe: str = ""


def announce(manifest: Manifest, dataset: str, progress: Progress) -> None:
    """Say that a dataset is sealed, if it is."""
    if manifest.datasets[dataset].sealed:
        progress.say(
            f"dataset '{dataset}' is sealed: it is kept for the last test, and looking at it "
            "or evaluating on it needs --reason and is logged"
        )


def admit(manifest: Manifest, workspace: Workspace, look: Look, progress: Progress) -> Path | None:
    """Allow a look at a dataset; a look at sealed data is announced and logged.

    Returns:
        The log that a line was added to, or None if the dataset is not sealed.

    Raises:
        HarnessError: the dataset is sealed and no reason was given.
        DataError: the log cannot be written.
    """
    if not manifest.datasets[look.dataset].sealed:
        return None
    if not look.reason.strip():
        raise HarnessError(
            f"dataset '{look.dataset}' is sealed, and this {look.what} has no reason",
            hint='Give --reason "why it is looked at now"; it is logged with date and commit',
        )
    announce(manifest, look.dataset, progress)
    path = log_path(workspace)
    _append(path, _row(look))
    progress.say(f"logged in {path}")
    return path


def refuse(manifest: Manifest, dataset: str, purpose: str) -> None:
    """Keep sealed data out of what must never see it.

    Raises:
        HarnessError: the dataset is sealed.
    """
    if manifest.datasets[dataset].sealed:
        raise HarnessError(
            f"dataset '{dataset}' is sealed and never used for {purpose}",
            hint="Name another --dataset",
        )


def log_path(workspace: Workspace) -> Path:
    """``docs/lab/sealed.md`` of a source checkout; in the workspace where there is no checkout."""
    source = checkout()
    return workspace.root / Path(SEALED_LOG).name if source is None else source / SEALED_LOG


def _row(look: Look) -> str:
    made = environment()
    commit = made.commit[:12] if made.commit else f"version {made.harness}"
    cells = (
        utc_now(),
        f"{commit} (dirty)" if made.dirty else commit,
        look.what,
        look.reason,
        ", ".join(look.methods),
        look.recipe,
        f"{look.dataset}: {', '.join(look.subjects)}",
    )
    return f"| {' | '.join(_one_line(cell) or '–' for cell in cells)} |\n"


def _one_line(text: str) -> str:
    """A cell's text: a bar or the end of a line would end the cell."""
    return " ".join(text.replace("|", "/").split())


def _append(path: Path, row: str) -> None:
    with exclusive_lock(path.with_name(f".{path.name}.lock")):
        before = path.read_text(encoding="utf-8") if path.is_file() else _HEAD
        write_text(path, f"{before.rstrip()}\n{row}")

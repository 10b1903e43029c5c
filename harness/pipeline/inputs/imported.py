"""Where imported captures lie, and which there are: a dataset of photos without scans."""

from __future__ import annotations

import re
from pathlib import Path

from harness.core.artifacts import Capture
from harness.core.errors import DataError, did_you_mean
from harness.core.files.names import checked_name
from harness.pipeline.inputs.workspace import Workspace

#: The dataset that imported captures are in, and what stands in the place of their recipe.
CAPTURES, IMPORTED = "captures", "imported"


def imported_subjects(workspace: Workspace, dataset: str = CAPTURES) -> tuple[str, ...]:
    """The names of all imported captures, in order."""
    folder = workspace.root / "captures" / checked_name("dataset", dataset)
    return tuple(sorted(path.parent.parent.name for path in folder.glob(f"*/{IMPORTED}/*.json")
                        if path.name == "capture.json"))  # fmt: skip


def captures_below(folder: Path) -> str:
    """A hint that names the folders of a folder which hold captures; empty where none does."""
    found = sorted(path.parent.name for path in folder.glob("*/capture.json"))
    return f"Name one of its folders: {', '.join(found)}" if found else ""


def imported_state(directory: Path) -> tuple[str, str]:
    """``cached`` or ``missing``, and why, of an imported capture.

    No code makes it stale: its pictures are what they were at the import.
    """
    if not (directory / "capture.json").is_file():
        return "missing", "import it with 'harness capture import'"
    try:
        damage = Capture.load(directory).damage()
    except DataError as error:
        return "missing", str(error)
    return ("missing", f"{damage}: import it again") if damage else ("cached", "")


def imported_capture(workspace: Workspace, subject: str) -> Capture:
    """An imported capture by its name, with views counted from the front.

    Raises:
        DataError: there is none of that name, or it is damaged.
    """
    directory = workspace.capture(CAPTURES, subject, IMPORTED)
    state, why = imported_state(directory)
    if state != "cached":
        known = imported_subjects(workspace)
        hint = "" if subject in known else did_you_mean(subject, known)
        raise DataError(f"imported capture '{subject}' cannot be used: {why}", hint=hint)
    return Capture.load(directory).from_front()


def name_for(path: Path) -> str:
    """A name for what is imported from a file or folder: its own, without what no name may have."""
    words = re.sub(r"[^A-Za-z0-9_-]+", "-", path.resolve().stem).strip("-")
    return checked_name("capture", words[:40] or "photos")

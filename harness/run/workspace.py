"""Where things lie: data, captures and runs below one folder."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from harness.core.files.names import checked_name, named_from


@dataclass(frozen=True, slots=True)
class Workspace:
    """The folder that holds ``data/``, ``captures/`` and ``runs/``.

    Every name that becomes part of a path is checked, so that no path leads out of the folder.

    Attributes:
        root: The current folder unless ``HARNESS_WORKSPACE`` or ``--workspace`` names another.
    """

    root: Path

    @classmethod
    def default(cls, named: str | Path | None = None) -> Workspace:
        """The workspace that a command uses."""
        return cls(Path(named or os.environ.get("HARNESS_WORKSPACE", ".")).resolve())

    def capture(self, dataset: str, subject: str, recipe: str) -> Path:
        """Folder of one capture."""
        return (
            self.root
            / "captures"
            / checked_name("dataset", dataset)
            / checked_name("subject", subject)
            / checked_name("recipe", recipe)
        )

    def run(self, name: str) -> Path:
        """Folder of one run."""
        return self.runs / checked_name("run", name)

    @property
    def shared(self) -> Path:
        """Folder of work that methods share; deleting it loses nothing but time."""
        return self.root / "captures" / ".shared"

    @property
    def fitted_bodies(self) -> Path:
        """Folder of bodies that were made of scans' fits; deleting it loses nothing but time."""
        return self.root / "captures" / ".bodies"

    def within(self, message: str) -> str:
        """The message, with files below the workspace named from there: records are passed on."""
        return named_from(message, self.root)

    @property
    def runs(self) -> Path:
        """Folder of all runs."""
        return self.root / "runs"

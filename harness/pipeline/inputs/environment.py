"""Where and with what a record was made: host, packages, commit."""

from __future__ import annotations

import os
import platform
import subprocess
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cache
from pathlib import Path

import harness
from harness.core.process.source_digest import installed_version
from harness.core.records import Environment

SEALED_LOG = "docs/lab/sealed.md"
"""Where a checkout logs looks at sealed data; a new line in it changes no number."""

_PACKAGES = ("numpy", "scipy", "open3d", "scikit-image", "torch", "bpy", "anny", "mediapipe",
             "onnxruntime")  # fmt: skip


def utc_now() -> str:
    """The present moment, ISO 8601, UTC, whole seconds."""
    return datetime.now(UTC).isoformat(timespec="seconds")


@cache
def environment() -> Environment:
    """Host, interpreter, package versions, and a checkout's commit and dirty flag."""
    made_from = _commit()
    return Environment(
        harness=harness.__version__,
        python=platform.python_version(),
        system=platform.platform(),
        machine=platform.machine(),
        cpus=os.cpu_count(),
        packages={name: installed_version(name) or None for name in _PACKAGES},
        commit=made_from.sha,
        dirty=made_from.dirty,
    )


def checkout() -> Path | None:
    """The source checkout that this program runs from, or None if it was installed."""
    folder = Path(__file__).resolve().parents[3]
    return folder if (folder / ".git").exists() else None


@dataclass(frozen=True, slots=True)
class _Commit:
    """A checkout's commit and whether it has changes that are in no commit; None where unknown."""

    sha: str | None = None
    dirty: bool | None = None


def _commit() -> _Commit:
    folder = checkout()
    if folder is None:
        return _Commit()
    try:
        commit = _git(folder, "rev-parse", "HEAD")
        changed = _git(folder, "status", "--porcelain", "--", ".", f":(exclude){SEALED_LOG}")
        return _Commit(commit, bool(changed))
    except (OSError, subprocess.SubprocessError):
        return _Commit()


def _git(folder: Path, *arguments: str) -> str:
    command = ["git", "-C", str(folder), *arguments]
    return subprocess.run(
        command, capture_output=True, text=True, check=True, timeout=10
    ).stdout.strip()

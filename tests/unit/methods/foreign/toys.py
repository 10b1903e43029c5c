"""A ball to photograph, a method that is a command and writes one triangle, and processes."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from methods.foreign.command_method import CommandMethod
from methods.foreign.method_file import METHOD_FILE

#: The ball that is photographed, somewhat off the middle: no frame can be mistaken for another.
RADIUS = 0.3
MIDDLE = np.array([0.1, 0.25, -0.05])

#: One triangle, and what it saw, as text.
TOY = """\
import json, os, pathlib, sys
photos, mesh = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])
found = sorted(str(path.relative_to(photos)) for path in photos.rglob("*") if path.is_file())
print("@saw", json.dumps({"files": found, "more": sys.argv[3:],
                          "request": json.loads((photos / "request.json").read_text())}))
mesh.write_text("ply\\nformat ascii 1.0\\nelement vertex 3\\nproperty float x\\nproperty float y\\n"
                "property float z\\nelement face 1\\nproperty list uchar int vertex_indices\\n"
                "end_header\\n0 0 0\\n1 0 0\\n0 2 3\\n3 0 1 2\\n")
"""
DESCRIPTION = """\
name = "toy"
title = "A triangle"
licence = "MIT"
command = ["{python}", "run.py", "{photos}", "{mesh}"]
privileges = ["known_cameras", "exact_masks"]
"""


def described(folder: Path, *lines: str, without: str = "nothing at all") -> CommandMethod:
    """The method of ``folder``: ``DESCRIPTION`` and ``lines``, without its lines that begin so."""
    kept = [line for line in DESCRIPTION.splitlines() if not line.startswith(without)]
    (folder / METHOD_FILE).write_text("\n".join([*kept, *lines]) + "\n")
    return CommandMethod.at(folder)


def until(happens: Callable[[], object]) -> None:
    """Return once something is so; it fails after half a minute."""
    end = time.monotonic() + 30
    while not happens():
        assert time.monotonic() < end
        time.sleep(0.05)


def runs(pid: int) -> bool:
    """Whether a process is there and is no zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().split(")")[1].split()[0] != "Z"
    except OSError:
        return False

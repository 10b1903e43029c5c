"""A package of methods that each keep one core busy for some seconds, with the same work always."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from harness.core.artifacts import Capture, Reconstruction
from harness.core.mesh import Mesh
from harness.core.protocols import Context, MethodInfo

#: Some seconds of one core.
_ROUNDS = 40_000_000
_CORNERS = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)
_FACES = np.array(
    [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]
)


def spin(rounds: int = _ROUNDS) -> float:
    """A number in [0, 1) that takes a while, and touches no memory."""
    state = 1
    for _ in range(rounds):
        state = (state * 1103515245 + 12345) & 0x7FFFFFFF
    return state / 0x80000000


class Busy:
    """A method whose result depends on nothing but its work."""

    def __init__(self, name: str) -> None:
        self.info = MethodInfo(name, f"Busy {name}")

    def reconstruct(self, capture: Capture, context: Context) -> Reconstruction:
        with context.stage("make"):
            radius_m = 0.2 + 0.1 * spin()
        return Reconstruction(Mesh(_CORNERS * radius_m + [0.0, 0.8, 0.0], _FACES))


def __getattr__(name: str) -> Busy:
    """``busy_methods.busy0007``: one of as many methods as a package names."""
    if name.startswith("busy"):
        return Busy(name)
    raise AttributeError(name)


def write_package(folder: Path, count: int) -> tuple[str, ...]:
    """A package in a folder of the module path that brings ``count`` methods; their names."""
    names = tuple(f"busy{number:04d}" for number in range(count))
    about = folder / "busy_methods-1.dist-info"
    about.mkdir(parents=True)
    (folder / "busy_methods.py").write_text(Path(__file__).read_text())
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: busy-methods\nVersion: 1\n")
    entries = "\n".join(f"{name} = busy_methods:{name}" for name in names)
    (about / "entry_points.txt").write_text(f"[harness.methods]\n{entries}\n")
    return names

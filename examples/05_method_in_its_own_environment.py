"""Add a method that runs in an environment of its own, and compare it with one that is there.

The method is in ``examples/voxel_carving/``: a ``method.toml`` and one file, for any Python from
3.8 on, with numpy alone. Here it gets a virtual environment that has nothing else.

Run:   python examples/05_method_in_its_own_environment.py
Shell: harness methods add examples/voxel_carving
       harness eval --method voxel-carving,hull8 --dataset avatars
"""

from __future__ import annotations

import shutil
import sys
import tempfile
import venv
from pathlib import Path

import numpy as np
from toy_world import make_world, run_harness

METHOD = Path(__file__).parent / "voxel_carving"


def own_environment(folder: Path) -> None:
    """A virtual environment with numpy; you would run ``pip install numpy`` in a fresh one."""
    venv.EnvBuilder(symlinks=True).create(folder)
    (site,) = folder.glob("lib/python3*/site-packages")
    installed = Path(np.__file__).parents[1]
    about = next(installed.glob("numpy-*.dist-info"))
    for path in (installed / "numpy", installed / "numpy.libs", about):
        if path.exists():
            (site / path.name).symlink_to(path)


def main() -> int:
    """Photograph a toy figure, run both methods on it, and print the table."""
    with tempfile.TemporaryDirectory() as name:
        world, method = Path(name, "world"), Path(name, "voxel_carving")
        world.mkdir()
        make_world(world)
        shutil.copytree(METHOD, method, ignore=shutil.ignore_patterns("__pycache__"))
        own_environment(method / ".venv")
        described = (method / "method.toml").read_text(encoding="utf-8")
        (method / "method.toml").write_text(f'python = ".venv/bin/python"\n{described}')
        added = run_harness(world, "methods", "add", str(method))
        evaluated = run_harness(
            world,
            *("eval", "--method", "voxel-carving,hull8", "--dataset", "toy"),
            *("--subjects", "t1", "--recipe", "tiny", "--protocol", "exact"),
        )
        return added or evaluated or run_harness(world, "report", "--table", "geometry")


if __name__ == "__main__":
    sys.exit(main())

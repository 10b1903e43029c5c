"""Another interpreter than the one that runs the tests: numpy in it, and nothing of ours."""

from __future__ import annotations

import venv
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest


def made_interpreter(folder: Path) -> Path:
    """A virtual environment with the numpy of this one; returns its program."""
    venv.EnvBuilder(symlinks=True, with_pip=False).create(folder)
    (site,) = folder.glob("lib/python3*/site-packages")
    beside = Path(np.__file__).parents[1]
    (about,) = (path.name for path in beside.glob("numpy-*.dist-info"))
    for name in ("numpy", "numpy.libs", about):
        if (beside / name).exists():
            (site / name).symlink_to(beside / name)
    return folder / "bin" / "python"


@pytest.fixture(scope="session")
def other_python(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its program."""
    return made_interpreter(tmp_path_factory.mktemp("other") / "python")


@pytest.fixture(scope="session")
def make_interpreter() -> Callable[[Path], Path]:
    """``make_interpreter(folder)``: one of its own."""
    return made_interpreter

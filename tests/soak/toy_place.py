"""A folder with the toy dataset and a package of methods, and commands that are run there."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

_HERE = Path(__file__).resolve().parent
SUBJECTS = ("t1", "t2")


def _module(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"soak_{path.stem}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@dataclass
class Place:
    """A folder with a toy dataset, a package of methods, and the environment of commands."""

    folder: Path
    methods: tuple[str, ...]
    environment: dict[str, str]

    @classmethod
    def make(cls, folder: Path, cells: int, methods: str = "fast_methods") -> Place:
        """One with as many methods as make the cells with two subjects.

        Args:
            folder: An empty folder, or one that this has made before.
            cells: How many, an even number; a folder that is there keeps its own.
            methods: The module beside this one that writes the package.
        """
        package = folder / "package"
        if not package.exists():
            world = _module(_HERE.parent / "end_to_end" / "conftest.py")
            (folder / "world").mkdir(parents=True)
            (folder / "home").mkdir()
            world.put_world(folder / "world")
            _module(_HERE / f"{methods}.py").write_package(package, cells // len(SUBJECTS))
        (entries,) = package.glob("*.dist-info/entry_points.txt")
        names = tuple(line.split(" = ")[0] for line in entries.read_text().splitlines()[1:])
        paths = [str(package), str(_HERE.parents[1]), os.environ.get("PYTHONPATH", "")]
        environment = {
            **os.environ,
            "PYTHONPATH": os.pathsep.join(filter(None, paths)),
            # Ray writes a token there when it starts.
            "HOME": str(folder / "home"),
            # Whoever starts this may work in another workspace.
            "HARNESS_WORKSPACE": str(folder / "world"),
            "RAY_USAGE_STATS_ENABLED": "0",
            "OMP_NUM_THREADS": "1",
            # Else Ray's own processes, of which each new node starts some, go before the work.
            "RAY_worker_niceness": "0",
        }
        return cls(folder, names, environment)

    @property
    def world(self) -> Path:
        """The workspace."""
        return self.folder / "world"

    @property
    def runs(self) -> Path:
        """Where the runs lie."""
        return self.world / "runs"

    def command(self, run: str, *more: str) -> list[str]:
        """The command that carries the request out."""
        return [
            *(sys.executable, "-m", "harness.cli.main", "eval", "--dataset", "toy"),
            *("--recipe", "tiny", "--subjects", ",".join(SUBJECTS), "--run", run),
            *("--method", ",".join(self.methods), *more),
        ]

    def start(self, run: str, log: Path, *more: str) -> subprocess.Popen[bytes]:
        """The command, begun; its output goes to a file."""
        with log.open("wb") as stream:
            return subprocess.Popen(
                self.command(run, *more), cwd=self.world, env=self.environment,
                stdout=stream, stderr=subprocess.STDOUT, start_new_session=True,
            )  # fmt: skip

    def finish(self, run: str, limit_s: float, *more: str) -> None:
        """The command, carried out.

        Raises:
            RuntimeError: it failed; with the end of its output.
        """
        log = self.folder / f"{run}.log"
        if self.start(run, log, *more).wait(limit_s):
            raise RuntimeError(log.read_text()[-2000:])

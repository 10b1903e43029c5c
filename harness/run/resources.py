"""What a task may use of a machine, and how a task that is carried out elsewhere is kept to it."""

from __future__ import annotations

import contextlib
import fcntl
import importlib
import importlib.util
import os
import tempfile
from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

from harness.core.errors import HarnessError
from harness.core.missing import not_installed

#: How many threads numeric libraries start; each reads its own.
_THREADS = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMEXPR_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
)


@dataclass(frozen=True, slots=True)
class Grant:
    """What one task may use.

    Attributes:
        cpus: Cores.
        gpus: GPUs of a cell, or a share of one; photos have none.
        memory_gib: Memory that has to be free where it runs, GiB; 0 asks for none.
    """

    cpus: int = 1
    gpus: float = 0.0
    memory_gib: float = 0.0

    def __post_init__(self) -> None:
        if self.cpus < 1 or self.gpus < 0 or self.memory_gib < 0:
            raise HarnessError(
                "a task needs one core at least, and no negative number of GPUs or GiB",
                got=f"{self.cpus} cores, {self.gpus:g} GPUs, {self.memory_gib:g} GiB",
            )


@contextlib.contextmanager
def granted(cpus: int) -> Generator[None]:
    """Let child processes that are started in the block use ``cpus`` cores and no more.

    Blender, Open3D and our own threads use every core that they see, so that these processes are
    bound to cores, which no other block on this machine has as long as there are enough.
    """
    allowed = os.sched_getaffinity(0)
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update(dict.fromkeys(_THREADS, str(cpus)))
    try:
        with contextlib.ExitStack() as held:
            own = _own_cores(cpus, sorted(allowed), held) if cpus < len(allowed) else allowed
            os.sched_setaffinity(0, own)
            yield
    finally:
        os.sched_setaffinity(0, allowed)
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def _own_cores(cpus: int, allowed: list[int], held: contextlib.ExitStack) -> set[int]:
    """Cores that no other block on this machine has, or any where fewer than ``cpus`` are free.

    The locks lie on this machine's own disk, and the kernel releases those of a process that dies.
    """
    folder = Path(tempfile.gettempdir(), f"harness-cores-{os.getuid()}")
    found: set[int] = set()
    with contextlib.suppress(OSError), contextlib.ExitStack() as candidates:
        folder.mkdir(mode=0o700, exist_ok=True)
        for core in allowed:
            stream = candidates.enter_context((folder / str(core)).open("a"))
            try:
                fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            found.add(core)
            if len(found) == cpus:
                held.push(candidates.pop_all())
                return found
    # More is granted on this machine than it has: several tasks share a core then.
    first = os.getpid() % len(allowed)
    return set((allowed[first:] + allowed[:first])[:cpus])


def extra_package(package: str, purpose: str) -> ModuleType:
    """A package of an extra, imported now: it takes a second, and most runs do without.

    Args:
        package: Its name.
        purpose: What needs it, as the beginning of a sentence.

    Raises:
        MissingPart: it is not installed.
    """
    if importlib.util.find_spec(package) is None:
        raise not_installed(package, purpose)
    return importlib.import_module(package)

"""The folder of work that methods share, such as body fits: each made once a workspace.

Work is filed under a key of everything that decides it: its inputs, the code that makes it and the
packages that this code imports. Beside it stands what it cost when it was made, and whoever is
handed it is charged that much: a record's times are those of a method that does all by itself.
"""

from __future__ import annotations

import functools
import json
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import numpy as np

from harness.core.artifacts import StageCost
from harness.core.errors import DataError
from harness.core.files.atomic import exclusive_lock, remove_leftovers
from harness.core.files.hashing import content_hash
from harness.core.files.npz import read_array_npz, write_npz
from harness.core.process.shared_work import Work
from harness.core.process.source_digest import SourceDigest, SourceTree
from harness.core.typed_json import from_json, to_json
from harness.run.cost import StageMeter

T = TypeVar("T")

_COST = "shared_cost"


@dataclass(frozen=True, slots=True)
class _Cost:
    """What work cost when it was made, by stage."""

    stages: tuple[StageCost, ...]


@dataclass(slots=True)
class SharedResults:
    """Hands out work that was made before, and keeps what is made.

    Attributes:
        folder: Where it is kept.
        meter: Is charged with the cost of what is handed out.
        is_current: Whether code and inputs are still those that the process began with; nothing is
            kept otherwise, because it could be filed under a key that is not its own.
        taken: Names of what was handed out, in order.
    """

    folder: Path
    meter: StageMeter
    is_current: Callable[[], bool]
    taken: list[str] = field(default_factory=list[str])

    def __call__(self, work: Work[T]) -> T:
        """The outcome of some work; the same, to the bit, whether it was made now or before.

        A file that cannot be read is made anew.

        Raises:
            HarnessError: what making it raises; nothing is kept then.
        """
        key = _key(work)
        path = self.folder / re.sub(r"\W+", "-", work.name) / f"{key}.npz"
        # Who waits while another makes it is charged what it cost, and not for the waiting, too.
        with self.meter.waiting_for(exclusive_lock(path.with_suffix(".lock"))):
            remove_leftovers(path)
            if path.is_file():
                try:
                    value, cost = _read(path, work)
                except DataError:
                    path.unlink()
                else:
                    self.meter.add(cost.stages)
                    self.taken.append(work.name)
                    return value
            return self._made(work, path)

    def _made(self, work: Work[T], path: Path) -> T:
        with self.meter.watched(work.name) as stages:
            value = work.make()
        if self.is_current():
            self._keep(value, work, path, stages)
        return value

    def _keep(self, value: T, work: Work[T], path: Path, stages: Sequence[StageCost]) -> None:
        cost = json.dumps(to_json(_Cost(tuple(stages))))
        arrays = {**work.packed(value), _COST: np.frombuffer(cost.encode(), dtype=np.uint8)}
        write_npz(path, arrays, compressed=False)


def _key(work: Work[T]) -> str:
    code = _code(work.module)
    return content_hash(
        {
            "work": work.name,
            "inputs": dict(work.inputs),
            "code": dict(code.modules),
            "packages": dict(code.packages),
        }
    )


@functools.lru_cache(maxsize=8)
def _code(module: str) -> SourceDigest:
    """Asked once a process, which runs the code that it has imported."""
    return SourceTree.installed(module).digest([module], [])


def _read(path: Path, work: Work[T]) -> tuple[T, _Cost]:
    arrays = read_array_npz(path)
    try:
        document = json.loads(arrays[_COST].tobytes())
        value = work.unpacked(arrays)
    except (KeyError, ValueError) as error:
        raise DataError(f"{path} is not a stored {work.name}", got=str(error)) from error
    return value, from_json(_Cost, document, path, "the cost of shared work")

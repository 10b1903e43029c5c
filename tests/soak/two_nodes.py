"""How much faster two simulated Ray nodes of one core are than one, and what this machine allows.

Methods keep a core busy for some seconds, in processes of their own, and nothing is lost. Because
nodes, the command and Ray itself share this machine's cores, the same work is also done by bare
processes: one alone, and two at once. Two nodes cannot be faster than that.
"""

from __future__ import annotations

import contextlib
import subprocess
import sys
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path

import psutil
from ray_nodes import Nodes, environment
from same_records import left_over, unequal
from toy_place import Place

_SPIN = "import sys; sys.path[:0] = [{folder!r}]; import busy_methods; busy_methods.spin()"
#: More than this and the aim is missed.
_MOST = 0.65
_LOOK_S = 4.0


@dataclass(frozen=True)
class Timed:
    """One way to do it.

    Attributes:
        wall_s: From the start of the command to its end.
        first_s: From the start of the command to the first record.
        others_share: Share of this machine's cores that was in use just before it began.
    """

    wall_s: float
    first_s: float
    others_share: float


@dataclass
class Comparison:
    """What came of it.

    Attributes:
        cells: How many cells each way.
        bare_s: The work of a method alone: one process; each of two at once.
        by_nodes: By number of nodes.
        unequal: Records that are not the same both ways.
        left_over: Attempts and half-written files that stayed.
    """

    cells: int
    bare_s: tuple[float, float] = (0.0, 0.0)
    by_nodes: dict[int, Timed] = field(default_factory=dict)
    unequal: list[str] = field(default_factory=list)
    left_over: list[str] = field(default_factory=list)

    @property
    def share(self) -> float:
        """Two nodes' time as a share of one's; 0.5 would be perfect."""
        return self.by_nodes[2].wall_s / self.by_nodes[1].wall_s

    @property
    def machine_share(self) -> float:
        """The same of bare processes: what this machine allows."""
        one, both = self.bare_s
        return both / (2 * one)

    @property
    def is_good(self) -> bool:
        """Whether records are equal, and two nodes take at most 0.65 of one's time."""
        return not self.unequal and not self.left_over and self.share <= _MOST

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values."""
        shares = {"share": round(self.share, 3), "machine_share": round(self.machine_share, 3)}
        return {"good": self.is_good, **shares, **asdict(self)}


def compare_nodes(cells: int, folder: Path, limit_s: float) -> Comparison:
    """The same cells on one node and on two.

    Args:
        cells: How many, an even number.
        folder: An empty folder.
        limit_s: Longest time for each.
    """
    place = Place.make(folder, cells, "busy_methods")
    _photographed(place, limit_s)
    found = Comparison(cells, bare_s=(_bare(place, 1), _bare(place, 2)))
    for count in (1, 2):
        with environment(place.environment), contextlib.closing(Nodes(count)) as nodes:
            where = ("--executor", "ray", "--ray-address", nodes.address)
            found.by_nodes[count] = _timed(place, f"nodes-{count}", limit_s, where)
    found.unequal = unequal(place.runs / "nodes-1", place.runs / "nodes-2")
    found.left_over = left_over(place.runs / "nodes-1") + left_over(place.runs / "nodes-2")
    if len(list((place.runs / "nodes-2").glob("*/*/record.json"))) != cells:
        found.unequal.append("some have no record")
    return found


def _photographed(place: Place, limit_s: float) -> None:
    """Photos are there before the clock is started."""
    one = Place(place.folder, ("gt",), place.environment)
    one.finish("photos", limit_s)


def _bare(place: Place, count: int) -> float:
    """Time of a method's work in so many processes at once, s."""
    code = _SPIN.format(folder=str(place.folder / "package"))
    begun = time.monotonic()
    processes = [
        subprocess.Popen([sys.executable, "-c", code], env=place.environment) for _ in range(count)
    ]
    if sum(abs(process.wait()) for process in processes):
        raise RuntimeError("the work of a method failed by itself")
    return time.monotonic() - begun


def _timed(place: Place, run: str, limit_s: float, where: tuple[str, ...]) -> Timed:
    others = psutil.cpu_percent(_LOOK_S) / 100
    log, begun, since = place.folder / f"{run}.log", time.monotonic(), time.time()
    command = place.start(run, log, *where)
    try:
        code = command.wait(limit_s)
    finally:
        command.kill()
    wall_s = time.monotonic() - begun
    if code:
        raise RuntimeError(log.read_text()[-2000:])
    filed = [path.stat().st_mtime for path in (place.runs / run).glob("*/*/record.json")]
    return Timed(round(wall_s, 1), round(min(filed) - since, 1), round(others, 3))

"""Ctrl-C at random moments of a run on Ray: it stops at once, and the same command continues.

    python tests/soak/interrupted.py --cells 40 --times 6

A quiet run on this machine comes first. Then the same request is begun on two simulated Ray nodes
again and again, and each time gets Ctrl-C after some seconds: it has to end soon with exit code
130 and one line, and no task of it may stay at work. The last of these runs has a cluster of its
own. Then the command is left alone, and each record has to be there, once, equal to the quiet
run's but for times. Every second time, Ctrl-C comes when the run has filed a record at least.
"""

from __future__ import annotations

import contextlib
import json
import os
import random
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path

import psutil
from plan_options import plan_parser
from ray_nodes import Nodes, environment, workers_at_work
from same_records import left_over, timeless, unequal
from toy_place import Place

_QUIET, _RUN = "quiet", "interrupted"
_CODE, _LINE = 130, "harness: stopped by SIGINT"
#: How soon a command has to end, and its tasks.
_END_S, _TASKS_END_S = 60.0, 20.0


@dataclass(frozen=True)
class Plan:
    """What is done.

    Attributes:
        cells: How many cells, an even number.
        times: How often a run is stopped.
        least_s: It runs so long at least before it is stopped.
        most_s: And so long at most.
        limit_s: Longest time for a run that is left alone.
        seed: Of the moments.
    """

    cells: int = 40
    times: int = 6
    least_s: float = 1.0
    most_s: float = 20.0
    limit_s: float = 900.0
    seed: int = 7


@dataclass(frozen=True)
class Stop:
    """One Ctrl-C.

    Attributes:
        own_cluster: Whether the command had started Ray itself.
        after_s: When it came, after the command began to work; or, where ``in_work``, after it had
            filed a record.
        in_work: Which of the two.
        exit_code: Of the command.
        ended_s: How long the command took to end.
        lines: What it said then, without Ray's own lines.
        at_work: Workers with a task when it came, and some seconds after the command had ended; of
            a command that had started Ray, all processes that it left count then.
        records: Records that are there.
        attempts: Attempts and half-written files that the next run has to clear away.
    """

    own_cluster: bool
    in_work: bool
    after_s: float
    exit_code: int
    ended_s: float
    lines: tuple[str, ...]
    at_work: tuple[int, int]
    records: int
    attempts: int

    @property
    def is_good(self) -> bool:
        """Whether it ended as it should."""
        said = [line for line in self.lines if line.startswith("harness:")]
        one = len(said) == 1 and said[0].startswith(_LINE)
        return self.exit_code == _CODE and one and self.at_work[1] == 0


@dataclass
class Report:
    """What came of it.

    Attributes:
        cells: Cells of the request.
        stops: All Ctrl-Cs.
        exit_code: Of the run that was left alone.
        cached: Records that it found.
        records: Records that are there at the end.
        unequal: Records that are missing or not equal to the quiet run's.
        left_over: Attempts and half-written files that stayed.
    """

    cells: int
    stops: list[Stop] = field(default_factory=list)
    exit_code: int = 0
    cached: int = 0
    records: int = 0
    unequal: list[str] = field(default_factory=list)
    left_over: list[str] = field(default_factory=list)

    @property
    def is_good(self) -> bool:
        """Whether every run stopped as it should, and each record is there once and equal."""
        complete = self.exit_code == 0 and self.records == self.cells
        clean = not self.unequal and not self.left_over
        return complete and clean and all(stop.is_good for stop in self.stops)

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values."""
        return {"good": self.is_good, **asdict(self)}


def interrupt(plan: Plan, folder: Path) -> Report:
    """Begin a run and stop it, again and again, in an empty folder."""
    place, report, dice = (
        Place.make(folder, plan.cells),
        Report(plan.cells),
        random.Random(plan.seed),
    )
    place.finish(_QUIET, plan.limit_s, "--jobs", "2")
    with environment(place.environment), contextlib.closing(Nodes(2, unheard=10)) as nodes:
        where = ("--executor", "ray", "--ray-address", nodes.address)
        for number in range(plan.times):
            own = number == plan.times - 1
            after_s = dice.uniform(plan.least_s, plan.most_s)
            given = ("--executor", "ray") if own else where
            report.stops.append(_stopped(place, number, after_s, given, plan.limit_s))
        report.cached = len(timeless(place.runs / _RUN))
        last = place.start(_RUN, folder / "last.log", *where)
        report.exit_code = last.wait(plan.limit_s)
    report.records = len(timeless(place.runs / _RUN))
    report.unequal = unequal(place.runs / _QUIET, place.runs / _RUN)
    report.left_over = left_over(place.runs / _RUN)
    return report


def _stopped(
    place: Place, number: int, after_s: float, where: tuple[str, ...], limit_s: float
) -> Stop:
    """Begin the run and press Ctrl-C after some time."""
    log, run, in_work = place.folder / f"stopped-{number}.log", place.runs / _RUN, number % 2 == 1
    found = _records(run)
    command = place.start(_RUN, log, *where)
    _until(lambda: "reconstructions:" in log.read_text(errors="replace"), limit_s, log)
    if in_work:
        _until(lambda: _records(run) > found, limit_s, log)
        after_s /= 4
    time.sleep(after_s)
    at_work, below = workers_at_work(), psutil.Process(command.pid).children(recursive=True)
    begun = time.monotonic()
    # As a terminal does: all processes of the command get it.
    os.killpg(command.pid, signal.SIGINT)
    try:
        code = command.wait(_END_S)
    finally:
        command.kill()
    ended_s = time.monotonic() - begun
    while _left(below) and time.monotonic() - begun < ended_s + _TASKS_END_S:
        time.sleep(0.25)
    return Stop(
        own_cluster="--ray-address" not in where,
        in_work=in_work,
        after_s=round(after_s, 1),
        exit_code=code,
        ended_s=round(ended_s, 1),
        lines=_said(log),
        at_work=(len(at_work), _left(below)),
        records=_records(run),
        attempts=len([name for name in left_over(run) if ".attempt-" in name or ".part" in name]),
    )


def _left(below: list[psutil.Process]) -> int:
    """Workers that have a task, and processes of an ended command that have not ended."""
    return len({*workers_at_work(), *(each for each in below if each.is_running())})


def _records(run: Path) -> int:
    return len(list(run.glob("*/*/record.json")))


def _until(is_so: Callable[[], bool], limit_s: float, log: Path) -> None:
    """Wait until something is so."""
    end = time.monotonic() + limit_s
    while not is_so():
        if time.monotonic() > end:
            raise TimeoutError(f"nothing came of the command: {log.read_text()[-2000:]}")
        time.sleep(0.1)


def _said(log: Path) -> tuple[str, ...]:
    """The lines of a command but for its progress."""
    lines = log.read_text(errors="replace").splitlines()
    told = [line for line in lines if line.strip()]
    return tuple(line for line in told if not line.startswith(("photos:", "reconstructions:")))


def main() -> int:
    """The command line."""
    parser = plan_parser(__doc__, Plan())
    parser.add_argument("--folder", type=Path, help="an empty folder that stays")
    given = vars(parser.parse_args())
    folder = given.pop("folder")
    with tempfile.TemporaryDirectory(prefix="harness-interrupted-") as temporary:
        report = interrupt(Plan(**given), folder or Path(temporary, "place"))
    print(json.dumps(report.to_dict(), indent=2))
    return 0 if report.is_good else 1


if __name__ == "__main__":
    sys.exit(main())

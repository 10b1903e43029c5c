"""Many cells on simulated Ray nodes that are lost, and workers that are killed: the same records.

    python tests/soak/soak.py --cells 1000 --drivers 2
    python tests/soak/soak.py --compare-nodes --cells 20

A quiet run on this machine comes first. Then as many drivers as asked for carry out the same
request at once, in one run's folder, on two nodes of a Ray cluster on this machine, while a node is
removed and another one added every few seconds, and workers are killed at random. At the end there
is each record, once, equal to the quiet run's but for times; the report says so as JSON, with the
memory of the drivers. The exit code is 1 if anything is not as it should be.

With ``--compare-nodes``, two quiet nodes are timed against one instead (``two_nodes``).
"""

from __future__ import annotations

import contextlib
import json
import random
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
import psutil
from plan_options import plan_parser
from ray_nodes import Nodes, environment
from same_records import left_over, timeless, unequal
from toy_place import Place
from two_nodes import compare_nodes

_MIB = 1 << 20
_QUIET, _SOAK = "quiet", "soak"


@dataclass(frozen=True)
class Plan:
    """What a soak does.

    Attributes:
        cells: How many cells, an even number.
        drivers: How many commands carry them out at once.
        nodes: Ray nodes of one core each.
        removal_s: A node is removed every so many seconds; 0 removes none.
        kill_s: A worker is killed every so many seconds in the mean; 0 kills none.
        unheard: Ray gives a node up that it has not heard from so often, once a second.
        limit_s: Longest time for the drivers.
        seed: Of the moments.
    """

    cells: int = 1000
    drivers: int = 2
    nodes: int = 2
    removal_s: float = 20.0
    kill_s: float = 5.0
    unheard: int = 3
    limit_s: float = 3000.0
    seed: int = 7


@dataclass(frozen=True)
class Memory:
    """A driver's memory.

    Attributes:
        quarter_mib: After a quarter of its time, MiB.
        end_mib: At the end.
        slope_mib_per_h: Of the straight line through all that came after that quarter.
    """

    quarter_mib: float
    end_mib: float
    slope_mib_per_h: float

    @classmethod
    def of(cls, seen: list[tuple[float, float]]) -> Memory:
        """From seconds and MiB at many moments."""
        later = np.array(seen[len(seen) // 4 :])
        slope = np.polyfit(later[:, 0] / 3600, later[:, 1], 1)[0] if len(later) > 2 else 0.0
        end = later[-4:, 1].max()
        return cls(round(later[0, 1], 1), round(float(end), 1), round(float(slope), 2))


@dataclass
class Report:
    """What came of it.

    Attributes:
        cells: Cells of the request.
        quiet_s: Time of the quiet run, which has this machine's cores.
        soak_s: Time until the last driver ended.
        exit_codes: Of the drivers.
        nodes_removed: How many nodes were lost.
        nodes_given_up: How many Ray gave up by itself, because they did not answer in time.
        workers_killed: How many workers were killed, beside those of the nodes.
        records: Records that are there.
        unequal: Records that are missing or not equal to the quiet run's.
        left_over: Attempts and half-written files that stayed.
        memory: For each driver, how its memory went.
        machines: For each driver, its own lines about which node did what.
    """

    cells: int
    quiet_s: float = 0.0
    soak_s: float = 0.0
    exit_codes: list[int] = field(default_factory=list)
    nodes_removed: int = 0
    nodes_given_up: int = 0
    workers_killed: int = 0
    records: int = 0
    unequal: list[str] = field(default_factory=list)
    left_over: list[str] = field(default_factory=list)
    memory: list[Memory] = field(default_factory=list)
    machines: list[list[str]] = field(default_factory=list)

    @property
    def is_good(self) -> bool:
        """Whether each record is there once and equal, and every driver says so."""
        return (
            self.records == self.cells
            and not self.unequal
            and not self.left_over
            and not any(self.exit_codes)
        )

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values."""
        return {"good": self.is_good, **asdict(self)}


def soak(plan: Plan, folder: Path) -> Report:
    """Carry a soak out in an empty folder, or continue one that was stopped there."""
    place = Place.make(folder, plan.cells)
    report = Report(plan.cells)
    begun = time.monotonic()
    place.finish(_QUIET, plan.limit_s, "--jobs", "2")
    report.quiet_s = time.monotonic() - begun
    with (
        environment(place.environment),
        contextlib.closing(Nodes(plan.nodes, plan.unheard)) as nodes,
    ):
        begun = time.monotonic()
        logs = [folder / f"driver-{number}.log" for number in range(plan.drivers)]
        where = ("--executor", "ray", "--ray-address", nodes.address)
        drivers = [place.start(_SOAK, log, *where) for log in logs]
        try:
            _disturb(plan, nodes, drivers, report)
        finally:
            for driver in drivers:
                driver.kill()
                driver.wait()
        report.soak_s = time.monotonic() - begun
    report.exit_codes = [driver.returncode for driver in drivers]
    report.machines = [
        [line.strip() for line in log.read_text().splitlines() if "reconstructions, photos" in line]
        for log in logs
    ]
    _compare(place.runs, report)
    return report


def _disturb(
    plan: Plan, nodes: Nodes, drivers: list[subprocess.Popen[bytes]], report: Report
) -> None:
    """Remove nodes and kill workers until all drivers have ended."""
    dice = random.Random(plan.seed)
    begun = removed = killed = time.monotonic()
    pause_s = plan.kill_s
    sizes: list[list[tuple[float, float]]] = [[] for _ in drivers]
    while any(driver.poll() is None for driver in drivers):
        now = time.monotonic()
        if now - begun > plan.limit_s:
            raise TimeoutError(f"drivers were still at work after {plan.limit_s:g} s")
        for driver, seen in zip(drivers, sizes, strict=True):
            with contextlib.suppress(psutil.Error):
                size = psutil.Process(driver.pid).memory_info().rss / _MIB
                # A process that has ended has no memory any more.
                seen += [(now - begun, size)] if size > 1.0 else []
        if plan.removal_s and now - removed >= plan.removal_s:
            nodes.remove(dice)
            nodes.add()
            report.nodes_removed += 1
            removed = time.monotonic()
        # Where no worker is at work just now, the next one that is.
        if plan.kill_s and now - killed >= pause_s and nodes.kill_worker(dice):
            report.workers_killed += 1
            killed, pause_s = now, dice.expovariate(1 / plan.kill_s)
        report.nodes_given_up += nodes.replace_given_up()
        time.sleep(0.5)
    report.memory = [Memory.of(seen) for seen in sizes]


def _compare(runs: Path, report: Report) -> None:
    report.records = len(timeless(runs / _SOAK))
    report.unequal = unequal(runs / _QUIET, runs / _SOAK)
    report.left_over = left_over(runs / _SOAK)


def main() -> int:
    """The command line."""
    parser = plan_parser(__doc__, Plan())
    parser.add_argument(
        "--folder", type=Path, help="an empty folder that stays, or one of a soak that was stopped"
    )
    parser.add_argument("--compare-nodes", action="store_true", help="two nodes against one")
    given = vars(parser.parse_args())
    folder, compare = given.pop("folder"), given.pop("compare_nodes")
    with tempfile.TemporaryDirectory(prefix="harness-soak-") as temporary:
        plan, place = Plan(**given), folder or Path(temporary, "soak")
        report = compare_nodes(plan.cells, place, plan.limit_s) if compare else soak(plan, place)
    print(json.dumps(report.to_dict(), indent=2))
    return 0 if report.is_good else 1


if __name__ == "__main__":
    sys.exit(main())

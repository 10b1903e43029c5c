"""Many cells on simulated Ray nodes that are lost, and workers that are killed: the same records.

    python tests/soak/soak.py --cells 1000 --drivers 2

A quiet run on this machine comes first. Then as many drivers as asked for carry out the same
request at once, in one run's folder, on two nodes of a Ray cluster on this machine, while a node is
removed and another one added every few seconds, and workers are killed at random. At the end there
is each record, once, equal to the quiet run's but for times; the report says so as JSON, with the
memory of the drivers. The exit code is 1 if anything is not as it should be.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib.util
import json
import os
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

import psutil

_HERE = Path(__file__).resolve().parent
_MIB = 1 << 20
#: How often a node is started until one has.
_STARTS = 6
_SUBJECTS = ("t1", "t2")
_QUIET, _SOAK = "quiet", "soak"


def _module(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"soak_{path.stem}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@dataclass(frozen=True)
class Plan:
    """What a soak does.

    Attributes:
        cells: How many cells, an even number.
        drivers: How many commands carry them out at once.
        nodes: Ray nodes of one core each.
        removal_s: A node is removed every so many seconds; 0 removes none.
        kill_s: A worker is killed every so many seconds in the mean; 0 kills none.
        limit_s: Longest time for the drivers.
        seed: Of the moments.
    """

    cells: int = 1000
    drivers: int = 2
    nodes: int = 2
    removal_s: float = 20.0
    kill_s: float = 5.0
    limit_s: float = 3000.0
    seed: int = 7


@dataclass
class Report:
    """What came of it.

    Attributes:
        cells: Cells of the request.
        quiet_s: Time of the quiet run, which has this machine's cores.
        soak_s: Time until the last driver ended.
        exit_codes: Of the drivers.
        nodes_removed: How many nodes were lost.
        workers_killed: How many workers were killed, beside those of the nodes.
        records: Records that are there.
        unequal: Records that are missing or not equal to the quiet run's.
        left_over: Attempts and half-written files that stayed.
        memory_mib: For each driver, its memory after a quarter and at the end of its time, MiB.
        machines: For each driver, its own lines about which node did what.
    """

    cells: int
    quiet_s: float = 0.0
    soak_s: float = 0.0
    exit_codes: list[int] = field(default_factory=list)
    nodes_removed: int = 0
    workers_killed: int = 0
    records: int = 0
    unequal: list[str] = field(default_factory=list)
    left_over: list[str] = field(default_factory=list)
    memory_mib: list[tuple[float, float]] = field(default_factory=list)
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


def timeless(run: Path) -> dict[str, Any]:
    """A run's records by method and subject, without what differs between any two runs."""
    found: dict[str, Any] = {}
    for path in sorted(run.glob("*/*/record.json")):
        record = json.loads(path.read_text())
        record.pop("created_utc")
        record["details"].pop("machine")
        for stage in record["stages"]:
            for name in ("wall_s", "peak_rss_mib", "peak_gpu_mib"):
                stage.pop(name)
        found[f"{path.parent.parent.name}/{path.parent.name}"] = record
    return found


@dataclass
class Place:
    """A folder with a toy dataset, a package of fast methods, and the environment of commands."""

    folder: Path
    methods: tuple[str, ...]
    environment: dict[str, str]

    @classmethod
    def make(cls, folder: Path, cells: int) -> Place:
        """One with as many methods as make the cells with two subjects."""
        world = _module(_HERE.parent / "end_to_end" / "conftest.py")
        (folder / "world").mkdir(parents=True)
        (folder / "home").mkdir()
        world.put_world(folder / "world")
        package = folder / "package"
        sys.path.insert(0, str(_HERE))
        fast_methods = importlib.import_module("fast_methods")
        methods = fast_methods.write_package(package, cells // len(_SUBJECTS))
        paths = [str(package), str(_HERE.parents[1]), os.environ.get("PYTHONPATH", "")]
        environment = {
            **os.environ,
            "PYTHONPATH": os.pathsep.join(filter(None, paths)),
            # Ray writes a token there when it starts.
            "HOME": str(folder / "home"),
            "RAY_USAGE_STATS_ENABLED": "0",
            "OMP_NUM_THREADS": "1",
        }
        return cls(folder, methods, environment)

    @property
    def world(self) -> Path:
        """The workspace."""
        return self.folder / "world"

    def command(self, run: str, *more: str) -> list[str]:
        """The command that carries the request out."""
        return [
            *(sys.executable, "-m", "harness.cli.main", "eval", "--dataset", "toy"),
            *("--recipe", "tiny", "--subjects", ",".join(_SUBJECTS), "--run", run),
            *("--method", ",".join(self.methods), *more),
        ]

    def start(self, run: str, log: Path, *more: str) -> subprocess.Popen[bytes]:
        """The command, begun; its output goes to a file."""
        with log.open("wb") as stream:
            return subprocess.Popen(
                self.command(run, *more), cwd=self.world, env=self.environment,
                stdout=stream, stderr=subprocess.STDOUT,
            )  # fmt: skip


class Nodes:
    """A Ray cluster of simulated nodes on this machine, of one core each.

    Args:
        count: How many.
    """

    def __init__(self, count: int) -> None:
        from ray.cluster_utils import Cluster

        # A lost node is noticed after some seconds instead of a quarter of a minute.
        health = {
            "health_check_initial_delay_ms": 0,
            "health_check_period_ms": 1000,
            "health_check_timeout_ms": 2000,
            "health_check_failure_threshold": 3,
        }
        store = 80 * _MIB
        head = {
            "num_cpus": 0,
            "object_store_memory": store,
            "_system_config": health,
            "include_dashboard": False,
        }
        self._cluster: Any = None
        for _ in range(_STARTS):
            # Ray gives a node half a minute, which is little on a machine with other work.
            with contextlib.suppress(Exception):
                self._cluster = Cluster(initialize_head=True, head_node_args=head)
                break
        else:
            raise TimeoutError(f"no Ray head started on this machine in {_STARTS} attempts")
        self._store = store
        self._nodes: list[Any] = []
        for _ in range(count):
            self.add()

    @property
    def address(self) -> str:
        """For ``--ray-address``."""
        return str(self._cluster.address)

    def add(self) -> None:
        """One node more."""
        for _ in range(_STARTS):
            with contextlib.suppress(Exception):
                node = self._cluster.add_node(num_cpus=1, object_store_memory=self._store)
                self._nodes.append(node)
                return
        raise TimeoutError(f"no Ray node started on this machine in {_STARTS} attempts")

    def remove(self, dice: random.Random) -> None:
        """One node less, as if its power were cut."""
        node = self._nodes.pop(dice.randrange(len(self._nodes)))
        self._cluster.remove_node(node, allow_graceful=False)

    @staticmethod
    def kill_worker(dice: random.Random) -> bool:
        """Kill a worker of ours that is at work; whether there was one."""
        busy: list[psutil.Process] = []
        for process in psutil.Process().children(recursive=True):
            with contextlib.suppress(psutil.Error):
                # Ray shows the task's name there.
                title = " ".join(process.cmdline())
                if title.startswith("ray::") and " on t" in title:
                    busy.append(process)
        with contextlib.suppress(psutil.Error):
            if busy:
                dice.choice(busy).kill()
                return True
        return False

    def close(self) -> None:
        """End all."""
        self._cluster.shutdown()


@contextlib.contextmanager
def _environment(values: dict[str, str]) -> Iterator[None]:
    before = dict(os.environ)
    os.environ.update(values)
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)


def soak(plan: Plan, folder: Path) -> Report:
    """Carry a soak out in an empty folder."""
    place = Place.make(folder, plan.cells)
    report = Report(plan.cells)
    begun = time.monotonic()
    quiet = place.start(_QUIET, folder / "quiet.log", "--jobs", "2")
    if quiet.wait(plan.limit_s):
        raise RuntimeError((folder / "quiet.log").read_text()[-2000:])
    report.quiet_s = time.monotonic() - begun
    with _environment(place.environment), contextlib.closing(Nodes(plan.nodes)) as nodes:
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
    _compare(place.world / "runs", report)
    return report


def _disturb(
    plan: Plan, nodes: Nodes, drivers: list[subprocess.Popen[bytes]], report: Report
) -> None:
    """Remove nodes and kill workers until all drivers have ended."""
    dice = random.Random(plan.seed)
    begun = removed = killed = time.monotonic()
    pause_s = plan.kill_s
    sizes: list[list[float]] = [[] for _ in drivers]
    while any(driver.poll() is None for driver in drivers):
        now = time.monotonic()
        if now - begun > plan.limit_s:
            raise TimeoutError(f"drivers were still at work after {plan.limit_s:g} s")
        for driver, seen in zip(drivers, sizes, strict=True):
            with contextlib.suppress(psutil.Error):
                seen.append(psutil.Process(driver.pid).memory_info().rss / _MIB)
        if plan.removal_s and now - removed >= plan.removal_s:
            nodes.remove(dice)
            nodes.add()
            report.nodes_removed += 1
            removed = time.monotonic()
        if plan.kill_s and now - killed >= pause_s:
            report.workers_killed += nodes.kill_worker(dice)
            killed, pause_s = now, dice.expovariate(1 / plan.kill_s)
        time.sleep(0.5)
    for seen in sizes:
        # A process that has ended has no memory any more.
        alive = [size for size in seen if size > 1.0]
        report.memory_mib.append((round(alive[len(alive) // 4], 1), round(max(alive[-4:]), 1)))


def _compare(runs: Path, report: Report) -> None:
    expected, found = timeless(runs / _QUIET), timeless(runs / _SOAK)
    report.records = len(found)
    report.unequal = sorted(
        name for name in expected.keys() | found.keys() if expected.get(name) != found.get(name)
    )
    attempts = (runs / _SOAK).glob("*/*/.attempt-*")
    doubled = (
        cell for cell in (runs / _SOAK).glob("*/*") if len(list(cell.glob("results-*"))) != 1
    )
    half = (path for path in (runs / _SOAK).rglob("*.part*") if path.name.startswith("."))
    report.left_over = sorted(str(path.relative_to(runs)) for path in (*attempts, *doubled, *half))


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    for name, value in asdict(Plan()).items():
        option = "--" + name.replace("_", "-")
        parser.add_argument(option, type=type(value), default=value, metavar="N")
    parser.add_argument("--folder", type=Path, help="an empty folder that stays")
    given = vars(parser.parse_args())
    folder = given.pop("folder")
    with tempfile.TemporaryDirectory(prefix="harness-soak-") as temporary:
        report = soak(Plan(**given), folder or Path(temporary, "soak"))
    print(json.dumps({"good": report.is_good, **asdict(report)}, indent=2))
    return 0 if report.is_good else 1


if __name__ == "__main__":
    sys.exit(main())

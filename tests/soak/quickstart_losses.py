"""Ten nodes are lost at random moments of a real quickstart on Ray: are the numbers those of here?

    harness quickstart --all                            # in a workspace, on this machine
    python tests/soak/quickstart_losses.py --reference FOLDER --folder EMPTY

The request is the quickstart's: its subjects, its recipe and its methods, as the records of the
reference have them. Generated subjects are copied from there; photos (not with ``--photos 0``),
body fits and meshes are made anew by two simulated Ray nodes of one core each. A node is cut off at
random moments and another one is started. The report compares each number of each record, and the
hashes of meshes.
"""

from __future__ import annotations

import contextlib
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from plan_options import plan_parser
from ray_nodes import Nodes, environment
from same_records import left_over, numbers, timeless

_HERE = Path(__file__).resolve().parent
_RUN, _DATASET, _RECIPE = "quickstart", "avatars-tiny", "quick8"


@dataclass(frozen=True)
class Plan:
    """What is done.

    Attributes:
        losses: How many nodes are lost.
        pause_s: Mean time between two losses.
        limit_s: Longest time for all.
        seed: Of the moments.
        methods: Some of the quickstart's, with commas between them; empty takes all.
        photos: Whether photos are made anew, 1 or 0; else those of the reference are copied.
    """

    losses: int = 10
    pause_s: float = 60.0
    limit_s: float = 3600.0
    seed: int = 7
    methods: str = ""
    photos: int = 1

    def chosen(self, records: dict[str, Any]) -> dict[str, Any]:
        """The records of the methods that were chosen."""
        wanted = set(filter(None, self.methods.split(",")))
        return {
            cell: record
            for cell, record in records.items()
            if not wanted or cell.split("/")[0] in wanted
        }


@dataclass
class Report:
    """What came of it.

    Attributes:
        cells: Cells of the reference.
        wall_s: Time of the run on Ray.
        exit_code: Of the command; below zero if it was still at work at the limit.
        lost_at_s: When nodes were lost, after the start of the command.
        given_up: Nodes that Ray gave up by itself, because they did not answer in time.
        records: Records that are there.
        numbers: How many numbers were compared.
        unequal: Cells with at least one number that differs, and the largest relative difference.
        largest: By the name of a number, the largest relative difference where there is one.
        meshes: Cells whose mesh is the same to the byte.
        otherwise: Fields of records that differ beside the numbers, and in how many records.
        left_over: Attempts and half-written files that stayed.
    """

    cells: int
    wall_s: float = 0.0
    exit_code: int = 0
    lost_at_s: list[float] = field(default_factory=list)
    given_up: int = 0
    records: int = 0
    numbers: int = 0
    unequal: dict[str, float] = field(default_factory=dict)
    largest: dict[str, float] = field(default_factory=dict)
    meshes: int = 0
    otherwise: dict[str, int] = field(default_factory=dict)
    left_over: list[str] = field(default_factory=list)

    @property
    def is_good(self) -> bool:
        """Whether each record is there once, with the reference's numbers."""
        there = self.records == self.cells and self.exit_code == 0
        return there and not self.unequal and not self.left_over

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values."""
        return {"good": self.is_good, **asdict(self)}


def carry_out(plan: Plan, reference: Path, folder: Path) -> Report:
    """The reference's request once more, on nodes that are lost.

    Args:
        plan: What is done.
        reference: A workspace with a finished quickstart.
        folder: Becomes the workspace of this run.
    """
    expected = plan.chosen(timeless(reference / "runs" / _RUN))
    report = Report(len(expected))
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copytree(reference / "data", folder / "data")
    if not plan.photos:
        without = shutil.ignore_patterns(".shared")
        shutil.copytree(reference / "captures", folder / "captures", ignore=without)
    methods = dict.fromkeys(cell.split("/")[0] for cell in expected)
    values = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(
            filter(None, [os.environ.get("PYTHONPATH", ""), str(_HERE.parents[1])])
        ),
        "HOME": str(folder / "home"),
        "HARNESS_WORKSPACE": str(folder),
        "RAY_USAGE_STATS_ENABLED": "0",
        # Else Ray's own processes, of which each new node starts some, go before the work.
        "RAY_worker_niceness": "0",
    }
    (folder / "home").mkdir()
    with environment(values), contextlib.closing(Nodes(2, unheard=10)) as nodes:
        command = [
            *(sys.executable, "-m", "harness.cli.main", "eval", "--dataset", _DATASET),
            *("--recipe", _RECIPE, "--run", _RUN, "--method", ",".join(methods)),
            *("--executor", "ray", "--ray-address", nodes.address),
        ]
        _disturbed(plan, nodes, command, folder, report)
    run = folder / "runs" / _RUN
    compare(expected, timeless(run), report)
    report.left_over = left_over(run)
    return report


def _disturbed(plan: Plan, nodes: Nodes, command: list[str], folder: Path, report: Report) -> None:
    """Carry the command out and lose nodes until there were enough."""
    dice, begun = random.Random(plan.seed), time.monotonic()
    with (folder / "command.log").open("wb") as log:
        process = subprocess.Popen(command, cwd=folder, stdout=log, stderr=subprocess.STDOUT)
    following = dice.uniform(0, 2 * plan.pause_s)
    try:
        while process.poll() is None:
            now = time.monotonic() - begun
            if now > plan.limit_s:
                break
            if now >= following and len(report.lost_at_s) < plan.losses:
                nodes.remove(dice)
                report.lost_at_s.append(round(now, 1))
                nodes.add()
                following = time.monotonic() - begun + dice.uniform(0, 2 * plan.pause_s)
            report.given_up += nodes.replace_given_up()
            time.sleep(0.25)
    finally:
        process.kill()
        report.exit_code = process.wait()
        report.wall_s = round(time.monotonic() - begun, 1)


def compare(expected: dict[str, Any], found: dict[str, Any], report: Report) -> None:
    """Report what is not the same in records, as ``timeless`` gives them."""
    report.records = len(found)
    for cell, one in expected.items():
        if cell not in found:
            report.unequal[cell] = float("inf")
            continue
        other = found[cell]
        _compare_numbers(cell, numbers(one), numbers(other), report)
        report.meshes += one["files"].get("mesh.ply") == other["files"].get("mesh.ply")
        for name in one.keys() | other.keys():
            if one.get(name) != other.get(name):
                report.otherwise[name] = report.otherwise.get(name, 0) + 1


def _compare_numbers(
    cell: str, one: dict[str, float], other: dict[str, float], report: Report
) -> None:
    report.numbers += len(one)
    for name in one.keys() | other.keys():
        a, b = one.get(name), other.get(name)
        if a == b:
            continue
        relative = float("inf")
        if a is not None and b is not None:
            relative = abs(a - b) / max(abs(a), abs(b))
        report.unequal[cell] = max(relative, report.unequal.get(cell, 0.0))
        report.largest[name] = max(relative, report.largest.get(name, 0.0))


def main() -> int:
    """The command line."""
    parser = plan_parser(__doc__, Plan())
    parser.add_argument("--reference", type=Path, required=True, help="a finished quickstart")
    parser.add_argument("--folder", type=Path, help="an empty folder that stays")
    given = vars(parser.parse_args())
    reference, folder = given.pop("reference").resolve(), given.pop("folder")
    with tempfile.TemporaryDirectory(prefix="harness-losses-") as temporary:
        place = (folder or Path(temporary, "losses")).resolve()
        report = carry_out(Plan(**given), reference, place)
    print(json.dumps(report.to_dict(), indent=2))
    return 0 if report.is_good else 1


if __name__ == "__main__":
    sys.exit(main())

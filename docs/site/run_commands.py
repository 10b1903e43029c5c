"""Run what the pages show: ``python docs/site/run_commands.py SCRATCH --quickstart FOLDER``.

The commands run one after the other in a copy of the last commit, which holds a finished quickstart
as well. What ended as its page says goes into ``commands.json``; nothing else is written there.
What is there already for the same command is not run again, unless ``--again`` asks for it.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Collection, Iterator
from datetime import UTC, datetime
from pathlib import Path

import harness
from shown_commands import Plan, Ran, load_plan, load_ran, shown_commands, write_ran

ROOT = Path(__file__).parents[2]
#: What a quickstart leaves in its workspace.
_MADE = ("data", "captures", "runs")
#: File of the scratch folder that names the commit in it.
_COMMIT = ".commit"


def prepare(scratch: Path, quickstart: Path) -> None:
    """Copy the last commit, and what a quickstart made, into a new folder."""
    if scratch.exists():
        return
    scratch.mkdir(parents=True)
    archive = subprocess.run(
        ["git", "archive", "HEAD"], cwd=ROOT, check=True, stdout=subprocess.PIPE
    )
    subprocess.run(["tar", "-x"], cwd=scratch, input=archive.stdout, check=True)
    (scratch / _COMMIT).write_text(commit(), encoding="utf-8")
    for name in _MADE:
        shutil.copytree(quickstart / name, scratch / name)
    # Commands that name no run mean this one.
    shutil.copytree(scratch / "runs" / "quickstart", scratch / "runs" / "main")


def chosen(plan: Plan, ways: Collection[str], only: str, again: bool) -> Iterator[tuple[str, str]]:
    """The shown commands that have to be run, and what is run for each."""
    done = load_ran()
    for shown, files in shown_commands(ROOT).items():
        line = plan.line(shown)
        is_known = shown in done and done[shown].ran == line
        is_wanted = (
            plan.trial(shown).how in ways and re.search(only, f"{files} {shown}") is not None
        )
        if is_wanted and (again or not is_known):
            yield shown, line


def run(line: str, scratch: Path, limit_s: float) -> tuple[int, float]:
    """The exit code of a line of shell, 124 where it took too long, and its seconds."""
    environment = {
        name: value for name, value in os.environ.items() if name != "HARNESS_WORKSPACE"
    } | {
        "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
        "PYTHONPATH": str(scratch),
        "HARNESS_PARTS": str(scratch / ".parts"),
    }
    start = time.perf_counter()
    try:
        code = subprocess.run(
            ["timeout", str(limit_s), "bash", "-euo", "pipefail", "-c", line],
            cwd=scratch,
            env=environment,
            stdin=subprocess.DEVNULL,
            check=False,
        ).returncode
    except KeyboardInterrupt:
        sys.exit(130)
    return code, time.perf_counter() - start


def commit() -> str:
    """The last commit's short name."""
    return subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"],
        cwd=ROOT,
        check=True,
        capture_output=True,
        text=True,
    ).stdout.strip()


def main() -> int:
    """Run from the command line; 1 where a command did not end as its page says."""
    parser = argparse.ArgumentParser(description="Run the commands that the pages show.")
    parser.add_argument("scratch", type=Path, help="folder to run them in; made if it is new")
    parser.add_argument("--quickstart", type=Path, default=ROOT, help="workspace of a quickstart")
    parser.add_argument("--only", default="", help="pattern in a page's file and a command")
    parser.add_argument("--again", action="store_true", help="also what was run before")
    parser.add_argument("--due", action="store_true", help="only those that are marked as due")
    parser.add_argument("--list", action="store_true", help="only say what would be run")
    parser.add_argument("--limit", type=float, default=600, help="seconds for one command")
    options = parser.parse_args()
    plan = load_plan()
    scratch = options.scratch.resolve()
    if not options.list:
        prepare(scratch, options.quickstart)
    failed: list[str] = []
    ways = ("due",) if options.due else ("run",)
    for shown, line in chosen(plan, ways, options.only, options.again):
        print(f"\n$ {line}", flush=True)
        if options.list:
            continue
        if "--reason" in line:
            # Sealed data are looked at once, and not to try a page's command.
            failed.append(f"needs an entry in commands.toml, as it looks at sealed data: {shown}")
            continue
        if (ready := plan.prepare.get(shown)) and run(ready, scratch, options.limit)[0]:
            failed.append(f"what comes before: {shown}")
            continue
        code, seconds = run(line, scratch, options.limit)
        if code != plan.trial(shown).exit_code:
            failed.append(f"{code}: {shown}")
            continue
        name = (scratch / _COMMIT).read_text(encoding="utf-8")
        today = datetime.now(UTC).date().isoformat()
        ran = Ran(plan.line(shown), code, round(seconds, 1), today, harness.__version__, name)
        write_ran({**load_ran(), shown: ran})
    print("\n".join(["", *failed]), file=sys.stderr)
    return bool(failed)


if __name__ == "__main__":
    sys.exit(main())

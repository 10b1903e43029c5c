"""Whether two runs have the same records, and whether one of them left anything behind."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

#: Fields of a record whose leaves are its results.
_RESULTS = ("metrics", "regions", "normal_maps", "diagnostics")


def timeless(run: Path) -> dict[str, Any]:
    """A run's records by method and subject, without what differs between any two runs."""
    found: dict[str, Any] = {}
    for path in sorted(run.glob("*/*/record.json")):
        record = json.loads(path.read_text())
        for name in ("created_utc", "digest"):  # the digest is over the date, too
            record.pop(name)
        record["details"].pop("machine")
        # Which code made it counts in its key; a commit of something else may come meanwhile.
        for name in ("commit", "dirty"):
            record.get("environment", {}).pop(name, None)
        for stage in record["stages"]:
            for name in ("wall_s", "peak_rss_mib", "peak_gpu_mib"):
                stage.pop(name)
        found[f"{path.parent.parent.name}/{path.parent.name}"] = record
    return found


def unequal(expected: Path, found: Path) -> list[str]:
    """Cells whose record is in one run alone, or differs."""
    one, other = timeless(expected), timeless(found)
    return sorted(cell for cell in one.keys() | other.keys() if one.get(cell) != other.get(cell))


def numbers(record: dict[str, Any]) -> dict[str, float]:
    """The results of a record by dotted name; what has no value is left out."""
    found: dict[str, float] = {}
    waiting: list[tuple[str, Any]] = [(name, record.get(name, {})) for name in _RESULTS]
    while waiting:
        name, value = waiting.pop()
        if isinstance(value, dict):
            waiting += [(f"{name}.{part}", each) for part, each in value.items()]
        elif isinstance(value, list):
            waiting += [(f"{name}.{place}", each) for place, each in enumerate(value)]
        elif isinstance(value, (int, float)):
            found[name] = float(value)
    return found


def left_over(run: Path) -> list[str]:
    """Attempts, half-written files, and cells with more or less than one folder of results."""
    attempts = run.glob("*/*/.attempt-*")
    doubled = (cell for cell in run.glob("*/*") if len(list(cell.glob("results-*"))) != 1)
    half = (path for path in run.rglob("*.part*") if path.name.startswith("."))
    return sorted(str(path.relative_to(run.parent)) for path in (*attempts, *doubled, *half))

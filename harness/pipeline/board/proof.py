"""What a record says against what its mesh shows: numbers, regions, and when it was made."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict
from datetime import UTC, datetime, timedelta

from harness.core.records import Record
from harness.core.results import MetricValue, RegionErrors, Scores

#: The same mesh gives the same numbers; machines differ by their last digits.
_RELATIVE, _ABSOLUTE = 1e-4, 1e-3
#: A point between two regions may fall into either.
_OF_REGIONS, _LEAST_OF_REGIONS = 1e-2, 0.02
_LEAST_POINTS = 3
#: Clocks of machines differ by less.
_CLOCKS = timedelta(days=1)


def differences(record: Record, found: Scores) -> Iterator[str]:
    """What a record says otherwise than its mesh shows, each as a sentence without a full stop."""
    for name, value in found.metrics.items():
        yield from _of_metric(name, record.metrics.get(name), value)
    for name in {**record.regions, **found.regions}:
        if name not in found.regions:
            yield f"errors of a region '{name}', which the scan does not have"
        elif name not in record.regions:
            yield f"no errors of the region '{name}', which its mesh has"
        else:
            yield from _of_region(name, record.regions[name], found.regions[name])


def _of_metric(name: str, claimed: MetricValue | None, value: MetricValue) -> Iterator[str]:
    if claimed is None:
        yield f"no {name}, which its mesh has: {value.value:.4f} {value.unit}"
    elif claimed.unit != value.unit or not _same(claimed.value, value.value):
        said = f"{claimed.value:.4f} {claimed.unit}"
        yield f"{name} is {said} in the record, but {value.value:.4f} {value.unit} of the mesh"
    elif not _same(claimed.floor, value.floor):
        said = f"{claimed.floor:.4f}, but {value.floor:.4f} {value.unit}"
        yield f"the floor of {name} is {said} of the scan"


def _of_region(name: str, claimed: RegionErrors, found: RegionErrors) -> Iterator[str]:
    said = asdict(claimed)
    for field, value in asdict(found).items():
        if not _alike(field, said[field], value):
            yield f"{field} of the region '{name}' is {said[field]}, but {value} of the mesh"


def _alike(field: str, claimed: float | None, found: float | None) -> bool:
    if claimed is None or found is None:
        return claimed is found
    least = _LEAST_POINTS if field.startswith("n_") else _LEAST_OF_REGIONS
    return math.isclose(claimed, found, rel_tol=_OF_REGIONS, abs_tol=least)


def _same(claimed: float, found: float) -> bool:
    return math.isclose(claimed, found, rel_tol=_RELATIVE, abs_tol=_ABSOLUTE)


def date_faults(record: Record, now: datetime | None = None) -> Iterator[str]:
    """What is wrong with the time at which a record says that it was made.

    Args:
        record: Its time orders the versions of a method.
        now: The time that it is compared with; by default the clock's.
    """
    try:
        made = datetime.fromisoformat(record.created_utc)
        ahead = made - (now or datetime.now(UTC)) > _CLOCKS
    except (TypeError, ValueError):
        yield f"made at '{record.created_utc}', which is no time such as 2026-01-31T12:00:00+00:00"
        return
    if ahead:
        yield f"made at {record.created_utc}, which is yet to come"
    elif made.utcoffset() != timedelta(0):
        yield f"made at {record.created_utc}, which is not in UTC"

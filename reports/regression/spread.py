"""Tolerances of a baseline that are measured: how far other runs on the same photos are from it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from harness.core.errors import ProtocolMismatch
from harness.core.records import Record
from reports.regression.baseline import Baseline, Entry, Tolerance, default_tolerance, numbers_of
from reports.regression.compare import check_settings

#: How many times the largest difference between runs a number may move.
_SPREADS = 3.0


def with_spread(baseline: Baseline, runs: Mapping[str, Sequence[Record]]) -> Baseline:
    """The baseline with tolerances from how far other runs of the same cells are from it.

    The runs differ in arithmetic alone: in the processor, or in how many threads there were. A
    method's tolerance for a metric becomes three times the largest difference over its subjects
    and over the runs, but not less than the default; it says so as its source. One that the
    baseline has already, from earlier runs, stays where it is wider.

    Args:
        baseline: Whose numbers stay.
        runs: Records of the same cells, by the run's name.

    Raises:
        HarnessError: a run without records.
        ProtocolMismatch: a run of another dataset, recipe or protocol than the baseline's, or on
            other photos: their grain is no noise of the machine.
    """
    entries = baseline.entries
    largest: dict[str, tuple[float, str]] = {}
    for run, records in runs.items():
        check_settings(records, baseline, f"the records of run {run}")
        for record in records:
            entry = entries.get((record.method_name, record.subject))
            for name, number in numbers_of(record).items():
                if entry is None or name not in entry.metrics:
                    continue
                _check_photos(run, record, entry)
                path = f"{record.method_name}/{name}"
                apart = abs(number.value - entry.metrics[name].value)
                largest[path] = max(largest.get(path, (0.0, "")), (apart, number.unit))
    tolerances = dict(baseline.tolerances)
    for path, (apart, unit) in largest.items():
        default = tolerances.get(path.partition("/")[2]) or default_tolerance(path, unit)
        least = max(default.absolute, tolerances.get(path, default).absolute)
        if _SPREADS * apart > least:
            source = f"three times the largest difference of the runs {', '.join(runs)}"
            absolute = float(f"{_SPREADS * apart:.3g}")
            tolerances[path] = Tolerance(absolute, default.relative, unit, source)
    return replace(baseline, tolerances=tolerances)


def _check_photos(run: str, record: Record, entry: Entry) -> None:
    photos = entry.inputs.get("capture")
    if photos != record.capture.key:
        raise ProtocolMismatch(
            f"run {run} does not tell the spread of {record.subject}: it has other photos",
            expected=f"the baseline's, {photos}",
            got=record.capture.key,
            hint="Evaluate the same captures with other arithmetic, such as OMP_NUM_THREADS=1",
        )

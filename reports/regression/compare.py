"""``harness check``: which numbers moved since the baseline, and what else changed with them."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from harness.core.errors import ProtocolMismatch
from harness.core.records import Record
from reports.regression.baseline import (
    Baseline,
    Entry,
    Tolerance,
    Value,
    common_settings,
    default_tolerance,
    inputs_of,
    numbers_of,
)

_KEY_DIGITS = 8
_VALUE_LENGTH = 48


@dataclass(frozen=True, slots=True)
class Moved:
    """A number further from its baseline than its tolerance."""

    method: str
    subject: str
    metric: str
    unit: str
    before: float
    after: float
    allowed: float

    @property
    def change(self) -> float:
        """Signed change, in ``unit``; positive is worse."""
        return self.after - self.before


@dataclass(frozen=True, slots=True)
class Missing:
    """A number of the baseline that there is no longer, or all of a cell, and why."""

    method: str
    subject: str
    metric: str
    reason: str


@dataclass(frozen=True, slots=True)
class Changed:
    """A cell with another key or other packages than in the baseline, whether or not it moved."""

    method: str
    subject: str
    before: str
    after: str
    inputs: Mapping[str, tuple[str, str]]


@dataclass(frozen=True, slots=True)
class Comparison:
    """What became of every number of a baseline.

    Attributes:
        moved, missing: Failures.
        unlisted: Methods that the baseline neither has numbers of nor lists as new: failures, too.
        checked: Cells of the baseline whose numbers were compared, as (method, subject).
        unchecked: Cells that the run was not asked to have, and does not have.
        new: Numbers that the baseline does not have, as (method, subject, metric).
        unchanged: How many numbers are within their tolerance.
        changed: Cells whose inputs are not those of the baseline.
    """

    moved: tuple[Moved, ...] = ()
    missing: tuple[Missing, ...] = ()
    unlisted: tuple[str, ...] = ()
    checked: tuple[tuple[str, str], ...] = ()
    unchecked: tuple[tuple[str, str], ...] = ()
    new: tuple[tuple[str, str, str], ...] = ()
    unchanged: int = 0
    changed: tuple[Changed, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether nothing moved, nothing is missing, and no method is unguarded."""
        return not (self.moved or self.missing or self.unlisted)


def compare(records: Sequence[Record], baseline: Baseline, *, every: bool = True) -> Comparison:
    """Each number of the records against the baseline's.

    A number moved when it differs by more than ``absolute + relative * |baseline|``. A cell of the
    baseline that has no record, or a record without its numbers, is missing. A method without
    numbers in the baseline is unlisted, unless the baseline names it as new on purpose. A number
    that only the records of a guarded method have is new, which is no failure.

    Args:
        records: Of one run.
        baseline: What they are compared with.
        every: Whether the run must have all cells of the baseline, or is compared in those that it
            has.

    Raises:
        HarnessError: no records.
        ProtocolMismatch: another dataset, recipe, protocol or unit than the baseline's.
        DataError: the baseline has no tolerance for one of its metrics.
    """
    check_settings(records, baseline)
    present = {(record.method_name, record.subject): record for record in records}
    entries = baseline.entries
    checked = sorted(cell for cell in entries if every or cell in present)
    found = [
        finding
        for cell in checked
        for finding in _compared(entries[cell], present.get(cell), baseline)
    ]
    return Comparison(
        unlisted=_unlisted(records, baseline),
        checked=tuple(checked),
        unchecked=tuple(sorted({*entries} - {*checked})),
        moved=tuple(each for each in found if isinstance(each, Moved)),
        missing=tuple(each for each in found if isinstance(each, Missing)),
        new=tuple(
            (*cell, metric)
            for cell, record in sorted(present.items())
            for metric in numbers_of(record)
            if cell not in entries or metric not in entries[cell].metrics
        ),
        unchanged=found.count(None),
        changed=tuple(each for each in found if isinstance(each, Changed)),
    )


def _unlisted(records: Sequence[Record], baseline: Baseline) -> tuple[str, ...]:
    """Methods that nothing of the baseline guards.

    One that had no numbers when the baseline was written is known to have none, and guarded as long
    as it has none.
    """
    without = {method for method, _ in baseline.entries}
    guarded = {method for (method, _), entry in baseline.entries.items() if entry.metrics}
    guarded |= {*baseline.new_methods}
    return tuple(
        sorted(
            {
                record.method_name
                for record in records
                if record.method_name not in guarded
                and (numbers_of(record) or record.method_name not in without)
            }
        )
    )


def check_settings(records: Sequence[Record], baseline: Baseline, of: str = "the records") -> None:
    """Whether the records were made as the baseline's were: else it raises.

    Args:
        records: What is to be compared.
        baseline: What with.
        of: What they are called in an error.

    Raises:
        HarnessError: no records.
        ProtocolMismatch: another dataset, recipe or protocol than the baseline's.
    """
    dataset, recipe, protocol = common_settings(records)
    for what, expected, got in (
        ("dataset", baseline.dataset, dataset),
        ("recipe", baseline.recipe, recipe),
        ("protocol", baseline.protocol, protocol),
    ):
        if expected != got:
            raise ProtocolMismatch(
                f"{of} cannot be compared with the baseline: their {what} differs",
                expected=str(expected),
                got=str(got),
                hint="Evaluate as the baseline was, or write a new one with --update",
            )


def _compared(
    entry: Entry, record: Record | None, baseline: Baseline
) -> Iterator[Moved | Missing | Changed | None]:
    """What became of a cell and of each of its numbers; None for one that did not move."""
    cell = entry.method, entry.subject
    if record is None or (entry.metrics and record.status != "ok"):
        yield Missing(*cell, "all", _absence(record))
        return
    now, numbers = inputs_of(record), numbers_of(record)
    inputs = {
        name: (entry.inputs.get(name, "none"), now.get(name, "none"))
        for name in sorted({*entry.inputs, *now})
        if entry.inputs.get(name) != now.get(name)
    }
    if inputs or entry.key != record.key:
        yield Changed(*cell, entry.key, record.key, inputs)
    for metric, before in entry.metrics.items():
        if metric not in numbers:
            yield Missing(*cell, metric, "no longer measured")
            continue
        after, tolerance = numbers[metric], baseline.tolerance(record.method_name, metric)
        _check_units(metric, before, after, tolerance)
        allowed = tolerance.allowed(before.value)
        if abs(after.value - before.value) <= allowed:  # false for NaN, which thus counts as moved
            yield None
        else:
            yield Moved(*cell, metric, before.unit, before.value, after.value, allowed)


def _absence(record: Record | None) -> str:
    if record is None:
        return "no record"
    return f"{record.status}: {record.reason_line}"


def _check_units(metric: str, before: Value, after: Value, tolerance: Tolerance) -> None:
    if not before.unit == after.unit == tolerance.unit:
        raise ProtocolMismatch(
            f"{metric} is in another unit than its baseline or tolerance",
            expected=f"{before.unit} (tolerance in {tolerance.unit})",
            got=after.unit,
            hint="Write the baseline again with --update",
        )


def to_text(comparison: Comparison) -> str:
    """The comparison for a terminal: what moved, is missing or else changed, and the verdict."""
    blocks = [_aligned(rows) for rows in _tables(comparison).values()]
    return "\n\n".join([*blocks, _verdict(comparison)]) + "\n"


def to_markdown(comparison: Comparison) -> str:
    """The comparison for the summary page of a CI job."""
    parts = ["## Metric regression", "", f"{_verdict(comparison)}"]
    for title, rows in _tables(comparison).items():
        grid = [rows[0], ["---"] * len(rows[0]), *rows[1:]]
        lines = (f"| {' | '.join(cell.replace('|', '∣') for cell in row)} |" for row in grid)
        parts += ["", f"### {title}", "", *lines]
    return "\n".join(parts) + "\n"


def _verdict(comparison: Comparison) -> str:
    counts = (
        f"{len(comparison.moved)} moved, {len(comparison.missing)} missing, "
        f"{len(comparison.new)} new, {comparison.unchanged} unchanged; "
        f"inputs differ in {len(comparison.changed)} cells"
    )
    if comparison.unlisted:
        counts = f"{counts}; no numbers in the baseline: {', '.join(comparison.unlisted)}"
    cells = f"checked: {_by_method(comparison.checked, comparison.unchecked)}"
    if comparison.unchecked:
        left_out = _by_method(comparison.unchecked, comparison.checked)
        cells += f"; not in the run: {left_out} (--all asks for them)"
    return f"{'passed' if comparison.passed else 'FAILED'}: {counts}\n{cells}"


def _by_method(cells: Sequence[tuple[str, str]], others: Sequence[tuple[str, str]]) -> str:
    """Names of methods; those that have others, too, with their subjects."""
    split = {method for method, _ in others}
    subjects: dict[str, list[str]] = {}
    for method, subject in cells:
        subjects.setdefault(method, []).append(subject)
    return (
        ", ".join(
            f"{method} on {' and '.join(own)}" if method in split else method
            for method, own in subjects.items()
        )
        or "none"
    )


_GUARD = "write its numbers with --update, or name it under 'new_methods' with the reason"


def _tables(comparison: Comparison) -> dict[str, list[list[str]]]:
    """Rows with a header by title; none for what did not happen."""
    moved = [
        [m.method, m.subject, m.metric, *numbers.split(), m.unit]
        for m in comparison.moved
        for numbers in (f"{m.before:.3f} {m.after:.3f} {m.change:+.3f} {m.allowed:.3f}",)
    ]
    changed = [
        [cell.method, cell.subject, keys, name, _cut(before), _cut(after)]
        for cell in comparison.changed
        for keys in (f"{cell.before[:_KEY_DIGITS]} → {cell.after[:_KEY_DIGITS]}",)
        for name, (before, after) in (cell.inputs or {"(key only)": ("", "")}).items()
    ]
    tables = {
        "Moved": ("method,subject,metric,baseline,now,change,allowed,unit", moved),
        "Missing": (
            "method,subject,metric,why missing",
            [[m.method, m.subject, m.metric, m.reason] for m in comparison.missing],
        ),
        "Without numbers in the baseline": (
            "method,next step",
            [[method, _GUARD] for method in comparison.unlisted],
        ),
        "Inputs that differ": ("method,subject,key,input,baseline,now", changed),
    }
    return {title: [head.split(","), *rows] for title, (head, rows) in tables.items() if rows}


def _cut(text: str) -> str:
    return text if len(text) <= _VALUE_LENGTH else f"{text[: _VALUE_LENGTH - 1]}…"


def _aligned(rows: list[list[str]]) -> str:
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    )


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

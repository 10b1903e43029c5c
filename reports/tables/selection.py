"""Which records may stand in one table, and what a reader must know about each method.

Records of different datasets, recipes, captures or metric protocols never meet; neither do two
versions of one method. A subject that failed or was never run keeps its place in the count.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from harness.core.errors import HarnessError, ProtocolMismatch
from harness.core.files.hashing import canonical_json
from harness.core.files.names import suffix_of
from harness.core.protocols import MethodInfo, Privilege
from harness.core.records import ProtocolStamp, Record
from reports.tables.table import Cell, Column, Interval, Row, Table

if TYPE_CHECKING:
    import pandas as pd


_SHOWN_SUBJECTS = 8
_REASON_LENGTH = 120
#: A method that is given one of these hands the answer back: a test of the ruler, not a rival.
_ANSWERS = frozenset({Privilege.GROUND_TRUTH_MESH})
_SCAN_UNITS = (
    "Scans keep their own units, origin and heights (scale rule 'units'): mm are thousandths of a "
    "scan unit, and lengths in m are scan units"
)
#: The same for one row, because a line of CSV has no caption.
_SCAN_UNITS_ROW = "mm: thousandths of a scan unit"


@dataclass(frozen=True, slots=True)
class Group:
    """The records of one method.

    Attributes:
        method: Name on the command line.
        title: Name for people.
        ok: Records with numbers, by subject.
        notes: Parts, privileges and what is not in the numbers, as sentences without a full stop.
        privileges: What the method was given beyond pixels and masks.
        competes: Whether it may be ranked with others.
    """

    method: str
    title: str
    ok: tuple[Record, ...]
    notes: tuple[str, ...]
    privileges: tuple[Privilege, ...]
    competes: bool

    @property
    def by_subject(self) -> dict[str, Record]:
        """The records with numbers by subject."""
        return {record.subject: record for record in self.ok}

    def row(self, of: int, cells: Mapping[str, Cell]) -> Row:
        """The method's row of a table over ``of`` subjects."""
        return Row(
            method=self.method,
            title=self.title,
            n=len(self.ok),
            of=of,
            cells=cells,
            notes=self.notes,
            privileges=self.privileges,
            competes=self.competes,
        )


@dataclass(frozen=True, slots=True)
class Selection:
    """Comparable records, by method, with what they have in common."""

    dataset: str
    recipe: str
    protocol: ProtocolStamp
    subjects: tuple[str, ...]
    groups: tuple[Group, ...]
    remarks: tuple[str, ...]

    def table(
        self, name: str, title: str, columns: Iterable[Column], rows: Iterable[Row], **more: Any
    ) -> Table:
        """A table of these records; ``more`` are other attributes of ``Table``."""
        given = {"dataset": self.dataset, "recipe": self.recipe, "protocol": self.protocol, **more}
        return Table(name=name, title=title, columns=tuple(columns), rows=tuple(rows), **given)

    def shown(self, has: Callable[[Record], object]) -> tuple[Group, ...]:
        """The methods whose records all have something."""
        return tuple(group for group in self.groups if all(map(has, group.ok)))

    def absence(self, shown: Sequence[Group], has: Callable[[Record], object], what: str) -> str:
        """Which methods are not shown, with how many of their records lack something.

        Args:
            shown: The others.
            has: Whether a record has it.
            what: What is lacking and why, before the methods' titles.
        """
        names = [
            f"{group.title} ({sum(not has(record) for record in group.ok)} of {len(group.ok)} "
            "records)"
            for group in self.groups
            if group not in shown
        ]
        return f"Without {what}: {'; '.join(names)}" if names else ""


@dataclass(frozen=True, slots=True)
class Asked:
    """What a table is asked for.

    Attributes:
        methods, subjects: As of ``select``.
        interval: Makes a confidence interval of a mean from the subjects' values.
        published: Whether the paper's printed numbers stand below, as a block of their own; where
            it prints none, the table says so.
    """

    methods: Sequence[str] | None = None
    subjects: Sequence[str] | None = None
    interval: Interval | None = None
    published: bool = False


EVERYTHING = Asked()


def select(
    records: Sequence[Record],
    methods: Sequence[str] | None = None,
    subjects: Sequence[str] | None = None,
) -> Selection:
    """The records that a table is made of, checked and grouped.

    Args:
        records: Records of one run.
        methods: Rows wanted, in this order; by default all, in the order of their first record.
        subjects: Subjects that count; by default all of the dataset that any method, wanted or not,
            has a record of.

    Raises:
        HarnessError: no records, or two for one method and subject.
        ProtocolMismatch: records that are not comparable, naming two of them.
    """
    order = list(dict.fromkeys(methods or (record.method_name for record in records)))
    chosen = [
        record
        for record in records
        if record.method_name in order and (subjects is None or record.subject in subjects)
    ]
    if not chosen:
        known = ", ".join(dict.fromkeys(record.method_name for record in records))
        of = f" on {', '.join(subjects)}" if subjects else ""
        raise HarnessError(
            f"there are no records of {', '.join(order) or 'any method'}{of} to report",
            hint=f"This run has records of {known}" if known else "Run 'harness eval' first",
        )
    check_comparable(chosen)
    first = chosen[0]
    wanted = list(dict.fromkeys(subjects or ())) or sorted(
        {r.subject for r in records if r.dataset == first.dataset}
    )
    by_method = {name: _by_subject(chosen, name) for name in order}
    return Selection(
        dataset=first.dataset,
        recipe=next((_photos(record) for record in chosen if record.recipe), ""),
        protocol=first.protocol,
        subjects=tuple(wanted),
        groups=tuple(_group(name, by_method[name], wanted) for name in order),
        remarks=(
            *([_SCAN_UNITS] if first.length_unit != "metre" else []),
            *_remarks(chosen),
        ),
    )


def check_comparable(records: Sequence[Record]) -> None:
    """Refuse records whose numbers must not meet, in a table or elsewhere.

    Raises:
        ProtocolMismatch: another unit of length, dataset, metric protocol, recipe, or capture of
            one subject; the message names two records and what they differ in.
    """
    _check_same("unit of length", [(record.length_unit, record) for record in records])
    _check_same("dataset", [(record.dataset, record) for record in records])
    _check_same("metric protocol", [(record.protocol.text, record) for record in records])
    # A mesh made elsewhere has no photos of ours; its row says so instead.
    _check_same("recipe", [(_photos(record), record) for record in records if record.recipe])
    # Of the same photos, rows may have the cameras given and others estimated.
    for subject, recipe in {(record.subject, record.recipe) for record in records}:
        captures = [
            (record.capture.key, record)
            for record in records
            if (record.subject, record.recipe) == (subject, recipe) and record.capture.key
        ]
        _check_same(f"capture of {subject}", captures)


def _photos(record: Record) -> str:
    """The recipe, whether or not its cameras were given."""
    return record.recipe.removesuffix(suffix_of(record.recipe))


def _check_same(what: str, values: Sequence[tuple[str, Record]]) -> None:
    for value, record in values[1:]:
        expected, reference = values[0]
        if value != expected:
            raise ProtocolMismatch(
                f"these records cannot be compared: their {what} differs",
                expected=f"'{expected}' as in {_cell(reference)}",
                got=f"'{value}' in {_cell(record)}",
                hint="Keep them in separate runs, or evaluate again so that all agree",
            )


def _cell(record: Record) -> str:
    return f"{record.method_name}/{record.subject}"


def _by_subject(records: Iterable[Record], method: str) -> dict[str, Record]:
    found: dict[str, Record] = {}
    for record in records:
        if record.method_name != method:
            continue
        if record.subject in found:
            raise HarnessError(
                f"there are two records of {_cell(record)}",
                got=f"keys {found[record.subject].key} and {record.key}",
                hint="Report one run at a time",
            )
        found[record.subject] = record
    return found


def _group(name: str, records: Mapping[str, Record], subjects: Sequence[str]) -> Group:
    ok = tuple(records[s] for s in subjects if s in records and records[s].status == "ok")
    check_one_method(ok)
    described = next(iter(ok or records.values()), None)
    method = described.method if described else MethodInfo(name, name)
    given = ", ".join(privilege.label for privilege in method.privileges)
    notes = (
        f"Given: {given}" if given else "",
        _parts_note(method),
        _seen_note(method, ok),
        _SCAN_UNITS_ROW if ok and ok[0].length_unit != "metre" else "",
        "Meshes made elsewhere" if ok and not all(record.recipe for record in ok) else "",
        *_absence_notes(records, subjects),
    )
    return Group(
        method=name,
        title=method.title,
        ok=ok,
        notes=tuple(note for note in notes if note),
        privileges=method.privileges,
        competes=_ANSWERS.isdisjoint(method.privileges),
    )


def check_one_method(ok: Sequence[Record]) -> None:
    """Refuse records of one method that were made by two states of it.

    Raises:
        ProtocolMismatch: other settings or parts; the message names two records.
    """
    for record in ok[1:]:
        first, other = ok[0].method.identity(), record.method.identity()
        for field in sorted(first):
            expected, got = first[field], other[field]
            if canonical_json(expected) != canonical_json(got):
                raise ProtocolMismatch(
                    f"{_cell(ok[0])} and {_cell(record)} were made by two states of the method: "
                    f"their {field} differ",
                    expected=_short(canonical_json(expected)),
                    got=_short(canonical_json(got)),
                    hint="Evaluate the method again on all subjects",
                )


def _parts_note(method: MethodInfo) -> str:
    described = (f"{part.role} {part.name} ({part.licence})" for part in method.parts)
    return f"Parts: {', '.join(described)}" if method.parts else ""


def _seen_note(method: MethodInfo, ok: Sequence[Record]) -> str:
    """On how many subjects the person was there in training, of a method that says on whom."""
    if not method.trained_on:
        return ""
    seen = [
        record.subject
        for record in ok
        if any(
            _names(entry, person)
            for entry in method.trained_on
            for person in (f"{record.dataset}/{record.subject}", record.identity)
        )
    ]
    who = f" ({_subjects_text(seen)})" if seen else ""
    return (
        f"Trained on {_in_short(method.trained_on)}: {len(seen)} of {len(ok)} subjects were seen "
        f"in training{who}"
    )


def _names(entry: str, person: str) -> bool:
    """Whether an entry of what was trained on is a person, a dataset or a range with it."""
    home, _, name = person.rpartition("/")
    if entry in (person, home):
        return bool(entry)
    of, _, ends = entry.rpartition("/")
    first, is_range, last = ends.partition("..")
    return bool(is_range) and of == home and len(name) == len(first) and first <= name <= last


def _in_short(trained_on: Sequence[str]) -> str:
    """Each entry that is alone in its dataset, and one name for the others."""
    of_home: dict[str, list[str]] = {}
    for entry in trained_on:
        of_home.setdefault(entry.rpartition("/")[0] or entry, []).append(entry)
    return ", ".join(
        entries[0] if len(entries) == 1 else f"subjects of {home}"
        for home, entries in of_home.items()
    )


def _absence_notes(records: Mapping[str, Record], subjects: Sequence[str]) -> list[str]:
    """One sentence for each reason why subjects are not in the mean."""
    reasons: dict[str, list[str]] = {}
    for subject in subjects:
        record = records.get(subject)
        if record is None:
            reasons.setdefault("not run", []).append(subject)
        elif record.status != "ok":
            reason = f"{record.status}: {_short(record.reason_line)}"
            reasons.setdefault(reason, []).append(subject)
    return [
        f"{len(absent)} of {len(subjects)} {reason} ({_subjects_text(absent)})"
        for reason, absent in reasons.items()
    ]


def _short(text: str) -> str:
    return textwrap.shorten(text, _REASON_LENGTH, placeholder=" ...").rstrip(".")


def _subjects_text(subjects: Sequence[str]) -> str:
    """The subjects' names, cut after a few."""
    shown = ", ".join(subjects[:_SHOWN_SUBJECTS])
    more = len(subjects) - _SHOWN_SUBJECTS
    return f"{shown} and {more} more" if more > 0 else shown


def _remarks(records: Sequence[Record]) -> tuple[str, ...]:
    warned = sorted({record.subject for record in records if record.capture.warnings})
    edited = [_cell(record) for record in records if record.is_edited]
    return tuple(
        f"{what}: {_subjects_text(names)}"
        for what, names in (
            ("Captures with warnings", warned),
            ("Records that were edited, whose numbers are not those that were written", edited),
        )
        if names
    )


def frame(records: Sequence[Record]) -> pd.DataFrame:
    """One row per method and subject, one column per metric; NaN where there is no number.

    Failed and missing subjects are rows too, with their ``reason``: ``dropna`` is the reader's
    choice. ``frame.attrs["units"]`` names each column's unit. Before them stand what the numbers
    are of: ``method``, ``title``, ``subject``, ``status``, ``reason``, ``dataset``, ``recipe``,
    ``scale_rule``, ``protocol``, ``seed``; after them what they cost: ``wall_s``, ``peak_rss_mib``.

    Args:
        records: Records of one run or several; the reader decides what may be compared.
    """
    import pandas as pd

    metrics = dict.fromkeys(name for record in records for name in record.metrics)
    units = {name: value.unit for record in records for name, value in record.metrics.items()}
    rows = [
        {
            "method": record.method_name,
            "title": record.method.title,
            "subject": record.subject,
            "status": record.status,
            "reason": record.reason,
            "dataset": record.dataset,
            "recipe": record.recipe,
            "scale_rule": record.scale_rule,
            "protocol": record.protocol.name,
            "seed": record.seed,
            **{name: _value(record, name) for name in metrics},
            "wall_s": sum(stage.wall_s for stage in record.stages) if record.stages else None,
            "peak_rss_mib": max((stage.peak_rss_mib for stage in record.stages), default=None),
        }
        for record in records
    ]
    made = pd.DataFrame(rows)
    made = made.astype(dict.fromkeys([*metrics, "wall_s", "peak_rss_mib"], float) if rows else {})
    made.attrs["units"] = {**units, "wall_s": "s", "peak_rss_mib": "MiB"}
    return made


def _value(record: Record, metric: str) -> float | None:
    return record.metrics[metric].value if metric in record.metrics else None

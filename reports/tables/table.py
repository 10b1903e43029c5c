"""Tables as plain values: every decision about a table is taken here, every format only prints it.

Rounding, which cells are best, which rows carry which footnote and what the caption says are the
same in LaTeX, Markdown, CSV and JSON because they are decided once.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from statistics import fmean
from typing import Literal, TypeVar

from harness.core.protocols import Privilege
from harness.core.records import ProtocolStamp
from reports.published import PublishedBlock

T = TypeVar("T")

#: What a cell without a number shows.
DASH = "–"

#: Low and high end of a confidence interval of the mean of some values.
Interval = Callable[[Sequence[float]], tuple[float, float]]


@dataclass(frozen=True, slots=True)
class Column:
    """One quantity of a table.

    Attributes:
        id: As in records and files, such as ``chamfer``.
        title: For people, without unit.
        latex_title: The same as LaTeX source.
        unit: Symbol, such as ``mm``.
        digits: Decimals shown; cells are compared after rounding to them.
        ranked: Whether lower is better and the best is bold.
        statistic: What a cell is of its subjects' values.
    """

    id: str
    title: str
    latex_title: str
    unit: str
    digits: int
    ranked: bool = True
    statistic: Literal["mean", "max"] = "mean"

    def text(self, value: float) -> str:
        """The value as printed, without its unit."""
        return f"{value:.{self.digits}f}"


@dataclass(frozen=True, slots=True)
class Cell:
    """A number over subjects, with the interval of its mean where one was asked for.

    Attributes:
        value: What is printed.
        low, high: Ends of the interval.
        by_subject: What a mean is the mean of; a cell that can be the best has it.
    """

    value: float
    low: float | None = None
    high: float | None = None
    by_subject: Mapping[str, float] = field(default_factory=dict[str, float])


@dataclass(frozen=True, slots=True)
class Stage:
    """The cells of one stage of a method, shown below the method's own row."""

    name: str
    cells: Mapping[str, Cell]


@dataclass(frozen=True, slots=True)
class Row:
    """One method.

    Attributes:
        method: Name on the command line.
        title: Name for people.
        n: Subjects that the cells are of.
        of: Subjects asked for; the other ``of - n`` failed, are missing or have no record.
        cells: By column id; a missing column shows a dash.
        notes: What must be known to compare this row; printed as footnotes.
        privileges: What the method was given beyond pixels and masks.
        competes: Whether the row may be the best; a row that was given the answer may not.
        stages: Its parts, in order.
    """

    method: str
    title: str
    n: int
    of: int
    cells: Mapping[str, Cell]
    notes: tuple[str, ...] = ()
    privileges: tuple[Privilege, ...] = ()
    competes: bool = True
    stages: tuple[Stage, ...] = ()


@dataclass(frozen=True, slots=True)
class Table:
    """Comparable rows: one dataset, one recipe, one metric protocol.

    Attributes:
        name: As on the command line, such as ``geometry``.
        title: For people.
        dataset, recipe: What every row was measured on.
        protocol: The metric protocol; None where nothing was measured.
        columns: Left to right.
        rows: Top to bottom.
        remarks: Sentences about the whole table.
        published: Numbers printed elsewhere, shown apart and never compared with the rows.
        more: Columns for programs: in CSV and JSON, never in print.
        origin: Where the rows come from, if they were not measured here.
    """

    name: str
    title: str
    dataset: str
    recipe: str
    protocol: ProtocolStamp | None
    columns: tuple[Column, ...]
    rows: tuple[Row, ...]
    remarks: tuple[str, ...] = ()
    published: PublishedBlock | None = None
    more: tuple[Column, ...] = ()
    origin: str = ""

    @property
    def all_columns(self) -> tuple[Column, ...]:
        """Those in print, and those for programs."""
        return (*self.columns, *self.more)

    @property
    def footnotes(self) -> Mapping[str, str]:
        """Mark of each footnote's text, in the order in which the rows name them."""
        texts = dict.fromkeys(note for row in self.rows for note in row.notes)
        return {text: footnote_mark(index) for index, text in enumerate(texts)}

    def marks(self, row: Row) -> tuple[str, ...]:
        """The footnote marks of a row, in their own order."""
        return tuple(mark for text, mark in self.footnotes.items() if text in row.notes)

    @property
    def complete(self) -> bool:
        """Whether every row is of all subjects, so that no ``n/N`` column is needed."""
        return all(row.n == row.of for row in self.rows)

    def rivals(self, column: Column) -> list[Row]:
        """The rows that may be the best of a column: they compete, and have a number there."""
        return [row for row in self.rows if row.competes and column.id in row.cells]

    def common_subjects(self, column: Column) -> tuple[str, ...]:
        """The subjects that all rivals have; on these alone the best of a column is found."""
        found = [row.cells[column.id].by_subject for row in self.rivals(column)]
        return tuple(s for s in found[0] if all(s in cell for cell in found)) if found else ()

    def common_mean(self, row: Row, column: Column) -> float | None:
        """A rival's mean over the common subjects; None if it is no rival or there are none."""
        if not (column.ranked and row in self.rivals(column)):
            return None
        subjects, values = self.common_subjects(column), row.cells[column.id].by_subject
        return fmean(values[subject] for subject in subjects) if subjects else None

    def is_best(self, row: Row, column: Column) -> bool:
        """Whether the mean over the common subjects is the lowest, after rounding; ties all are."""
        mean = self.common_mean(row, column)
        if mean is None:
            return False
        means = (self.common_mean(rival, column) for rival in self.rivals(column))
        lowest = min(other for other in means if other is not None)
        return column.text(mean) == column.text(lowest)

    @property
    def uneven(self) -> tuple[Column, ...]:
        """The ranked columns whose rivals do not all have the same subjects."""
        return tuple(
            column
            for column in self.columns
            if column.ranked
            and any(
                row.cells[column.id].by_subject.keys() != set(self.common_subjects(column))
                for row in self.rivals(column)
            )
        )

    @property
    def caption(self) -> str:
        """What was measured, on what and how, in plain text."""
        sentences = self._measured
        if not self.complete:
            sentences.append("n/N: subjects in the mean of those asked for")
        if any(cell.low is not None for row in self.rows for cell in row.cells.values()):
            sentences.append("Brackets: 95 % bootstrap interval of the mean over subjects")
        if any(column.ranked for column in self.columns):
            sentences.append(f"Lower is better, best in bold{self._where_best()}")
            if not all(row.competes for row in self.rows):
                sentences.append("A row that is given the ground truth is not ranked")
        return ". ".join((*sentences, *self.remarks)) + "."

    @property
    def _measured(self) -> list[str]:
        """What the rows are of, and how they were measured or where they come from."""
        subjects = max((row.of for row in self.rows), default=0)
        measured_on = (
            f"{self.title} on {self.dataset}, {subjects} subject{'' if subjects == 1 else 's'}, "
            f"photos {self.recipe or 'made elsewhere'}"
        )
        if self.protocol is None:
            return [measured_on, *filter(None, [self.origin])]
        return [measured_on, f"Metric protocol {self.protocol.text}"]

    def _where_best(self) -> str:
        """On which subjects the best is found, where rows are not all of the same."""
        counts = {len(self.common_subjects(column)) for column in self.uneven}
        if not counts:
            return ""
        if counts == {0}:
            return " where ranked rows have a subject in common: none here"
        one = f"{next(iter(counts))} " if len(counts) == 1 else ""
        noun = "subject" if counts == {1} else "subjects"
        return f" by the means on the {one}{noun} that all ranked rows with numbers have"


def with_common_means(table: Table) -> Table:
    """The table with a note on each row whose printed means are not those that it is ranked by."""
    return replace(table, rows=tuple(_noted(table, row) for row in table.rows))


def _noted(table: Table, row: Row) -> Row:
    means = {column: table.common_mean(row, column) for column in table.uneven}
    texts = [
        f"{column.title} {column.text(mean)} {column.unit}".rstrip()
        for column, mean in means.items()
        if mean is not None
        and row.cells[column.id].by_subject.keys() != set(table.common_subjects(column))
    ]
    if not texts:
        return row
    note = f"On the subjects that all ranked rows with numbers have: {', '.join(texts)}"
    return replace(row, notes=(*row.notes, note))


def footnote_mark(index: int) -> str:
    """a, b, ... z, aa, ab, ... for 0, 1, 2, ..."""
    mark = ""
    index += 1
    while index:
        index, letter = divmod(index - 1, 26)
        mark = chr(ord("a") + letter) + mark
    return mark


def mean_cell(values: Sequence[float], interval: Interval | None = None) -> Cell:
    """The mean over subjects, with its interval where one is asked for and at least two count."""
    mean = fmean(values)
    if interval is None or len(values) < 2:
        return Cell(mean)
    low, high = interval(values)
    return Cell(mean, low, high)


def subject_cell(values: Mapping[str, float], interval: Interval | None = None) -> Cell:
    """``mean_cell`` of values by subject, in a table that says which row is the best."""
    return replace(mean_cell(list(values.values()), interval), by_subject=values)


def cells_of(
    readers: Mapping[str, Callable[[T], float | None]],
    by_subject: Mapping[str, T],
    interval: Interval | None,
) -> dict[str, Cell]:
    """A cell for each column that some subjects have a number of.

    Args:
        readers: What reads a subject's number, or None where it has none, by column id.
        by_subject: What is read, such as a record.
        interval: Makes a confidence interval of the mean.
    """
    cells: dict[str, Cell] = {}
    for column, read in readers.items():
        found = {subject: read(each) for subject, each in by_subject.items()}
        values = {subject: value for subject, value in found.items() if value is not None}
        if values:
            cells[column] = subject_cell(values, interval)
    return cells

"""The grid of texts that people read, the same in every markup: header, methods, stages."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from reports.published import PublishedBlock
from reports.tables.table import DASH, Cell, Column, Row, Table

_PUBLISHED_MARK = "†"


@dataclass(frozen=True, slots=True)
class Markup:
    """How one language writes what a table needs; every function returns source text.

    ``interval`` takes a number already marked up and the ends of its interval.
    """

    escape: Callable[[str], str]
    heading: Callable[[Column], str]
    bold: Callable[[str], str]
    raised: Callable[[str], str]
    interval: Callable[[str, str, str], str]
    indent: str


def header_line(table: Table, markup: Markup) -> list[str]:
    """The header's cells; ``n/N`` only where some row is not of all subjects."""
    count = [] if table.complete else ["n/N"]
    return ["Method", *count, *map(markup.heading, table.columns)]


def body_lines(table: Table, markup: Markup) -> list[list[str]]:
    """The cells of every row, each followed by its stages."""
    return [line for row in table.rows for line in _row_lines(table, row, markup)]


def _row_lines(table: Table, row: Row, markup: Markup) -> list[list[str]]:
    marks = ",".join(table.marks(row))
    title = markup.escape(row.title) + (markup.raised(marks) if marks else "")
    numbers = [
        _number(column, row.cells.get(column.id), markup, best=table.is_best(row, column))
        for column in table.columns
    ]
    lines = [[title, *_count(table, f"{row.n}/{row.of}"), *numbers]]
    for stage in row.stages:
        numbers = [_number(column, stage.cells.get(column.id), markup) for column in table.columns]
        lines.append([markup.indent + markup.escape(stage.name), *_count(table, ""), *numbers])
    return lines


def _count(table: Table, text: str) -> list[str]:
    return [] if table.complete else [text]


def _number(column: Column, cell: Cell | None, markup: Markup, *, best: bool = False) -> str:
    if cell is None:
        return markup.escape(DASH)
    text = column.text(cell.value)
    shown = markup.bold(text) if best else text
    if cell.low is None or cell.high is None:
        return shown
    return markup.interval(shown, column.text(cell.low), column.text(cell.high))


def published_lines(table: Table, block: PublishedBlock, markup: Markup) -> list[list[str]]:
    """The printed numbers under the table's own columns: a heading's cell, then one line a row."""
    heading = markup.escape(block.heading) + markup.raised(_PUBLISHED_MARK)
    lines = [[heading]]
    for row in block.rows:
        cells = [row.cells.get(column.id) for column in table.columns]
        texts = [markup.escape(cell.text if cell else DASH) for cell in cells]
        lines.append([markup.escape(row.title), *_count(table, ""), *texts])
    return lines


def footnotes(table: Table, markup: Markup) -> list[str]:
    """One sentence for each mark, the published block's source last."""
    notes = {mark: text for text, mark in table.footnotes.items()}
    if table.published:
        notes[_PUBLISHED_MARK] = f"{table.published.source}. {table.published.note}"
    return [f"{markup.raised(mark)} {markup.escape(text)}." for mark, text in notes.items()]

"""The table as Markdown, for people and for the summary page of a CI job."""

from __future__ import annotations

import re

from harness.core.units import Unit
from reports.formats.latex import Markup, body_lines, footnotes, header_line, published_lines
from reports.tables.table import Column, Table

_ESCAPED = str.maketrans({character: f"\\{character}" for character in r"\`*_[]<>|~#"})
#: What GitHub makes a link or a message to somebody of; it does not with this sign behind it.
_LINKED, _BREAK = re.compile(r"@|www(?=\.)|:(?=//)", re.IGNORECASE), "\N{WORD JOINER}"


def to_markdown(table: Table) -> str:
    """A GitHub-flavoured table with its caption above and its footnotes below."""
    header = header_line(table, _MARKDOWN)
    lines = [_escape(table.caption), "", *_grid(header, body_lines(table, _MARKDOWN))]
    if table.published:
        [heading], *rows = published_lines(table, table.published, _MARKDOWN)
        lines += ["", f"{heading}:", "", *_grid(header, rows)]
    if notes := footnotes(table, _MARKDOWN):
        lines += ["", "  \n".join(notes)]
    return "\n".join(lines) + "\n"


def _grid(header: list[str], rows: list[list[str]]) -> list[str]:
    rule = [":---", *["---:"] * (len(header) - 1)]
    return [f"| {' | '.join(cells)} |" for cells in (header, rule, *rows)]


def _escape(text: str) -> str:
    return _LINKED.sub(rf"\g<0>{_BREAK}", " ".join(text.split()).translate(_ESCAPED))


def _heading(column: Column) -> str:
    unit = "" if column.unit == Unit.none.value else f" ({_escape(column.unit)})"
    return f"{_escape(column.title)}{unit}{' ↓' if column.ranked else ''}"


_MARKDOWN = Markup(
    escape=_escape,
    heading=_heading,
    bold=lambda text: f"**{text}**",
    raised=lambda mark: f"<sup>{mark}</sup>",
    interval=lambda number, low, high: f"{number} \\[{low}, {high}\\]",
    indent="&emsp;",
)

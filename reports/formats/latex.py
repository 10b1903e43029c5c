r"""Records become the paper's table: booktabs LaTeX that compiles as it is, or Markdown.

The output is plain ASCII and needs ``\usepackage{booktabs}`` alone. What a cell says was decided in
``reports/tables/table.py``; here it is only typeset.

Before: ``harness/run/evaluate.py``. After: nothing; this is the last stop.
"""

import re
import unicodedata
from collections.abc import Callable
from dataclasses import dataclass

from harness.core.units import Unit
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


_NOTHING = "\N{ZERO WIDTH SPACE}"
_SPECIAL = {
    "\\": r"\textbackslash{}",
    **{character: f"\\{character}" for character in "{}$&#_%"},
    "^": r"\textasciicircum{}",
    "~": r"\textasciitilde{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
    '"': "''",
    "–": "--",
    "—": "---",
    "‘": "`",
    "’": "'",
    "“": "``",
    "”": "''",
    "…": r"\ldots{}",
    "†": r"$\dagger$",
    "×": r"$\times$",
    "±": r"$\pm$",
    "≤": r"$\leq$",
    "≥": r"$\geq$",
    "°": r"$^\circ$",
    "ß": r"\ss{}",
    "ø": r"\o{}",
    "ł": r"\l{}",
    _NOTHING: "{}",
}
#: LaTeX's accent commands by Unicode combining mark.
_ACCENTS = {
    "\N{COMBINING GRAVE ACCENT}": "`",
    "\N{COMBINING ACUTE ACCENT}": "'",
    "\N{COMBINING CIRCUMFLEX ACCENT}": "^",
    "\N{COMBINING TILDE}": "~",
    "\N{COMBINING MACRON}": "=",
    "\N{COMBINING BREVE}": "u",
    "\N{COMBINING DOT ABOVE}": ".",
    "\N{COMBINING DIAERESIS}": '"',
    "\N{COMBINING RING ABOVE}": "r",
    "\N{COMBINING DOUBLE ACUTE ACCENT}": "H",
    "\N{COMBINING CARON}": "v",
    "\N{COMBINING CEDILLA}": "c",
}


def to_latex(table: Table) -> str:
    """A ``table`` environment: caption, rows, the published block where asked for, footnotes."""
    header = header_line(table, _LATEX)
    units = ["", *([] if table.complete else [""]), *map(_unit, table.columns)]
    lines = [
        r"% Needs \usepackage{booktabs}.",
        r"\begin{table}[t]",
        r"  \centering",
        rf"  \caption{{{escape(table.caption)}}}",
        rf"  \label{{tab:{table.name}}}",
        r"  \par\smallskip",
        r"  \small\setlength{\tabcolsep}{4pt}",
        rf"  \begin{{tabular}}{{l{'r' * (len(header) - 1)}}}",
        r"    \toprule",
        _line(header),
        _line(units),
        r"    \midrule",
        *map(_line, body_lines(table, _LATEX)),
    ]
    if table.published:
        [heading], *rows = published_lines(table, table.published, _LATEX)
        spanning = rf"\multicolumn{{{len(header)}}}{{l}}{{\emph{{{heading}}}}}"
        lines += [r"    \midrule", _line([spanning]), *map(_line, rows)]
    lines += [r"    \bottomrule", r"  \end{tabular}"]
    if notes := footnotes(table, _LATEX):
        body = "\\\\\n    ".join(notes)
        lines += [r"  \par\smallskip", rf"  \parbox{{\linewidth}}{{\footnotesize {body}}}"]
    return "\n".join([*lines, r"\end{table}"]) + "\n"


def escape(text: str) -> str:
    """Any text as ASCII LaTeX source that prints it; a sign without a command becomes its code."""
    one_line = unicodedata.normalize("NFC", " ".join(text.split()))
    # Two hyphens, as in an option's name, would be joined into a dash.
    unjoined = re.sub("-(?=-)", f"-{_NOTHING}", one_line)
    return "".join(map(_escape_character, unjoined))


def _escape_character(character: str) -> str:
    if character in _SPECIAL:
        return _SPECIAL[character]
    if character.isascii() and character.isprintable():
        return character
    base, *marks = unicodedata.normalize("NFD", character)
    if base.isascii() and len(marks) == 1 and marks[0] in _ACCENTS:
        return rf"\{_ACCENTS[marks[0]]}{{{base}}}"
    return f"[U+{ord(character):04X}]"


def _unit(column: Column) -> str:
    arrow = r" $\downarrow$" if column.ranked else ""
    return f"({escape(column.unit)}){arrow}" if column.unit != Unit.none.value else arrow.strip()


def _stacked(number: str, low: str, high: str) -> str:
    # Below the number, not beside it, or four metrics are wider than a page.
    interval = rf"{{\scriptsize [{low}, {high}]}}"
    return rf"\begin{{tabular}}[t]{{@{{}}r@{{}}}}{number} \\ {interval}\end{{tabular}}"


def _line(cells: list[str]) -> str:
    text = " & ".join(cells)
    # After the line break above, a bracket or a star would be read as its argument.
    guard = "{}" if text.startswith(("[", "*")) else ""
    return rf"    {guard}{text} \\"


_LATEX = Markup(
    escape=escape,
    heading=lambda column: column.latex_title,
    bold=lambda text: rf"\textbf{{{text}}}",
    raised=lambda mark: rf"\textsuperscript{{{escape(mark)}}}",
    interval=_stacked,
    indent=r"\quad ",
)


_ESCAPED = str.maketrans({character: f"\\{character}" for character in r"\`*_[]<>|~#"})
#: What GitHub makes a link or a message to somebody of; it does not with this sign behind it.
_LINKED, _BREAK = re.compile(r"@|www(?=\.)|:(?=//)", re.IGNORECASE), "\N{WORD JOINER}"


def to_markdown(table: Table) -> str:
    """A GitHub-flavoured table with its caption above and its footnotes below."""
    header = header_line(table, _MARKDOWN)
    lines = [_markdown_escape(table.caption), "", *_grid(header, body_lines(table, _MARKDOWN))]
    if table.published:
        [heading], *rows = published_lines(table, table.published, _MARKDOWN)
        lines += ["", f"{heading}:", "", *_grid(header, rows)]
    if notes := footnotes(table, _MARKDOWN):
        lines += ["", "  \n".join(notes)]
    return "\n".join(lines) + "\n"


def _grid(header: list[str], rows: list[list[str]]) -> list[str]:
    rule = [":---", *["---:"] * (len(header) - 1)]
    return [f"| {' | '.join(cells)} |" for cells in (header, rule, *rows)]


def _markdown_escape(text: str) -> str:
    return _LINKED.sub(rf"\g<0>{_BREAK}", " ".join(text.split()).translate(_ESCAPED))


def _markdown_heading(column: Column) -> str:
    unit = "" if column.unit == Unit.none.value else f" ({_markdown_escape(column.unit)})"
    return f"{_markdown_escape(column.title)}{unit}{' ↓' if column.ranked else ''}"


_MARKDOWN = Markup(
    escape=_markdown_escape,
    heading=_markdown_heading,
    bold=lambda text: f"**{text}**",
    raised=lambda mark: f"<sup>{mark}</sup>",
    interval=lambda number, low, high: f"{number} \\[{low}, {high}\\]",
    indent="&emsp;",
)

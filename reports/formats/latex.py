r"""Records become the paper's table: booktabs LaTeX that compiles as it is.

The output is plain ASCII and needs ``\usepackage{booktabs}`` alone. What a cell says was decided in
``reports/tables/table.py`` and ``reports/formats/layout.py``; here it is only typeset.

Before: ``harness/pipeline/run/evaluate.py``. After: nothing; this is the last stop.
"""

from __future__ import annotations

import re
import unicodedata

from harness.core.units import Unit
from reports.formats.layout import Markup, body_lines, footnotes, header_line, published_lines
from reports.tables.table import Column, Table

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

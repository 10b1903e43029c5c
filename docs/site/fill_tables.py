"""Tables of the pages, made from the records in ``docs/measured``.

A page marks the place of a table by what comes after ``harness report``::

    <!-- table: --records docs/measured/paper8.jsonl --table geometry --method hull8,mexecon+ -->
    <!-- end of table -->

A place that begins with ``rows:`` instead of ``table:`` has the table's rows alone, without what is
said above and below them. ``python docs/site/fill_tables.py`` writes each table between its two
marks. With ``--check`` it writes nothing, and ends with 1 if a page has another text there.
"""

from __future__ import annotations

import argparse
import re
import shlex
import sys
from pathlib import Path

from typer.testing import CliRunner

from harness.cli.main import app
from harness.core.files.atomic import write_text

ROOT = Path(__file__).resolve().parents[2]

_PLACE = re.compile(
    r"^<!-- (?P<kind>table|rows): (?P<arguments>[^\n]+) -->\n.*?^<!-- end of (?P=kind) -->$",
    re.MULTILINE | re.DOTALL,
)
_FOOTNOTE_MARK = re.compile(r"<sup>.*?</sup>")
#: Options whose value is a file of records.
_FILES = ("--records", "--before")


def pages_with_tables(root: Path = ROOT) -> list[Path]:
    """The README, pages and lab notes that have a mark, in the order of their names."""
    docs = root / "docs"
    pages = [root / "README.md", *sorted(docs.glob("*.md")), *sorted((docs / "lab").glob("*.md"))]
    return [page for page in pages if _PLACE.search(page.read_text(encoding="utf-8"))]


def filled(text: str, root: Path = ROOT) -> str:
    """A page with each of its tables as ``harness report`` prints it.

    Args:
        text: The page.
        root: What paths of files of records are relative to.

    Raises:
        ValueError: ``harness report`` refuses what a mark asks for.
    """
    return _PLACE.sub(lambda place: _table(place["kind"], place["arguments"], root), text)


def _table(kind: str, arguments: str, root: Path) -> str:
    words = shlex.split(arguments)
    for option in _FILES:
        if option in words[:-1]:
            where = words.index(option) + 1
            words[where] = str(root / words[where])
    found = CliRunner().invoke(app, ["report", *words])
    if found.exit_code:
        raise ValueError(f"harness report {arguments}: {found.exception or found.output}")
    table = found.stdout.strip()
    if kind == "rows":
        rows = [line for line in table.splitlines() if line.startswith("|")]
        table = _FOOTNOTE_MARK.sub("", "\n".join(rows))
    return f"<!-- {kind}: {arguments} -->\n\n{table}\n\n<!-- end of {kind} -->"


def _main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--check", action="store_true", help="write nothing; 1 if a page differs")
    check = parser.parse_args().check
    differ = False
    for page in pages_with_tables():
        before = page.read_text(encoding="utf-8")
        after = filled(before)
        if after == before:
            continue
        differ = True
        found = "other tables than its records give" if check else "written"
        print(f"{page.relative_to(ROOT)}: {found}")
        if not check:
            write_text(page, after)
    return int(differ and check)


if __name__ == "__main__":
    sys.exit(_main())

"""Which options of ``harness report`` go together: what would be ignored is refused."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

import typer

from harness.core.errors import HarnessError
from harness.pipeline.report.photo_tables import PHOTO_TABLES
from harness.pipeline.report.tables import (
    PAIRED_TABLE,
    PROTOCOLS_TABLE,
    PUBLISHED_TABLE,
    SEEDS_TABLE,
    TABLES,
)

_OF_TABLES = (
    "--table",
    "--format",
    "--json",
    "--interval",
    "--published",
    "--paired",
    "--protocol",
)
_OF_PAGES = ("--surfaces", "--include-licensed")


def given_options(context: typer.Context) -> frozenset[str]:
    """The options that the command line has, such as ``--table``."""
    found = set()
    for parameter in context.command.params:
        source = context.get_parameter_source(parameter.name or "")
        if source is not None and source.name == "COMMANDLINE":
            found |= {name for name in parameter.opts if name.startswith("--")}
    return frozenset(found)


def refuse_ignored(given: Collection[str], table: str, figure: str, page: Path | None) -> None:
    """Refuse options that take no part in what is made.

    Raises:
        HarnessError: it names the first of them.
    """
    if page is not None:
        kind, ignored = "--page", (*_OF_TABLES, "--output", "--figure")
    elif figure:
        kind, ignored = "--figure", (*_OF_TABLES, *_OF_PAGES)
    elif table in PHOTO_TABLES:
        kind, ignored = f"--table {table}", ("--published", "--paired", *_OF_PAGES)
    elif table in (SEEDS_TABLE, PROTOCOLS_TABLE):
        kind, ignored = f"--table {table}", ("--published", "--paired", "--interval", *_OF_PAGES)
    elif table == PUBLISHED_TABLE:
        needless = () if "--protocol" in given else ("--run",)
        ignored = (*needless, "--reason", "--published", *_OF_PAGES)
        kind = f"--table {table}, which needs no run"
    else:
        kind, ignored = "a table", ("--protocol", *_OF_PAGES)
    if table in (*PHOTO_TABLES, SEEDS_TABLE, PROTOCOLS_TABLE):
        ignored = (*ignored, "--protocol")
    for option in ignored:
        if option in given:
            hint = f"Leave {option} out"
            raise HarnessError(f"{option} cannot be combined with {kind}", hint=hint)


def refuse_with_records(
    records: Path | None, run: str | None, table: str, figure: str, page: Path | None
) -> None:
    """Refuse what a file of records, if one is given, cannot give.

    Raises:
        HarnessError: there is some.
    """
    if records is None:
        return
    other = {"--run": run, "--figure": figure, "--page": page}
    given = [option for option, value in other.items() if value]
    if table not in TABLES:
        given.append(f"--table {table}")
    if given:
        raise HarnessError(
            f"--records cannot be combined with {given[0]}",
            expected=f"a table of the records alone: {', '.join(TABLES)}",
            hint="Figures, pages and photo tables need a run: leave out --records",
        )


def refuse_with_before(before: Path | None, figure: str, page: Path | None) -> None:
    """Refuse pictures of a comparison with other records.

    Raises:
        HarnessError: there is one.
    """
    if before is not None and (figure or page):
        raise HarnessError(
            f"--before cannot be combined with {'--figure' if figure else '--page'}",
            expected=f"--table {PAIRED_TABLE}",
        )

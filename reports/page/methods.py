"""What a reader must know of the methods of some records."""

from __future__ import annotations

from collections.abc import Sequence

from harness.core.records import Record
from reports.page.model import PageMethod
from reports.tables.selection import select


def page_methods(records: Sequence[Record]) -> tuple[PageMethod, ...]:
    """What a reader must know of each method, in the order of the records."""
    infos = {record.method_name: record.method for record in records}
    return tuple(
        PageMethod(infos[group.method], _further(group.notes), group.competes)
        for group in select(records).groups
    )


def _further(notes: Sequence[str]) -> tuple[str, ...]:
    """The footnotes that say more than the lists of parts and privileges of the same card."""
    return tuple(note for note in notes if not note.startswith(("Given: ", "Parts: ")))

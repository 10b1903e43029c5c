"""The views figure of a run."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from harness.core.records import Record
from harness.pipeline.inputs.sources import Source
from harness.pipeline.run.store import RunStore
from reports.figures.view_curves import view_curves
from reports.statistics import bootstrap_ends
from reports.tables.views import view_series, views_table


def views(store: RunStore, source: Source, records: Sequence[Record], path: Path) -> Path:  # noqa: ARG001
    """Error over the number of photos, with 95 % intervals over the source's subjects.

    Raises:
        HarnessError: no method was run with several numbers of views.
        ProtocolMismatch: the records are not comparable.
    """
    table = views_table(records, subjects=source.subjects, interval=bootstrap_ends)
    count = len(source.subjects)
    caption = f"{table.dataset}, {table.recipe}, {count} subject{'s' * (count != 1)}"
    return view_curves(view_series(table), path, f"{caption}; bands: 95 % of the mean")

"""The views figure of a run."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from harness.core.records import Record
from harness.pipeline.inputs.sources import Source
from harness.pipeline.report.tables import ReportRequest, table_of_protocols
from harness.pipeline.run.store import RunStore
from reports.figures.rank_curves import rank_curves
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


def ranks(store: RunStore, source: Source, records: Sequence[Record], path: Path) -> Path:
    """Each method's rank under each protocol, with 95 % intervals over the source's subjects.

    Raises:
        HarnessError: no further protocol was measured in this run.
        ProtocolMismatch: the records are not comparable.
    """
    methods = tuple(dict.fromkeys(record.method_name for record in records))
    table = table_of_protocols(store, ReportRequest(methods=methods, subjects=source.subjects))
    count = len(source.subjects)
    caption = f"{table.dataset}, {count} subject{'s' * (count != 1)}; bars: 95 % of the rank"
    return rank_curves(table, path, caption)

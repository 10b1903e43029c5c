"""The cameras table: how far the cameras that a row worked with are from the true ones."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from harness.core.metric_catalog import METRICS
from harness.core.records import Record
from reports.tables.geometry import metric_column, metric_value
from reports.tables.selection import select
from reports.tables.table import Interval, Table, cells_of

#: Metric ids, in order.
CAMERA_METRICS = tuple(name for name in METRICS if name.startswith("camera_"))


def cameras_table(
    records: Sequence[Record],
    *,
    methods: Sequence[str] | None = None,
    subjects: Sequence[str] | None = None,
    interval: Interval | None = None,
    published: bool = False,
) -> Table:
    """The errors of estimated cameras, of rows that worked with such.

    Arguments and errors are those of ``geometry_table``; nothing of it is published.
    """
    del published
    selection = select(records, methods, subjects)
    shown = [group for group in selection.groups if any(map(_has_cameras, group.ok))]
    readers = {name: partial(metric_value, metric=name) for name in CAMERA_METRICS}
    return selection.table(
        name="cameras",
        title="Estimated cameras",
        columns=[metric_column(name, ranked=False) for name in CAMERA_METRICS],
        rows=[
            group.row(len(selection.subjects), cells_of(readers, group.by_subject, interval))
            for group in shown
        ],
        remarks=(
            "Rotation, direction and AUC over all pairs of photos; position and reprojection of "
            "points of the scan after a Sim(3) by cameras",
            *selection.remarks,
            *filter(None, [selection.absence(shown, _has_cameras, "estimated cameras")]),
        ),
    )


def _has_cameras(record: Record) -> bool:
    return CAMERA_METRICS[0] in record.metrics

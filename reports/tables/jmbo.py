"""The body table: how well each method's fitted body agrees with pictures and with the true body.

The paper's ablation of JMBO, and beside its losses what only subjects with a known body can tell.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from harness.core.errors import ProtocolMismatch
from harness.core.records import Record
from reports.published import PUBLISHED
from reports.tables.geometry import metric_column
from reports.tables.selection import Group, select
from reports.tables.table import Cell, Interval, Row, Table, subject_cell, with_common_means

#: Metric ids in the order of the paper's table, then ours.
BODY_METRICS = (
    "silhouette_loss",
    "landmark_loss",
    "normal_loss",
    "total_loss",
    "joint_error",
    "vertex_error",
    "silhouette_iou",
)
#: More is better, which no bold can say in a table where less is.
_UNRANKED = frozenset({"silhouette_iou"})
#: How near a fit can come to the truth, by the model that is fitted where there is a joint error.
_FAMILIES = {
    "Anny": "The fitted body is of the family that generated the subjects (Anny)",
    "SMPL-X": "The true bodies are SMPL-X fits of the scans, of the model that is fitted",
}


def jmbo_table(
    records: Sequence[Record],
    *,
    methods: Sequence[str] | None = None,
    subjects: Sequence[str] | None = None,
    interval: Interval | None = None,
    published: bool = False,
) -> Table:
    """The fitted bodies of some records: a pure function of them.

    Methods that fit no body are named in a remark. Arguments and errors are those of
    ``geometry_table``.
    """
    selection = select(records, methods, subjects)
    with_body = [group for group in selection.groups if not group.ok or _has_body(group)]
    without = [group.title for group in selection.groups if group not in with_body]
    table = Table(
        name="jmbo",
        title="Body fit",
        dataset=selection.dataset,
        recipe=selection.recipe,
        protocol=selection.protocol,
        columns=tuple(
            metric_column(metric, ranked=metric not in _UNRANKED) for metric in BODY_METRICS
        ),
        rows=tuple(_row(group, len(selection.subjects), interval) for group in with_body),
        remarks=(
            "Losses: per image, mean over the views; weights of the total 1, 0.2, 0.1",
            "Joints: 12, no alignment",
            *_about_the_truth([record for group in with_body for record in group.ok]),
            *selection.remarks,
            *([f"Without a fitted body: {'; '.join(without)}"] if without else []),
        ),
        published=PUBLISHED["jmbo"] if published else None,
    )
    return with_common_means(table)


def _about_the_truth(records: Sequence[Record]) -> list[str]:
    """How near the true bodies are to what the fitted model can give.

    Only where truth and fit are one model is there a joint error.
    """
    if not any("joint_error" in record.metrics for record in records):
        return []
    models = {
        part.name.partition(" ")[0]
        for record in records
        if "joint_error" in record.metrics
        for part in record.method.parts
        if part.role == "body model"
    }
    remarks = [_FAMILIES[model] for model in sorted(models) if model in _FAMILIES]
    off = {
        record.subject: record.metrics["off_model"].value
        for record in records
        if "off_model" in record.metrics
    }
    if off:
        remarks.append(
            f"{len(off)} true bodies are off the model's manifold: their surface is "
            f"{min(off.values()):.1f} to {max(off.values()):.1f} mm (root mean square) from what "
            "the model gives for the subject's own parameters"
        )
    return remarks


def _has_body(group: Group) -> bool:
    return any("silhouette_loss" in record.metrics for record in group.ok)


def _row(group: Group, of: int, interval: Interval | None) -> Row:
    return group.row(of, _cells(group.ok, interval))


def _cells(records: Sequence[Record], interval: Interval | None) -> Mapping[str, Cell]:
    """A cell for every metric that all subjects have; the true body is not known everywhere."""
    cells = {}
    for metric in BODY_METRICS:
        have = [record for record in records if metric in record.metrics]
        if have and len(have) < len(records):
            absent = next(record for record in records if metric not in record.metrics)
            raise ProtocolMismatch(
                f"the record of {absent.method_name}/{absent.subject} has no {metric}",
                expected=f"as in {have[0].method_name}/{have[0].subject}",
                hint="Evaluate it again to replace it",
            )
        if have:
            values = {record.subject: record.metrics[metric].value for record in have}
            cells[metric] = subject_cell(values, interval)
    return cells

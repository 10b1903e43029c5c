"""The body table: how well each method's fitted body agrees with pictures and with the true body.

The paper's ablation of JMBO, and beside its losses what only subjects with a known body can tell.
"""

from collections.abc import Mapping, Sequence
from functools import partial

from harness.core.errors import ProtocolMismatch
from harness.core.records import Record
from reports.published import PUBLISHED
from reports.tables.geometry import metric_column
from reports.tables.selection import EVERYTHING, Asked, Group, select
from reports.tables.table import Cell, Interval, Table, cells_of, with_common_means

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


def jmbo_table(records: Sequence[Record], asked: Asked = EVERYTHING) -> Table:
    """The fitted bodies of some records: a pure function of them.

    Methods that fit no body are named in a remark. Arguments and errors are those of
    ``geometry_table``.
    """
    selection = select(records, asked.methods, asked.subjects)
    with_body = [group for group in selection.groups if not group.ok or _has_body(group)]
    without = [group.title for group in selection.groups if group not in with_body]
    of = len(selection.subjects)
    table = selection.table(
        name="jmbo",
        title="Body fit",
        columns=(metric_column(name, ranked=name not in _UNRANKED) for name in BODY_METRICS),
        rows=(group.row(of, _cells(group, asked.interval)) for group in with_body),
        remarks=(
            "Losses: per image, mean over the views; weights of the total 1, 0.2, 0.1",
            "Joints: 12, no alignment",
            *_about_the_truth([record for group in with_body for record in group.ok]),
            *selection.remarks,
            *([f"Without a fitted body: {'; '.join(without)}"] if without else []),
        ),
        published=PUBLISHED["jmbo"] if asked.published else None,
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


def _cells(group: Group, interval: Interval | None) -> Mapping[str, Cell]:
    """A cell for every metric that all subjects have; the true body is not known everywhere."""
    cells = cells_of(_READERS, group.by_subject, interval)
    for metric, cell in cells.items():
        absent = [each for each in group.ok if each.subject not in cell.by_subject]
        if absent:
            raise ProtocolMismatch(
                f"the record of {absent[0].method_name}/{absent[0].subject} has no {metric}",
                expected=f"as in {absent[0].method_name}/{next(iter(cell.by_subject))}",
                hint="Evaluate it again to replace it",
            )
    return cells


def _value(record: Record, metric: str) -> float | None:
    return record.metrics[metric].value if metric in record.metrics else None


_READERS = {metric: partial(_value, metric=metric) for metric in BODY_METRICS}

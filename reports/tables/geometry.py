"""The geometry table: how far each method's surface is from the scan, mean over subjects."""

from collections.abc import Sequence
from functools import partial
from statistics import fmean

from harness.core.errors import ProtocolMismatch
from harness.core.metric_catalog import METRICS
from harness.core.records import ProtocolStamp, Record
from reports.published import PUBLISHED
from reports.tables.selection import EVERYTHING, Asked, Selection, select
from reports.tables.table import Column, Table, cells_of, with_common_means

#: Metric ids of the paper's geometry table, in its order.
GEOMETRY_METRICS = ("chamfer", "p2s_accuracy", "p2s_completeness", "normal_error")


def geometry_table(records: Sequence[Record], asked: Asked = EVERYTHING) -> Table:
    """The paper's geometry table of some records: a pure function of them.

    Args:
        records: Records of one run.
        asked: What of them is shown, and how.

    Raises:
        HarnessError: no records, or two for one method and subject.
        ProtocolMismatch: records that are not comparable.
    """
    selection = select(records, asked.methods, asked.subjects)
    columns = columns_of(selection.protocol)
    readers = {
        column.id: partial(metric_value, metric=column.id, unit=column.unit) for column in columns
    }
    of = len(selection.subjects)
    rows = [
        group.row(of, cells_of(readers, group.by_subject, asked.interval))
        for group in selection.groups
    ]
    table = selection.table(
        name="geometry",
        title="Mesh geometry",
        columns=columns,
        rows=rows,
        remarks=(*selection.remarks, *_floor_remarks(selection, columns)),
        published=PUBLISHED["geometry"] if asked.published else None,
    )
    return with_common_means(table)


def metric_column(metric: str, *, ranked: bool = True) -> Column:
    """The column of a metric of the catalogue."""
    described = METRICS[metric]
    return Column(
        id=metric,
        title=described.title,
        latex_title=described.latex_title,
        unit=described.unit,
        digits=described.digits,
        ranked=ranked,
    )


def columns_of(protocol: ProtocolStamp) -> tuple[Column, ...]:
    """The columns of a protocol's summary: MExECON's four, or what another publication prints."""
    summary = (protocol.settings or {}).get("summary")
    if not isinstance(summary, Sequence):
        return tuple(metric_column(metric) for metric in GEOMETRY_METRICS)
    return tuple(
        Column(
            id=each["key"],
            title=each["key"],
            latex_title=each["key"].replace("_", r"\_"),
            unit=each["unit"],
            digits=3,
            ranked=not each["higher"],
        )
        for each in summary
    )


def metric_value(record: Record, metric: str, unit: str = "") -> float:
    """A record's estimate of a metric, in the metric's unit of the catalogue or in another.

    Raises:
        ProtocolMismatch: none there, or in another unit.
    """
    where = f"{record.method_name}/{record.subject}"
    if metric not in record.metrics:
        without_scan = record.inputs.get("truth") == {}
        raise ProtocolMismatch(
            f"the record of {where} has no {metric}",
            hint="Imported photos have no scan to be measured against: --table photos needs none; "
            "another run is named with --run"
            if without_scan
            else "Evaluate it again to replace it",
        )
    estimate, unit = record.metrics[metric], unit or METRICS[metric].unit
    if estimate.unit != unit:
        raise ProtocolMismatch(
            f"{metric} of {where} is in another unit", expected=unit, got=estimate.unit
        )
    return estimate.value


def _floor_remarks(selection: Selection, columns: Sequence[Column]) -> list[str]:
    """What the truths score against themselves, where sampling keeps that from being 0."""
    remarks = []
    for column in columns:
        # A subject's floor is of its truth, the same for every method.
        floors = {
            record.subject: record.metrics[column.id].floor
            for group in selection.groups
            for record in group.ok
        }
        if floor := fmean(floors.values()) if floors else 0.0:
            remarks.append(
                f"Sampling floor of {column.title}, which each truth scores against itself, "
                f"sampled a second time, mean over subjects: {column.text(floor)} {column.unit}"
            )
    return remarks


#: Metric ids, in order.
CAMERA_METRICS = tuple(name for name in METRICS if name.startswith("camera_"))
_SD = "camera_rotation_sd"


def cameras_table(records: Sequence[Record], asked: Asked = EVERYTHING) -> Table:
    """The errors of estimated cameras, of rows that worked with such.

    Arguments and errors are those of ``geometry_table``; nothing of it is published.
    """
    selection = select(records, asked.methods, asked.subjects)
    shown = [group for group in selection.groups if any(map(_has_cameras, group.ok))]
    # How sure cameras are is told by our own search alone.
    told = {name for group in shown for record in group.ok for name in record.metrics}
    names = [name for name in CAMERA_METRICS if name != _SD or name in told]
    readers = {name: partial(_camera_value, metric=name) for name in names}
    return selection.table(
        name="cameras",
        title="Estimated cameras",
        columns=[metric_column(name, ranked=False) for name in names],
        rows=[
            group.row(len(selection.subjects), cells_of(readers, group.by_subject, asked.interval))
            for group in shown
        ],
        remarks=(
            "Rotation, direction and AUC over all pairs of photos; position and reprojection of "
            "points of the scan, each after a Sim(3) by cameras",
            *selection.remarks,
            *filter(None, [selection.absence(shown, _has_cameras, "estimated cameras")]),
        ),
    )


def _camera_value(record: Record, metric: str) -> float | None:
    if metric == _SD and metric not in record.metrics:
        return None
    return metric_value(record, metric)


def _has_cameras(record: Record) -> bool:
    return CAMERA_METRICS[0] in record.metrics

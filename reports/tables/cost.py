"""The cost table: wall time and peak memory of each method and of its stages."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from harness.core.artifacts import StageCost
from harness.core.records import Record
from reports.published import PUBLISHED
from reports.tables.selection import EVERYTHING, Asked, Group, select
from reports.tables.table import Cell, Column, Interval, Row, Stage, Table, mean_cell

#: Time is a mean over subjects; a peak is the highest of any subject, for it must fit the machine.
COST_COLUMNS = (
    Column("wall_s", "Time", "Time", "s", 1, ranked=False),
    Column("peak_rss_mib", "Peak memory", "Peak memory", "MiB", 0, ranked=False, statistic="max"),
    Column("peak_gpu_mib", "Peak GPU", "Peak GPU", "MiB", 0, ranked=False, statistic="max"),
)


def cost_table(records: Sequence[Record], asked: Asked = EVERYTHING) -> Table:
    """What one reconstruction takes, by method and stage: a pure function of records.

    Stages run one after the other, so that a method's time is the sum of theirs and its peak the
    highest of theirs. Arguments and errors are those of ``geometry_table``.
    """
    selection = select(records, asked.methods, asked.subjects)
    of = len(selection.subjects)
    return selection.table(
        name="cost",
        title="Cost of one reconstruction",
        columns=COST_COLUMNS,
        rows=(_row(group, of, asked.interval) for group in selection.groups),
        remarks=(
            "Time: mean over subjects. Memory: highest of any subject",
            *selection.remarks,
            *_sharing_remarks(selection.groups),
            *_machine_remarks(record for group in selection.groups for record in group.ok),
        ),
        published=PUBLISHED["cost"] if asked.published else None,
    )


def _row(group: Group, of: int, interval: Interval | None) -> Row:
    by_subject = [record.stages for record in group.ok]
    names = dict.fromkeys(stage.name for stages in by_subject for stage in stages)
    return replace(
        group.row(of, _cells(by_subject, interval)),
        # What was given changes nothing about what it cost.
        competes=True,
        stages=tuple(
            Stage(name, _cells([_named(name, stages) for stages in by_subject], interval))
            for name in names
        ),
    )


def _named(name: str, stages: Sequence[StageCost]) -> list[StageCost]:
    return [stage for stage in stages if stage.name == name]


def _cells(
    by_subject: Sequence[Sequence[StageCost]], interval: Interval | None
) -> Mapping[str, Cell]:
    """Cells of each subject's stages; a subject without any spent no time there."""
    stages = [stage for stages in by_subject for stage in stages]
    if not stages:
        return {}
    times = [sum(stage.wall_s for stage in stages) for stages in by_subject]
    cells = {
        "wall_s": mean_cell(times, interval),
        "peak_rss_mib": Cell(max(stage.peak_rss_mib for stage in stages)),
    }
    gpu = [stage.peak_gpu_mib for stage in stages if stage.peak_gpu_mib is not None]
    return {**cells, "peak_gpu_mib": Cell(max(gpu))} if gpu else cells


def _sharing_remarks(groups: Iterable[Group]) -> list[str]:
    """Which rows took work over, because their peaks do not hold what it leaves in memory."""
    rows = [group for group in groups if any(record.shared_work for record in group.ok)]
    if not rows:
        return []
    work = sorted({name for group in rows for record in group.ok for name in record.shared_work})
    titles = ", ".join(group.method for group in rows)
    return [
        f"Taken over from other rows on some subjects ({', '.join(work)}): {titles}. Times are "
        "those of doing all alone; peaks of memory may be lower ('--no-share' measures them)"
    ]


def _machine_remarks(records: Iterable[Record]) -> list[str]:
    machines = sorted(
        {
            f"{record.environment.system}, {record.environment.cpus} CPUs"
            for record in records
            if record.environment
        }
    )
    if len(machines) > 1:
        return [f"Times are of different machines and not comparable: {'; '.join(machines)}"]
    return [f"Machine: {machine}" for machine in machines]

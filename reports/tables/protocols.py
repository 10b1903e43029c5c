"""The protocols' table: each method's number and rank under each protocol of the field.

A rank's interval is of bootstraps over subjects: whether another twenty people would have ordered
the methods so.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from harness.core.arrays import Floats
from harness.core.errors import HarnessError
from harness.core.protocol_scores import ProtocolScore
from harness.core.records import ProtocolStamp, Record
from reports.tables.selection import Group, Selection, select
from reports.tables.table import Cell, Column, Table

_ROUNDS, _ENDS = 2000, (2.5, 97.5)
#: Scores by protocol's name, by method, by subject.
Scores = Mapping[tuple[str, str], Sequence[ProtocolScore]]


def protocols_table(
    records: Sequence[Record],
    scores: Scores,
    *,
    methods: Sequence[str] | None = None,
    subjects: Sequence[str] | None = None,
) -> Table:
    """Every method's mean and rank under each protocol, by the protocol's first number.

    Args:
        records: Of one run; their own protocol is one of them.
        scores: Under the others, by method and subject.
        methods: Rows wanted; all by default.
        subjects: Subjects that count; all by default.

    Raises:
        HarnessError: no further protocol was measured.
    """
    selection = select(records, methods, subjects)
    rows = [group for group in selection.groups if group.ok]
    stamps = _stamps(selection, scores)
    columns: list[Column] = []
    told: list[str] = []
    cells: dict[str, dict[str, Cell]] = {group.method: {} for group in rows}
    for stamp in stamps:
        key, unit, higher = _first(stamp)
        values = {group.method: _values(group, stamp, key, scores) for group in rows}
        common = set.intersection(*(set(each) for each in values.values())) if values else set()
        if not common:
            continue
        columns += _columns(stamp, key, unit)
        told.append(stamp.text)
        chosen = sorted(common)
        matrix = np.array([[values[group.method][s] for s in chosen] for group in rows])
        ranks, low, high = _ranks(-matrix if higher else matrix)
        for i, group in enumerate(rows):
            own = {s: values[group.method][s] for s in chosen}
            cells[group.method][f"{stamp.name}_{key}"] = Cell(
                float(matrix[i].mean()), None, None, own
            )
            cells[group.method][f"{stamp.name}_rank"] = Cell(ranks[i], low[i], high[i])
    return Table(
        name="protocols",
        title="Each method under each protocol, and its rank",
        dataset=selection.dataset,
        recipe=selection.recipe,
        protocol=None,
        columns=tuple(columns),
        rows=tuple(group.row(len(selection.subjects), cells[group.method]) for group in rows),
        remarks=(
            *selection.remarks,
            "Ranks have 95 % intervals of bootstraps over subjects; numbers of different protocols "
            "are not comparable: " + "; ".join(told),
        ),
    )


def _stamps(selection: Selection, scores: Scores) -> list[ProtocolStamp]:
    """The records' own protocol, and all that were measured besides."""
    found = {selection.protocol.name: selection.protocol}
    for of_cell in scores.values():
        for score in of_cell:
            known = found.setdefault(score.protocol.name, score.protocol)
            if known.sha != score.protocol.sha:
                raise HarnessError(
                    f"protocol {known.name} was changed under its name",
                    expected=known.text,
                    got=score.protocol.text,
                    hint="Evaluate again with --protocol",
                )
    if len(found) < 2:
        raise HarnessError(
            "no further protocol was measured in this run",
            hint="harness eval ... --protocol mexecon,econ,sith",
        )
    return list(found.values())


def _first(stamp: ProtocolStamp) -> tuple[str, str, bool]:
    """Key, unit and direction of a protocol's first number."""
    summary = (stamp.settings or {}).get("summary")
    if not isinstance(summary, Sequence) or not summary:
        return "chamfer", "mm", False
    first: Mapping[str, object] = summary[0]
    return str(first["key"]), str(first["unit"]), bool(first["higher"])


def _columns(stamp: ProtocolStamp, key: str, unit: str) -> list[Column]:
    title = f"{stamp.name} {key}"
    latex = title.replace("_", r"\_")
    return [
        Column(f"{stamp.name}_{key}", title, latex, unit, 3, ranked=False),
        Column(f"{stamp.name}_rank", "rank", "rank", "1", 0, ranked=False),
    ]


def _values(group: Group, stamp: ProtocolStamp, key: str, scores: Scores) -> dict[str, float]:
    found = {}
    for record in group.ok:
        metrics = record.metrics if record.protocol.name == stamp.name else {}
        for score in scores.get((group.method, record.subject), ()):
            if score.protocol.name == stamp.name:
                metrics = score.metrics
        if key in metrics:
            found[record.subject] = metrics[key].value
    return found


def _ranks(values: Floats) -> tuple[list[float], list[float], list[float]]:
    """Rank of each of (M, S) methods by its mean, lower first, and its interval's ends."""
    random = np.random.default_rng(0)
    chosen = random.integers(values.shape[1], size=(_ROUNDS, values.shape[1]))
    means = values[:, chosen].mean(axis=2)
    drawn = 1 + (means[:, None] > means[None]).sum(axis=1)
    low, high = np.percentile(drawn, _ENDS, axis=1, method="nearest")
    mean = values.mean(axis=1)
    ranks = 1 + (mean[:, None] > mean[None]).sum(axis=1)
    first, second, third = (list(map(float, each)) for each in (ranks, low, high))
    return first, second, third

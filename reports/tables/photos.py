"""The photos table: what photos and the mesh itself tell of each method, without any scan."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import fmean

import numpy as np

from harness.core.arrays import Floats
from harness.core.photo_scores import PhotoScores
from harness.core.records import Record
from reports.tables.selection import Group, select
from reports.tables.table import Cell, Column, Interval, Row, Table, cells_of

_REMARKS = (
    "Silhouette IoU over the views, and of the worst view; PSNR and SSIM of the mesh coloured from "
    "all photos, and of photos that were left out in turn: higher is better",
    "Self-intersecting faces: lower is better; watertight: share of the subjects",
)


@dataclass(frozen=True, slots=True)
class Figure:
    """A figure without a scan.

    Attributes:
        id: As in files.
        title: For people, without unit.
        unit: Symbol.
        digits: Decimals shown.
        read: Its value, or None where the photos do not tell.
        higher_is_better: Which way it should go.
        printed: Whether it is a column of the printed table.
    """

    id: str
    title: str
    unit: str
    digits: int
    read: Callable[[PhotoScores], float | None]
    higher_is_better: bool = True
    printed: bool = True

    @property
    def column(self) -> Column:
        """Its column; none is ranked, because a lower number is not always better."""
        return Column(self.id, self.title, self.title, self.unit, self.digits, ranked=False)


FIGURES = (
    Figure("mean_iou", "Mean IoU", "1", 4, lambda s: s.mean_iou),
    Figure("worst_iou", "Worst view IoU", "1", 4, lambda s: s.worst_iou),
    Figure("psnr", "PSNR (exposure fitted)", "dB", 2, lambda s: s.psnr_db),
    Figure("ssim", "SSIM", "1", 4, lambda s: s.ssim),
    Figure(
        "held_out_psnr", "Held-out PSNR (exposure fitted)", "dB", 2, lambda s: s.held_out_psnr_db
    ),
    Figure(
        "self_intersections",
        "Self-intersecting faces",
        "1",
        1,
        lambda s: float(s.soundness.self_intersecting_faces),
        higher_is_better=False,
    ),
    Figure("watertight", "Watertight", "1", 2, lambda s: float(s.soundness.watertight)),
    Figure("held_out_ssim", "Held-out SSIM", "1", 4, lambda s: s.held_out_ssim, printed=False),
    Figure(
        "normal_agreement",
        "Normals beside the maps",
        "deg",
        2,
        lambda s: s.normal_agreement_deg,
        higher_is_better=False,
        printed=False,
    ),
    Figure(
        "open_edges",
        "Open edges",
        "1",
        1,
        lambda s: float(s.soundness.open_edges),
        higher_is_better=False,
        printed=False,
    ),
    Figure("seen", "Seen share", "1", 4, lambda s: s.seen_share, printed=False),
)


def photos_table(
    records: Sequence[Record],
    scores: Mapping[tuple[str, str], PhotoScores],
    absent: Mapping[tuple[str, str], str],
    *,
    methods: Sequence[str] | None = None,
    interval: Interval | None = None,
) -> Table:
    """The figures of some records, mean over subjects.

    Args:
        records: Of one run.
        scores: Figures by method and subject.
        absent: Why a record has none, likewise.
        methods: Rows wanted, in this order.
        interval: Of a mean.

    Raises:
        HarnessError: no records.
        ProtocolMismatch: the records are not comparable.
    """
    selection = select(records, methods)
    shown = [group for group in selection.groups if _scored(group, scores)]
    return selection.table(
        name="photos",
        title="Quality without a scan",
        protocol=None,
        columns=(figure.column for figure in FIGURES if figure.printed),
        more=tuple(figure.column for figure in FIGURES if not figure.printed),
        rows=(_row(group, scores, len(selection.subjects), interval) for group in shown),
        remarks=(*_REMARKS, *selection.remarks, *_absence_remarks(absent)),
        origin="Measured in the photos that the method saw",
    )


def _scored(group: Group, scores: Mapping[tuple[str, str], PhotoScores]) -> dict[str, PhotoScores]:
    """A method's figures by subject."""
    return {
        record.subject: scores[group.method, record.subject]
        for record in group.ok
        if (group.method, record.subject) in scores
    }


def _row(
    group: Group,
    scores: Mapping[tuple[str, str], PhotoScores],
    of: int,
    interval: Interval | None,
) -> Row:
    found = _scored(group, scores)
    cells = cells_of({figure.id: figure.read for figure in FIGURES}, found, interval)
    return replace(group.row(of, cells), n=len(found))


def _absence_remarks(absent: Mapping[tuple[str, str], str]) -> list[str]:
    reasons: dict[str, list[str]] = {}
    for (method, subject), reason in absent.items():
        reasons.setdefault(reason, []).append(f"{method} on {subject}")
    return [f"Without figures, because {why}: {', '.join(who)}" for why, who in reasons.items()]


#: Fewer values than these are not ranked.
LEAST_RANKED = 4
_ERRORS = {"chamfer": "Chamfer", "normal_error": "Normal"}
_GROUPINGS: Mapping[str, tuple[str, Callable[[Record], str]]] = {
    "all": ("all", lambda _: ""),
    "methods": ("methods of a subject", lambda record: record.subject),
    "subjects": ("subjects of a method", lambda record: record.method_name),
}
#: A figure that is the same almost everywhere has no ranks, and is not a quality by degrees.
_RANKED = tuple(figure for figure in FIGURES if figure.id not in ("watertight", "seen"))


@dataclass(frozen=True, slots=True)
class _Pair:
    """A record with its figures."""

    record: Record
    scores: PhotoScores


def photo_errors_table(
    records: Sequence[Record],
    scores: Mapping[tuple[str, str], PhotoScores],
    absent: Mapping[tuple[str, str], str],  # noqa: ARG001
    *,
    methods: Sequence[str] | None = None,
    interval: Interval | None = None,  # noqa: ARG001
) -> Table:
    """The rank correlation of each figure with the errors that the scan gives.

    Methods that are given the truth do not count. Arguments and errors are those of
    ``photos_table``; a coefficient has no interval.
    """
    selection = select(records, methods)
    pairs = [
        _Pair(record, scores[group.method, record.subject])
        for group in selection.groups
        if group.competes
        for record in group.ok
        if (group.method, record.subject) in scores and _ERRORS.keys() <= record.metrics.keys()
    ]
    rows = [_row_photo_errors(figure, pairs, len(selection.subjects)) for figure in _RANKED]
    used = len({pair.record.method_name for pair in pairs})
    return selection.table(
        name="photo-errors",
        title="Rank correlation of figures without a scan with the errors of the mesh",
        columns=(_column(error, grouping) for error in _ERRORS for grouping in _GROUPINGS),
        rows=(row for row in rows if row.cells),
        remarks=(
            f"{len(pairs)} reconstructions of {used} methods",
            "Spearman's coefficient: 1 where what looks better without the scan is better with it, "
            "0 where it says nothing. All: over all reconstructions; methods of a subject, and "
            "subjects of a method: mean over the subjects or methods with at least "
            f"{LEAST_RANKED} values",
            *selection.remarks,
        ),
    )


def _column(error: str, grouping: str) -> Column:
    title = f"{_ERRORS[error]}, {_GROUPINGS[grouping][0]}"
    return Column(f"{error}_{grouping}", title, title, "1", 2, ranked=False)


def _row_photo_errors(figure: Figure, pairs: Sequence[_Pair], of: int) -> Row:
    told = [pair for pair in pairs if figure.read(pair.scores) is not None]
    cells: dict[str, Cell] = {}
    for error in _ERRORS:
        for grouping, (_, group_of) in _GROUPINGS.items():
            found = _mean_correlation(figure, told, error, group_of)
            if found is not None:
                cells[f"{error}_{grouping}"] = Cell(found)
    subjects = len({pair.record.subject for pair in told})
    return Row(figure.id, figure.title, subjects, of, cells, competes=False)


def _mean_correlation(
    figure: Figure, pairs: Sequence[_Pair], error: str, group_of: Callable[[Record], str]
) -> float | None:
    groups: dict[str, list[_Pair]] = {}
    for pair in pairs:
        groups.setdefault(group_of(pair.record), []).append(pair)
    sign = -1.0 if figure.higher_is_better else 1.0
    found: list[float] = []
    for group in groups.values():
        values = np.array([figure.read(pair.scores) for pair in group], dtype=np.float64)
        errors = np.array([pair.record.metrics[error].value for pair in group])
        coefficient = rank_correlation(values, errors)
        if coefficient is not None:
            found.append(sign * coefficient)
    return fmean(found) if found else None


def rank_correlation(first: Floats, second: Floats) -> float | None:
    """Spearman's coefficient of (N,) values; None for few values, or where all are equal.

    Values that are equal share the mean of their ranks.
    """
    from scipy.stats import rankdata

    if len(first) < LEAST_RANKED or np.ptp(first) == 0 or np.ptp(second) == 0:
        return None
    return float(np.corrcoef(rankdata(first), rankdata(second))[0, 1])

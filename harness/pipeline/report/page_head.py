"""What a page says of a run as a whole: its head, its methods, and what it shows at first."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence

from harness.core.privileges import Privilege
from harness.core.records import Record
from harness.data.manifest import Dataset
from reports.page.model import Fact, PageMethod, PageSubject
from reports.tables.table import Table

#: Surfaces beside the photo and the truth that a page shows at first.
_OPENING = 2
#: Rows that were given part of the answer are not what a reader wants to see first.
_ANSWERS = frozenset(
    {Privilege.ORACLE_NORMALS, Privilege.GROUND_TRUTH_MESH, Privilege.MADE_ELSEWHERE}
)


def page_lead(records: Sequence[Record], dataset: Dataset, subjects: Sequence[PageSubject]) -> str:
    """One sentence on what was measured."""
    methods = len({record.method_name for record in records})
    photos = max((len(subject.views) for subject in subjects), default=0)
    source = f"from {photos} photos each" if photos else "from photos made elsewhere"
    return (
        f"{_counted(methods, 'method')} on {_counted(len(subjects), 'subject')} of "
        f"{dataset.title[:1].lower()}{dataset.title[1:]}, reconstructed {source} and measured "
        "against the true surface."
    )


def page_facts(records: Sequence[Record], dataset: Dataset) -> tuple[Fact, ...]:
    """The lines of the page's head: data, photos, rules, programs."""
    first = records[0]
    made = [record.environment for record in records if record.environment]
    times = sorted(record.created_utc for record in records if record.created_utc)
    commits = _listed((each.commit or "")[:12] for each in made)
    facts = (
        Fact("Dataset", f"{dataset.title} ({first.dataset})"),
        Fact("Licence of the scans", dataset.licence),
        Fact("Photos", _listed(record.recipe for record in records) or "made elsewhere"),
        Fact("Metric protocol", first.protocol.text),
        Fact("Lengths", f"1 m is one {first.length_unit} (scale rule '{first.scale_rule}')"),
        Fact("Program", f"mexecon-harness {_listed(each.harness for each in made)}"),
        Fact("Commit", commits),
        Fact("Machine", _listed(f"{each.system}, {each.cpus} CPUs" for each in made)),
        Fact("Evaluated (UTC)", " to ".join(dict.fromkeys((*times[:1], *times[-1:])))),
    )
    return tuple(fact for fact in facts if fact.text)


def opening_methods(
    tables: Sequence[Table], methods: Sequence[PageMethod], shown: Collection[str]
) -> tuple[str, ...]:
    """The best methods of the geometry table that were given no part of the answer.

    By the first column, on the subjects that all of its ranked rows have, if there are such
    subjects; where no method has numbers, the first ones that are shown.
    """
    fair = {
        method.info.name for method in methods if _ANSWERS.isdisjoint(method.info.privileges)
    } & set(shown)
    geometry = next((table for table in tables if table.name == "geometry"), None)
    ranked: list[tuple[float, str]] = []
    if geometry is not None:
        column = geometry.columns[0]
        for row in geometry.rows:
            if row.method in fair and column.id in row.cells:
                mean = geometry.common_mean(row, column)
                ranked.append((row.cells[column.id].value if mean is None else mean, row.method))
    best = [method for _, method in sorted(ranked)]
    rest = [method.info.name for method in methods if method.info.name in shown]
    return tuple(dict.fromkeys((*best, *rest)))[:_OPENING]


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"


def _listed(texts: Iterable[str]) -> str:
    """The different texts, sorted, with commas."""
    return ", ".join(sorted({text for text in texts if text}))

"""``harness train judge``: networks of normals side by side, on the same photos of subjects."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from harness.core.errors import DataError
from harness.core.files.atomic import read_json, write_json
from harness.core.files.hashing import content_hash, file_sha256
from harness.core.process.interrupts import in_threads
from harness.core.process.workers import run_worker
from harness.run.progress import Progress, counted
from harness.run.sources import Source
from normal_training.judging.judge_worker import JudgeJob
from normal_training.judging.photos import NormalsJudgement
from normal_training.sampling.samples import SampleSettings, samples_key

_WORKER = "normal_training.judging.judge_worker"
_PHOTOS = "photos"
#: Changes whenever a number does that ``samples.SAMPLES_VERSION`` does not cover.
_VERSION = 1


@dataclass(frozen=True, slots=True)
class JudgeRequest:
    """Which networks are judged on which subjects.

    Attributes:
        source: The subjects; none of them should have been trained on.
        networks: Files by name.
        settings: Number, size and seed of the photos of each subject.
        jobs: Subjects in parallel.
    """

    source: Source
    networks: Mapping[str, Path]
    settings: SampleSettings
    jobs: int = 1


@dataclass(frozen=True, slots=True)
class NetworkRow:
    """One network, or the body that all were given.

    Attributes:
        name: The network's, or ``body``.
        mean: Over the subjects.
        subjects: Each subject's mean over its photos.
    """

    name: str
    mean: NormalsJudgement
    subjects: Mapping[str, NormalsJudgement]

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values."""
        return {
            "name": self.name,
            "mean": self.mean.to_dict(),
            "subjects": {name: each.to_dict() for name, each in self.subjects.items()},
        }


def judged_networks(request: JudgeRequest, progress: Progress) -> list[NetworkRow]:
    """The body's row and one for each network; a subject that was measured before is not again.

    Raises:
        HarnessError: a subject cannot be made, or a network cannot work on its photos.
        DataError: no network, or a scan without texture or without an Anny body beside it.
        MissingPart: onnxruntime or a network's file is not there.
    """
    sums = {name: file_sha256(path) for name, path in request.networks.items()}
    progress.expect(_PHOTOS, len(request.source.subjects) * request.settings.views)

    def judge(subject: str) -> dict[str, NormalsJudgement]:
        source = request.source.only(subject)
        # A subject that has to be made has no key yet, or that of another one.
        waits = source.is_generated and not source.avatar_is_current(subject)
        found = None if waits else _stored(_file(source, subject, request.settings, sums))
        if found is None:
            job = JudgeJob(source, request.networks, request.settings)
            found = run_worker(_WORKER, job, progress=counted(progress, _PHOTOS))
            write_json(_file(source, subject, request.settings, sums), found)
        else:
            progress.done(_PHOTOS, request.settings.views)
        return {name: NormalsJudgement(**numbers) for name, numbers in found.items()}

    subjects = request.source.subjects
    rows = dict(zip(subjects, in_threads(judge, subjects, request.jobs), strict=True))
    names = list(next(iter(rows.values())))
    return [_row(name, {subject: row[name] for subject, row in rows.items()}) for name in names]


def _file(
    source: Source, subject: str, settings: SampleSettings, networks: Mapping[str, str]
) -> Path:
    """Where a subject's numbers are kept, by everything that decides them."""
    key = content_hash(
        {
            "version": _VERSION,
            "samples": samples_key(source.locate(subject), settings),
            "networks": networks,
        }
    )
    return source.workspace.root / "judged" / source.name / subject / f"{key}.json"


def _stored(path: Path) -> dict[str, dict[str, float]] | None:
    try:
        return read_json(path) if path.is_file() else None
    except DataError:
        # Damaged: measured again.
        return None


def _row(name: str, subjects: Mapping[str, NormalsJudgement]) -> NetworkRow:
    return NetworkRow(name, NormalsJudgement.mean(list(subjects.values())), subjects)


@dataclass(frozen=True, slots=True)
class _Column:
    title: str
    text: Callable[[NormalsJudgement], str]


_COLUMNS = (
    _Column("front (deg)", lambda each: f"{each.front_deg:.2f}"),
    _Column("back (deg)", lambda each: f"{each.back_deg:.2f}"),
    _Column("front below 11.25 deg (%)", lambda each: f"{100 * each.front_below_11_25:.1f}"),
    _Column("folds (deg)", lambda each: f"{each.folds_deg:.2f}"),
    _Column("of true folds (%)", lambda each: f"{100 * each.folds_share:.0f}"),
    _Column("correlation", lambda each: f"{each.fold_correlation:.2f}"),
    _Column("front with prints (deg)", lambda each: f"{each.printed_front_deg:.2f}"),
    _Column("more folds with prints (%)", lambda each: f"{100 * each.prints_gain:+.1f}"),
)


def to_markdown(rows: list[NetworkRow]) -> str:
    """The rows as a Markdown table, means over the subjects."""
    lines = [
        "| network | " + " | ".join(column.title for column in _COLUMNS) + " |",
        "| :--- |" + " ---: |" * len(_COLUMNS),
    ]
    lines += [
        f"| {row.name} | " + " | ".join(column.text(row.mean) for column in _COLUMNS) + " |"
        for row in rows
    ]
    return "\n".join(lines) + "\n"

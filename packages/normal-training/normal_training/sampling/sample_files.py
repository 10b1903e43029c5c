"""The files of training samples: made where they are missing; of subjects that train or judge."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from harness.core.errors import HarnessError, MissingPart, WriteError
from harness.core.files.atomic import exclusive_lock, remove_leftovers
from harness.core.process.interrupts import in_threads
from harness.core.process.workers import WorkerDied, run_worker
from harness.run.progress import Progress, counted
from harness.run.sources import Source
from normal_training.learning.sample_key import stored_key
from normal_training.sampling.sample_worker import SampleJob
from normal_training.sampling.samples import SampleSettings, samples_key

if TYPE_CHECKING:
    # PyTorch takes seconds to import; 'harness train --help' must not wait for it.
    from normal_training.learning.first_answers import FirstAnswers

_WORKER = "normal_training.sampling.sample_worker"
_SAMPLES, _ANSWERS = "samples", "first answers"


@dataclass(frozen=True, slots=True)
class SampleFiles:
    """Sample files by subject of one dataset: those that train and those that judge."""

    dataset: str
    training: Mapping[str, Path]
    judging: Mapping[str, Path]

    @classmethod
    def ensured(
        cls, source: Source, settings: SampleSettings, held_out: int, jobs: int, progress: Progress
    ) -> SampleFiles:
        """Those of a source, of which the last subjects judge.

        Raises:
            HarnessError: too few subjects could be made.
        """
        paths = ensure_samples(source, settings, jobs, progress)
        if len(paths) <= held_out:
            raise HarnessError(
                f"too few subjects of {source.name} are left to train on",
                expected=f"more than the {held_out} that are held out",
                got=", ".join(paths) or "none",
            )
        files = list(paths.items())
        return cls(source.name, dict(files[:-held_out]), dict(files[-held_out:]))


def with_first_answers(
    parts: tuple[SampleFiles, ...], answers: FirstAnswers, folder: Path, progress: Progress
) -> tuple[SampleFiles, ...]:
    """The same with a first network's answers in place of bodies, made unless they are there.

    Args:
        parts: The files with bodies.
        answers: Those of the first network.
        folder: Where these are kept, by network.
        progress: Told of each sample.
    """
    files = [path for part in parts for path in (*part.training.values(), *part.judging.values())]
    progress.expect(_ANSWERS, len(files))
    done = {}
    for path in files:
        done[path] = folder / answers.name / path.parent.name / path.name
        with exclusive_lock(done[path].with_suffix(".lock")):
            answers.write(path, done[path])
        progress.done(_ANSWERS, 1)

    def moved(paths: Mapping[str, Path]) -> dict[str, Path]:
        return {subject: done[path] for subject, path in paths.items()}

    return tuple(
        replace(part, training=moved(part.training), judging=moved(part.judging)) for part in parts
    )


def ensure_samples(
    source: Source, settings: SampleSettings, jobs: int, progress: Progress
) -> dict[str, Path]:
    """The sample files of a source's subjects, made unless they are there and current.

    A subject that cannot be made is left out, and a message names it: random clothes sometimes do
    not fit.

    Raises:
        MissingPart: what makes subjects is not installed.
        WriteError: the disk is full, or a right is missing.
        WorkerDied: the process that made one was killed or has a defect; who trains and who judges
            must not depend on that.
    """
    # Both networks' samples stay: the first one may be trained again.
    folder = source.workspace.root / "samples" / f"normals-{settings.side_px}" / source.name
    paths = {subject: folder / f"{subject}.npz" for subject in source.subjects}
    waiting = [
        subject for subject in paths if not _is_current(source, subject, settings, paths[subject])
    ]
    progress.expect(_SAMPLES, len(waiting) * settings.views)

    def make(subject: str) -> str:
        job = SampleJob(source.only(subject), settings, paths[subject])
        with exclusive_lock(folder / f".{subject}.lock"):
            if not _is_current(source, subject, settings, paths[subject]):
                remove_leftovers(paths[subject])
                try:
                    run_worker(_WORKER, job, progress=counted(progress, _SAMPLES))
                except (MissingPart, WriteError, WorkerDied):
                    raise
                except HarnessError as error:
                    return str(error)
        return ""

    failures = dict(zip(waiting, in_threads(make, waiting, jobs), strict=True))
    for subject, failure in failures.items():
        if failure:
            progress.say(f"{subject} is left out: {failure}")
    return {subject: path for subject, path in paths.items() if not failures.get(subject)}


def _is_current(source: Source, subject: str, settings: SampleSettings, path: Path) -> bool:
    if source.is_generated and not source.avatar_is_current(subject):
        return False
    key = stored_key(path)
    # Without one there is nothing to compare, and the scan need not be hashed.
    return bool(key) and key == samples_key(source.locate(subject), settings)

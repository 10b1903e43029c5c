"""``harness render``: photos of many subjects, each in its own child process."""

from dataclasses import dataclass, field
from pathlib import Path

from harness.core.artifacts import Capture
from harness.core.errors import HarnessError
from harness.core.process.interrupts import in_threads
from harness.core.process.threads import StepReport
from harness.core.process.workers import run_worker, worker_main
from harness.geometry.images import save_png
from harness.run.progress import CAMERAS, PHOTOS, PhotoSteps, Progress, Silent
from harness.run.sealed import Look, admit, announce
from harness.run.sources import Source
from harness.run.task import Answer, Executor, Local, Task


@dataclass(frozen=True, slots=True)
class CaptureJob:
    """What to make of one subject.

    Attributes:
        source: The dataset and the recipe, with this subject alone.
        only_scan: Whether the avatar is enough, without photos.
    """

    source: Source
    only_scan: bool = False


def handle(job: CaptureJob, report: StepReport) -> dict[str, object]:
    """Make what is missing; everything that the caller wants to know is on disk then."""
    for subject in job.source.subjects:
        if job.only_scan:
            job.source.make_avatar(subject)
        else:
            job.source.ensure_capture(subject, report)
    return {}


_WORKER = "harness.run.captures"


@dataclass(frozen=True, slots=True)
class CaptureOutcome:
    """How making one subject's photos or scan ended.

    Attributes:
        subject: Its id.
        state: ``made now``, ``cached`` or ``failed``.
        directory: The folder of the photos or the scan.
        proof: The renderer's proof that the cameras are exact, as in ``capture.json``.
        warnings: For instance views in which the frame cuts the subject.
        failure: Why it failed; empty after a success.
    """

    subject: str
    state: str
    directory: str
    proof: object = None
    warnings: tuple[str, ...] = field(default_factory=tuple)
    failure: str = ""

    def __str__(self) -> str:
        notes = "".join(f"\n    {note}" for note in (*self.warnings, self.failure) if note)
        return f"{self.subject}: {self.state:9} {self.directory}{notes}"


def photograph(
    source: Source, subject: str, progress: Progress, timeout_s: float | None = None
) -> Capture:
    """One subject's photos, made in a child process if they are not there or stale.

    Args:
        source: The dataset and the recipe of the subject.
        subject: Its id.
        progress: Notified of every view.
        timeout_s: How long making them may take; None is no limit.

    Raises:
        HarnessError: the avatar, the scan, the renderer or the proof of the cameras failed.
    """
    if source.is_imported:
        return source.imported(subject)
    if source.capture_state(subject)[0] != "cached":
        job = CaptureJob(source.only(subject))
        steps = PhotoSteps(progress, source.views_to_render, source.camera_steps)
        run_worker(_WORKER, job, progress=steps, timeout_s=timeout_s)
        steps.end()
    return Capture.load(source.capture_directory(subject))


def expect_photos(progress: Progress, source: Source, subjects: int) -> None:
    """Announce the photos of so many subjects, and what is done to find their cameras."""
    progress.expect(PHOTOS, subjects * source.views_to_render)
    progress.expect(CAMERAS, subjects * source.camera_steps)


def render_all(
    source: Source,
    jobs: int,
    progress: Progress,
    timeout_s: float | None = None,
    executor: Executor | None = None,
) -> list[CaptureOutcome]:
    """The photos of all subjects of a source; one that fails does not stop the others.

    Args:
        source: The subjects and their recipe.
        jobs: Subjects processed in parallel.
        progress: Notified of every view.
        timeout_s: How long one subject may take; None is no limit.
        executor: Where they are rendered; None is this machine.
    """
    source.root()
    require_avatars(source, executor)
    announce(source.manifest, source.name, progress)
    states = {subject: _state(source, subject) for subject in source.subjects}
    waiting = [subject for subject, state in states.items() if state != "cached"]
    expect_photos(progress, source, len(waiting))
    failures: dict[str, str] = {}

    def done(answer: Answer) -> None:
        failures[answer.task] = answer.lost or str(answer.value["failure"])
        # Where it is not this machine, nothing is heard of a task's views.
        if executor is not None:
            PhotoSteps(progress, source.views_to_render, source.camera_steps).end()

    handler = f"{__name__}:{photos_of.__name__}"
    tasks = [
        Task(each, handler, PhotosJob(source.only(each), timeout_s), each, renders=True)
        for each in waiting
    ]
    (executor or Local(jobs)).carry_out(tasks, progress, done)
    outcomes: list[CaptureOutcome] = []
    for subject, state in states.items():
        try:
            if failure := failures.get(subject):
                raise HarnessError(failure)
            capture = Capture.load(source.capture_directory(subject))
        except HarnessError as error:
            outcomes.append(CaptureOutcome(subject, "failed", "", failure=str(error)))
            continue
        how = "cached" if state == "cached" else "made now"
        proof, place = capture.provenance.get("proof"), str(capture.directory)
        outcomes.append(CaptureOutcome(subject, how, place, proof, capture.warnings))
    return outcomes


def require_avatars(source: Source, executor: Executor | None) -> None:
    """Nothing, if generated subjects that other machines are to photograph are there.

    How an avatar's mesh is decimated may depend on the number of threads, and tasks elsewhere have
    few. Avatars are therefore made where they always are.

    Raises:
        HarnessError: some are not.
    """
    if executor is None or not source.is_generated:
        return
    waiting = [subject for subject in source.subjects if not source.avatar_is_current(subject)]
    if waiting:
        raise HarnessError(
            f"{len(waiting)} of {len(source.subjects)} subjects of '{source.name}' are not made",
            got=", ".join(waiting[:5]),
            hint=f"Make them on this machine first: harness data make {source.name}",
        )


@dataclass(frozen=True, slots=True)
class PhotosJob:
    """Photos of a source's subject that are to be made somewhere."""

    source: Source
    timeout_s: float | None


def photos_of(job: PhotosJob, before: object, progress: Progress) -> dict[str, object]:
    """A task: a subject's photos are there, or the ``failure`` says why not."""
    del before
    try:
        for subject in job.source.subjects:
            photograph(job.source, subject, progress, job.timeout_s)
    except HarnessError as error:
        return {"failure": str(error)}
    return {"failure": ""}


def _state(source: Source, subject: str) -> str:
    try:
        return source.capture_state(subject)[0]
    except HarnessError:
        # The same error becomes this subject's own failure when its photos are made.
        return "missing"


def show_avatar(source: Source, path: Path, progress: Progress, reason: str = "") -> Path:
    """Write the contact sheet of a source's first subject, which is made if it does not exist.

    Raises:
        HarnessError: the dataset is not one that is generated, or it is sealed and there is no
            reason to look at it.
    """
    look = Look("contact sheet", source.name, source.subjects[:1], reason)
    admit(source.manifest, source.workspace, look, progress)
    outcome = make_avatars(source, 1, Silent())[0]
    if outcome.failure:
        raise HarnessError(outcome.failure)
    directory = source.avatar_directory(outcome.subject)
    save_png(path, source.generator.sheet(outcome.subject, directory))
    return path


def make_avatars(source: Source, jobs: int, progress: Progress) -> list[CaptureOutcome]:
    """The generated subjects of a source, made unless they are there.

    Raises:
        HarnessError: the dataset is not one that is generated.
    """
    if not source.is_generated:
        raise HarnessError(
            f"dataset '{source.name}' is not generated",
            hint=f"'harness data check {source.name}' shows where its files belong",
        )
    announce(source.manifest, source.name, progress)
    waiting = [subject for subject in source.subjects if not source.avatar_is_current(subject)]
    progress.expect("avatars", len(waiting))

    def one(subject: str) -> CaptureOutcome:
        directory = str(source.avatar_directory(subject))
        if subject not in waiting:
            return CaptureOutcome(subject, "cached", directory)
        try:
            run_worker(_WORKER, CaptureJob(source.only(subject), only_scan=True))
        except HarnessError as error:
            return CaptureOutcome(subject, "failed", directory, failure=str(error))
        finally:
            progress.done("avatars")
        return CaptureOutcome(subject, "made now", directory)

    return in_threads(one, source.subjects, jobs)


if __name__ == "__main__":
    worker_main(handle)

"""``harness train normals``: subjects to samples, samples to a network, the network to a file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from harness.core.array_files.npz import read_array_npz
from harness.core.errors import DataError, HarnessError
from harness.core.files.atomic import exclusive_lock, remove_leftovers
from harness.core.process.interrupts import in_threads
from harness.core.process.workers import run_worker
from harness.data.avatars import AVATARS_VERSION
from harness.pipeline.inputs.sealed import refuse
from harness.pipeline.inputs.sources import Source
from harness.pipeline.progress import Progress, counted
from harness.pipeline.training.sample_worker import SampleJob
from harness.pipeline.training.samples import SampleSettings, samples_key
from methods.normals.training.settings import TrainingSettings

__all__ = ["TrainingRequest", "TrainingResult", "ensure_samples", "train_normals"]

_WORKER = "harness.pipeline.training.sample_worker"
_SAMPLES, _STEPS = "samples", "steps"


@dataclass(frozen=True, slots=True)
class TrainingRequest:
    """What a network is trained on and how.

    Attributes:
        source: Training subjects; the recipe does not matter.
        samples: Which samples of each.
        training: How the network is trained.
        directory: Where checkpoint, curve and network are written.
        held_out: How many of the subjects, the last ones, only judge the network.
        jobs: Subjects that are sampled in parallel.
    """

    source: Source
    samples: SampleSettings
    training: TrainingSettings
    directory: Path
    held_out: int
    jobs: int


@dataclass(frozen=True, slots=True)
class TrainingResult:
    """The network's file and its errors on the held-out subjects, degrees."""

    network: Path
    curve: Path
    front_deg: float
    back_deg: float
    body_front_deg: float
    body_back_deg: float

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values."""
        return {name: str(v) if isinstance(v, Path) else v for name, v in asdict(self).items()}


def train_normals(request: TrainingRequest, progress: Progress) -> TrainingResult:
    """Train a network on the samples of a source, continuing where an earlier call stopped.

    Raises:
        HarnessError: too few subjects, sealed subjects, or test subjects among them.
        MissingPart: PyTorch or onnx is not installed.
    """
    # PyTorch takes seconds to import; 'harness train --help' must not wait for it.
    import torch

    from methods.normals.training.export import export_network
    from methods.normals.training.loop import judged, train
    from methods.normals.training.network import Mirrored
    from methods.normals.training.samples import Samples

    refuse(request.source.manifest, request.source.name, "training")
    subjects = request.source.subjects
    if not 0 < request.held_out < len(subjects):
        raise HarnessError(
            f"cannot hold out {request.held_out} of {len(subjects)} subjects",
            expected="at least one to train on and one held out",
        )
    paths = ensure_samples(request.source, request.samples, request.jobs, progress)
    if len(paths) <= request.held_out:
        raise HarnessError(
            "too few subjects are left to train on",
            expected=f"more than the {request.held_out} that are held out",
            got=", ".join(paths) or "none",
        )
    chosen, files = list(paths), list(paths.values())
    training, judging = files[: -request.held_out], files[-request.held_out :]
    progress.expect(_STEPS, request.training.steps)
    judges = Samples.load(judging)
    trained = train(
        Samples.load(training),
        judges,
        request.training,
        request.directory,
        lambda steps, line: _report(progress, steps, line),
    )
    network, path = Mirrored(trained.network.cpu()), request.directory / "open-normals.onnx"
    export_network(network, path, _about(request, chosen[: -request.held_out]))
    angles = asdict(judged(network, judges, torch.device("cpu")))
    return TrainingResult(network=path, curve=trained.curve, **angles)


def ensure_samples(
    source: Source, settings: SampleSettings, jobs: int, progress: Progress
) -> dict[str, Path]:
    """The sample files of a source's subjects, made unless they are there and current.

    A subject that cannot be made is left out, and a message names it: random clothes sometimes do
    not fit.
    """
    folder = source.workspace.root / "samples" / "normals" / source.name
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
                    run_worker(_WORKER, job.to_dict(), progress=counted(progress, _SAMPLES))
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
    try:
        found = read_array_npz(path, ["key"])
    except DataError:
        # Absent or damaged: made again.
        return False
    return "key" in found and str(found["key"]) == samples_key(source.locate(subject), settings)


def _report(progress: Progress, steps: int, line: str) -> None:
    progress.done(_STEPS, steps)
    if line:
        progress.say(line)


def _about(request: TrainingRequest, subjects: Sequence[str]) -> dict[str, str]:
    """The metadata of the network's file."""
    source = request.source
    dataset = source.manifest.datasets[source.name]
    version = f", version {AVATARS_VERSION}" if source.is_generated else ""
    return {
        "name": "open-normals",
        "licence": "Apache-2.0",
        "training_set": f"{source.name} {_named(subjects, dataset.subjects)}{version}",
        "training_set_licence": dataset.licence,
        "window": "mask",
    }


def _named(subjects: Sequence[str], known: Sequence[str]) -> str:
    """``t00001..t00004`` or, with one of them missing, ``t00001..t00004 without t00003``."""
    inside = [name for name in known if subjects[0] <= name <= subjects[-1]]
    missing = [name for name in inside if name not in subjects]
    span = subjects[0] if len(subjects) == 1 else f"{subjects[0]}..{subjects[-1]}"
    return f"{span} without {', '.join(missing)}" if missing else span

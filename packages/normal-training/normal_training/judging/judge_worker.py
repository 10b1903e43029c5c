"""Runs in a child process: networks on the photos of one subject."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from harness.core.files.hashing import derive_seed
from harness.core.process.threads import StepReport
from harness.core.process.workers import worker_main
from harness.core.protocols import NormalEstimator
from harness.run.sources import Source
from methods.normals import installed
from methods.normals.estimators import BodyNormals
from normal_training.judging.photos import BODY, NormalsJudgement, judged_pair
from normal_training.sampling.samples import SampleSettings, Studio


@dataclass(frozen=True, slots=True)
class JudgeJob:
    """Which networks to judge on one subject.

    Attributes:
        source: The dataset, with this subject alone.
        networks: Files by name.
        settings: Number, size and seed of the photos.
    """

    source: Source
    networks: Mapping[str, Path]
    settings: SampleSettings


def handle(job: JudgeJob, report: StepReport) -> dict[str, object]:
    """Make the subject, if it is generated and not there, and judge the networks on it."""
    (subject,) = job.source.subjects
    if job.source.is_generated:
        job.source.make_avatar(subject)
    scan, mesh = job.source.load(subject)
    studio, settings = Studio(scan, mesh, job.settings.seed), job.settings
    # Each at the size that it asks for: the scenes are the same.
    estimators: dict[SampleSettings, dict[str, NormalEstimator]] = {settings: {BODY: BodyNormals()}}
    for name, path in job.networks.items():
        network = installed.loaded(path)
        size = settings.seen_at(network.side_px) if network.side_px else settings
        estimators.setdefault(size, {})[name] = network
    found: dict[str, list[NormalsJudgement]] = {name: [] for name in (BODY, *job.networks)}
    for view in range(settings.views):
        seed = derive_seed(settings.seed, "judge", scan.subject, view)
        for size, some in estimators.items():
            pair = studio.pair(size, seed)
            for name, estimator in some.items():
                found[name].append(judged_pair(pair, estimator))
        report(view + 1, settings.views)
    return {name: NormalsJudgement.mean(each).to_dict() for name, each in found.items()}


if __name__ == "__main__":
    worker_main(handle)

"""Runs in a child process: one method on the photos of one trial."""

from __future__ import annotations

import contextlib
import tempfile
import time
from pathlib import Path

import psutil

from harness.core.artifacts import Capture
from harness.core.errors import HarnessError, MethodError
from harness.core.formats.mesh_files import save_mesh
from harness.core.mesh import Mesh
from harness.core.process.steps import StepReport
from harness.core.process.workers import worker_main
from harness.core.protocols import Context
from harness.pipeline.conformance.trial import Trial, TrialResult
from harness.pipeline.inputs.view_choice import views_for
from harness.pipeline.run.cell import lent_to
from harness.pipeline.work.cost import StageMeter


def handle(trial: Trial, report: StepReport) -> TrialResult:  # noqa: ARG001
    """Reconstruct; a ``TrialResult`` with the method's own failures in it.

    Raises:
        HarnessError: photos or scan cannot be read, or the mesh cannot be written.
    """
    chosen = trial.method.found(trial.source.workspace)
    info = chosen.info
    capture = views_for(info, Capture.load(trial.capture)).capture
    _, truth = trial.source.load(trial.source.subjects[0])
    lent = lent_to(info, capture, truth)
    meter = StageMeter()
    before_s = time.time() - psutil.Process().create_time()
    start = time.perf_counter()
    try:
        with tempfile.TemporaryDirectory(prefix="harness-work-") as workdir:
            context = Context(trial.seed, Path(workdir), lambda _: contextlib.nullcontext(), lent)
            with meter.stage("whole"):
                mesh = chosen.method.reconstruct(capture, context).mesh
        if not isinstance(mesh, Mesh):
            raise MethodError("the method returned no mesh", got=type(mesh).__name__)
    except HarnessError as error:
        return TrialResult(str(error), before_s=before_s)
    wall_s = time.perf_counter() - start
    path = trial.folder / "mesh.ply"
    save_mesh(path, mesh.geometry())
    peak = max(stage.peak_rss_mib for stage in meter.stages)
    return TrialResult("", str(path), before_s, wall_s, peak)


if __name__ == "__main__":
    worker_main(handle)

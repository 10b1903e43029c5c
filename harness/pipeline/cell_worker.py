"""Runs in a child process: one method on one subject, scored, with what it cost."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from harness.core.artifacts import Body, Capture, Reconstruction, Scan
from harness.core.errors import MethodError
from harness.core.files import atomic_directory, atomic_path
from harness.core.hashing import derive_seed
from harness.core.mesh import Mesh
from harness.core.mesh_files import save_mesh
from harness.core.privileges import Privilege
from harness.core.protocols import Context, Method
from harness.core.settings import MetricProtocol
from harness.core.workers import Progress, worker_main
from harness.pipeline.body_scoring import TrueBody, body_metrics
from harness.pipeline.cost import StageMeter
from harness.pipeline.normal_files import save_normals
from harness.pipeline.normal_scoring import normal_details
from harness.pipeline.oracle_normals import OracleNormals
from harness.pipeline.plan import resolve_method
from harness.pipeline.region_scoring import scored
from harness.pipeline.sources import Source

__all__ = ["handle"]


def handle(job: dict[str, object], progress: Progress) -> dict[str, object]:  # noqa: ARG001
    """Reconstruct and score; the parts of the record that only the run itself can know."""
    subject = str(job["subject"])
    source = Source.from_job(job["source"], subject)  # type: ignore[arg-type]
    method = resolve_method(str(job["method"]), dict(job["settings"]))  # type: ignore[call-overload]
    protocol = source.manifest.protocol(str(job["protocol"]))
    capture = source.capture(subject)
    scan, truth = source.load(subject)
    cell = Path(str(job["cell"]))
    meter = StageMeter()
    with _workdir(cell, keep=bool(job["keep"])) as workdir:
        context = Context(
            seed=derive_seed(int(job["seed"]), method.info.name, subject),  # type: ignore[call-overload]
            workdir=workdir,
            stage=meter.stage,
            privileged=_privileged(method, capture, truth),
            keep=bool(job["keep"]),
        )
        result = method.reconstruct(capture, context)
    save_mesh(cell / "mesh.ply", result.mesh)
    told = _told(result, (scan, truth), protocol, meter)
    if result.body:
        _save_body(cell / "body.npz", result.body)
        found = body_metrics(result.body, capture, truth, TrueBody.of(scan))
        told["metrics"] |= {name: value.to_dict() for name, value in found.items()}
    if result.normals:
        save_normals(cell / "normals.npz", result.normals)
        told["details"] |= normal_details(result.normals, scan, truth)
    return told


@contextlib.contextmanager
def _workdir(cell: Path, *, keep: bool) -> Iterator[Path]:
    """A fresh folder for intermediate results: the cell's own ``work``, or one that goes away."""
    if keep:
        with atomic_directory(cell / "work") as workdir:
            yield workdir
    else:
        with tempfile.TemporaryDirectory(prefix="harness-work-") as name:
            yield Path(name)


def _privileged(method: Method, capture: Capture, truth: Mesh) -> dict[str, object]:
    """What the method's declared privileges entitle it to, and nothing else."""
    lent: dict[str, object] = {}
    if Privilege.GROUND_TRUTH_MESH in method.info.privileges:
        lent[Privilege.GROUND_TRUTH_MESH] = truth.geometry()
    if Privilege.SUBJECT_CENTRE in method.info.privileges:
        lent[Privilege.SUBJECT_CENTRE] = truth.bounds.mean(axis=0)
    if Privilege.ORACLE_NORMALS in method.info.privileges:
        views = method.info.views or range(len(capture.cameras))
        lent[Privilege.ORACLE_NORMALS] = OracleNormals(
            truth, [capture.cameras[view] for view in views]
        )
    return lent


def _told(
    result: Reconstruction, scanned: tuple[Scan, Mesh], protocol: MetricProtocol, meter: StageMeter
) -> dict[str, Any]:
    if not isinstance(result.mesh, Mesh):
        raise MethodError("the method returned no mesh", got=type(result.mesh).__name__)
    costs = [
        {
            "name": stage.name,
            "wall_s": stage.wall_s,
            "peak_rss_mib": stage.peak_rss_mib,
            "peak_gpu_mib": stage.peak_gpu_mib,
        }
        for stage in meter.stages
    ]
    # As it is filed: without texture coordinates, whose seams could split its normals. And however
    # large or far away: it is what the method made.
    outcome, details = scored(result.mesh.geometry(), *scanned, protocol, misplaced="tell")
    return {
        "metrics": {name: value.to_dict() for name, value in outcome.metrics.items()},
        "stages": costs,
        "details": {**dict(result.details), **details},
    }


def _save_body(path: Path, body: Body) -> None:
    with atomic_path(path) as temporary:
        np.savez_compressed(
            temporary,
            model=body.model,
            vertices=body.vertices,
            joints=body.joints,
            faces=body.faces,
            **{f"parameter_{name}": value for name, value in body.parameters.items()},
        )


if __name__ == "__main__":
    worker_main(handle)

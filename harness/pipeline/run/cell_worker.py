"""Runs in a child process: one method on one subject, scored, with what it cost.

It is told what its record will be filed under, and tells at the end whether photos, scan and code
have been that all the time.
"""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from harness.core.artifacts import Body, Capture, Reconstruction, Scan
from harness.core.errors import HarnessError, MethodError, MissingPart
from harness.core.files.atomic import atomic_path
from harness.core.files.hashing import file_sha256
from harness.core.formats.mesh_files import save_mesh
from harness.core.mesh import Mesh
from harness.core.process.differences import listed_differences
from harness.core.process.workers import Progress, worker_main
from harness.core.protocols import Context, Method
from harness.core.settings import MetricProtocol
from harness.pipeline.inputs.sources import Source
from harness.pipeline.run.cell import Truth, lent_to, scores_of, seed_for
from harness.pipeline.run.cell_result import CellResult
from harness.pipeline.run.cost import StageMeter
from harness.pipeline.run.environment import environment
from harness.pipeline.run.normal_files import save_normals
from harness.pipeline.run.plan import method_module, resolve_method
from harness.pipeline.run.record_inputs import BODY_SCORING, NORMAL_SCORING, Inputs, evaluated

__all__ = ["handle"]


def handle(job: dict[str, Any], progress: Progress) -> dict[str, object]:  # noqa: ARG001
    """Reconstruct and score; a ``CellResult`` with the method's own failures in it.

    Raises:
        HarnessError: photos or scan cannot be read, or results cannot be written.
    """
    # Before anything else: the commit is that of the code which is about to be imported.
    made_with = environment()
    task = _Task.from_job(job)
    before = task.stamp()
    if changed := task.changed():
        return CellResult("changed", changed).to_dict()
    result = task.carried_out()
    changed = task.changed() or ("" if task.stamp() == before else "the photos were made anew")
    if changed:
        return CellResult("changed", changed).to_dict()
    return replace(result, environment=made_with).to_dict()


@dataclass(frozen=True, slots=True)
class _Task:
    """One cell, as planned.

    Attributes:
        source: With the one subject.
        name: The method's, in the catalogue.
        method: With its settings.
        protocol: Of the metrics.
        seed: Root seed of the run.
        planned: ``Inputs.to_dict()`` of the plan.
        key: Of the plan.
        folder: Receives mesh, body and normals.
        keep: Whether intermediate results stay.
    """

    source: Source
    name: str
    method: Method
    protocol: MetricProtocol
    seed: int
    planned: dict[str, Any]
    key: str
    folder: Path
    keep: bool

    @classmethod
    def from_job(cls, job: dict[str, Any]) -> _Task:
        source = Source.from_job(job["source"], str(job["subject"]))
        return cls(
            source=source,
            name=str(job["method"]),
            method=resolve_method(str(job["method"]), job["settings"]),
            protocol=source.manifest.protocol(str(job["protocol"])),
            seed=int(job["seed"]),
            planned=job["inputs"],
            key=str(job["key"]),
            folder=Path(job["folder"]),
            keep=bool(job["keep"]),
        )

    @property
    def subject(self) -> str:
        return self.source.subjects[0]

    def capture(self) -> Capture:
        return Capture.load(self.source.capture_directory(self.subject))

    def stamp(self) -> tuple[int, int]:
        """Another one after photos have been put in place anew, even if they are the same."""
        found = (self.source.capture_directory(self.subject) / "capture.json").stat()
        return found.st_ino, found.st_mtime_ns

    def changed(self) -> str:
        """What is not as planned now, in words; empty while all is."""
        try:
            capture = self.capture()
            damage = capture.damage()
            now = self._inputs(capture, self.source.locate(self.subject))
        except (HarnessError, OSError) as error:
            return str(error)
        if now.key == self.key:
            return damage
        return f"changed since it was planned: {listed_differences(self.planned, now.to_dict())}"

    def _inputs(self, capture: Capture, scan: Scan) -> Inputs:
        module = method_module(self.name)
        return evaluated(self.method.info, module, capture, scan, self.protocol, self.seed)

    def carried_out(self) -> CellResult:
        """The method's result, scored and written.

        Raises:
            HarnessError: photos or scan cannot be read, or results cannot be written.
        """
        capture = self.capture().from_front()
        truth = Truth.read(*self.source.load(self.subject))
        meter = StageMeter()
        try:
            result = self._reconstruction(capture, truth.mesh, meter)
            self._require_planned_scoring(result)
            scores = scores_of(result, capture, truth, self.protocol)
        except MissingPart as error:
            return CellResult("missing", str(error), by_method=False, stages=tuple(meter.stages))
        except HarnessError as error:
            return CellResult("failed", str(error), stages=tuple(meter.stages))
        return CellResult(
            "ok",
            metrics=scores.metrics,
            stages=tuple(meter.stages),
            details=scores.details,
            files=self._written(result),
        )

    def _reconstruction(self, capture: Capture, truth: Mesh, meter: StageMeter) -> Reconstruction:
        info = self.method.info
        with self._workdir() as workdir:
            context = Context(
                seed=seed_for(self.seed, info, self.subject),
                workdir=workdir,
                stage=meter.stage,
                privileged=lent_to(info, capture, truth),
                keep=self.keep,
            )
            return self.method.reconstruct(capture, context)

    @contextlib.contextmanager
    def _workdir(self) -> Iterator[Path]:
        """A fresh folder for intermediate results: one that stays, or one that goes away."""
        if self.keep:
            workdir = self.folder / "work"
            workdir.mkdir(parents=True)
            yield workdir
        else:
            with tempfile.TemporaryDirectory(prefix="harness-work-") as name:
                yield Path(name)

    def _require_planned_scoring(self, result: Reconstruction) -> None:
        """Refuse what the record's key does not count the scoring code of."""
        for name, scoring, there in (
            ("body", BODY_SCORING, result.body),
            ("normal", NORMAL_SCORING, result.normals),
        ):
            if there and scoring not in self.planned["code"]:
                raise MethodError(
                    f"the method handed out what its code does not name: a {name}",
                    expected="'Body' or 'NormalMaps', imported by name from harness.core.artifacts",
                )

    def _written(self, result: Reconstruction) -> dict[str, str]:
        """The sha256 of the results' files, by name."""
        save_mesh(self.folder / "mesh.ply", result.mesh)
        if result.body:
            _save_body(self.folder / "body.npz", result.body)
        if result.normals:
            save_normals(self.folder / "normals.npz", result.normals)
        files = sorted(path for path in self.folder.iterdir() if path.is_file())
        return {path.name: file_sha256(path) for path in files}


def _save_body(path: Path, body: Body) -> None:
    with atomic_path(path) as temporary:
        np.savez_compressed(temporary, **body.to_arrays())


if __name__ == "__main__":
    worker_main(handle)

"""Runs in a child process: one method on one subject, scored, with what it cost.

The job says what the record will be filed under, and the result says whether photos, scan and code
were the same from the beginning to the end. Work that methods share is made once a workspace, filed
under a key of everything that decides it: its inputs, the code that makes it and the packages that
this code imports. Whoever is handed it is charged what it cost to make.
"""

import contextlib
import functools
import json
import re
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from harness.core.artifacts import Capture, Reconstruction, Scan, StageCost
from harness.core.errors import (
    DataError,
    HarnessError,
    Killed,
    MethodError,
    MissingPart,
    WriteError,
)
from harness.core.files.atomic import exclusive_lock, remove_leftovers
from harness.core.files.hashing import content_hash, file_sha256
from harness.core.files.npz import read_array_npz, write_npz
from harness.core.process.shared_work import Sharing, Work, alone
from harness.core.process.source_digest import SourceDigest, SourceTree, listed_differences
from harness.core.process.threads import StepReport
from harness.core.process.workers import worker_main
from harness.core.protocols import Context, MethodInfo, Privilege
from harness.core.records import Scores
from harness.core.settings import MetricProtocol
from harness.core.typed_json import from_json, to_json
from harness.files.mesh_files import save_mesh
from harness.run.cell import Truth, lent_to, scores_of, seed_for
from harness.run.cell_job import CellJob, CellResult
from harness.run.cost import StageMeter
from harness.run.method_choice import ChosenMethod
from harness.run.publication import BODY_FILE, MESH_FILE, NORMALS_FILE, save_body, save_normals
from harness.run.record_inputs import Inputs, environment, evaluated, method_code
from harness.run.uncalibrated import brought, own_world, with_cameras
from harness.run.view_choice import as_given, views_for
from methods.points.surfacing import reconstructed

T = TypeVar("T")

_COST = "shared_cost"


@dataclass(frozen=True, slots=True)
class _Cost:
    """What work cost when it was made, by stage."""

    stages: tuple[StageCost, ...]


@dataclass(slots=True)
class SharedResults:
    """Hands out work that was made before, and keeps what is made.

    Attributes:
        folder: Where it is kept.
        meter: Is charged with the cost of what is handed out.
        is_current: Whether code and inputs are still those that the process began with; nothing is
            kept otherwise, because it could be filed under a key that is not its own.
        taken: Names of what was handed out, in order.
    """

    folder: Path
    meter: StageMeter
    is_current: Callable[[], bool]
    taken: list[str] = field(default_factory=list[str])

    def __call__(self, work: Work[T]) -> T:
        """The outcome of some work; the same, to the bit, whether it was made now or before.

        A file that cannot be read is made anew.

        Raises:
            HarnessError: what making it raises; nothing is kept then.
        """
        key = _key(work)
        path = self.folder / re.sub(r"\W+", "-", work.name) / f"{key}.npz"
        # Who waits while another makes it is charged what it cost, and not for the waiting, too.
        with self.meter.waiting_for(exclusive_lock(path.with_suffix(".lock"))):
            remove_leftovers(path)
            if path.is_file():
                try:
                    value, cost = _read(path, work)
                except DataError:
                    path.unlink()
                else:
                    self.meter.add(cost.stages)
                    self.taken.append(work.name)
                    return value
            return self._made(work, path)

    def _made(self, work: Work[T], path: Path) -> T:
        with self.meter.watched(work.name) as stages:
            value = work.make()
        if self.is_current():
            self._keep(value, work, path, stages)
        return value

    def _keep(self, value: T, work: Work[T], path: Path, stages: Sequence[StageCost]) -> None:
        cost = json.dumps(to_json(_Cost(tuple(stages))))
        arrays = {**work.packed(value), _COST: np.frombuffer(cost.encode(), dtype=np.uint8)}
        write_npz(path, arrays, compressed=False)


def _key(work: Work[T]) -> str:
    code = _code(work.module)
    return content_hash(
        {
            "work": work.name,
            "inputs": dict(work.inputs),
            "code": dict(code.modules),
            "packages": dict(code.packages),
        }
    )


@functools.lru_cache(maxsize=8)
def _code(module: str) -> SourceDigest:
    """Asked once a process, which runs the code that it has imported."""
    return SourceTree.installed(module).digest([module], [])


def _read(path: Path, work: Work[T]) -> tuple[T, _Cost]:
    arrays = read_array_npz(path)
    try:
        document = json.loads(arrays[_COST].tobytes())
        value = work.unpacked(arrays)
    except (KeyError, ValueError) as error:
        raise DataError(f"{path} is not a stored {work.name}", got=str(error)) from error
    return value, from_json(_Cost, document, path, "the cost of shared work")


#: What only a scan can lend.
_OF_THE_SCAN = (Privilege.GROUND_TRUTH_MESH, Privilege.SUBJECT_CENTRE, Privilege.ORACLE_NORMALS)


def handle(job: CellJob, report: StepReport) -> CellResult:  # noqa: ARG001
    """Reconstruct and score; a ``CellResult`` with the method's own failures in it.

    Raises:
        HarnessError: photos or scan cannot be read, or results cannot be written.
    """
    # Before anything else: the commit is that of the code which is about to be imported.
    made_with = environment()
    source = job.source
    method = job.method.found(source.workspace)
    task = _Task(job, method, source.manifest.protocol(job.protocol))
    before = task.stamp()
    if changed := task.changed():
        return CellResult("changed", changed)
    result = task.carried_out()
    changed = task.changed() or ("" if task.stamp() == before else "the photos were made anew")
    if changed:
        return CellResult("changed", changed)
    return replace(result, environment=made_with)


@dataclass(frozen=True, slots=True)
class _Task:
    """A job, with what has to be asked of it more than once."""

    job: CellJob
    method: ChosenMethod
    protocol: MetricProtocol

    @property
    def _capture_directory(self) -> Path:
        return self.job.source.capture_directory(self.job.subject)

    def _capture(self) -> Capture:
        return Capture.load(self._capture_directory)

    def stamp(self) -> tuple[int, int]:
        """Differs after photos have been put in place again, even if they are the same."""
        found = (self._capture_directory / "capture.json").stat()
        return found.st_ino, found.st_mtime_ns

    def changed(self) -> str:
        """What is not as planned now, in words; empty while all is."""
        try:
            capture = self._capture()
            damage = capture.damage()
            now = self._inputs(capture, self.job.source.scan_of(self.job.subject))
        except (HarnessError, OSError) as error:
            return str(error)
        planned = self.job.inputs
        if now.key == planned.key:
            return damage
        found = listed_differences(planned.to_dict(), now.to_dict())
        return f"changed since it was planned: {found}"

    def _inputs(self, capture: Capture, scan: Scan | None) -> Inputs:
        method, seed = self.method, self.job.seed
        info = as_given(method.info, capture)
        code = method_code(method.module, info.privileges)
        return evaluated(info, code, capture, scan, self.protocol, seed)

    def carried_out(self) -> CellResult:
        """The method's result, written, and scored where there is a scan.

        Raises:
            HarnessError: photos or scan cannot be read, or results cannot be written.
        """
        source, meter = self.job.source, StageMeter()
        truth = None if source.is_imported else Truth.read(*source.load(self.job.subject))
        scores, moved = Scores(), dict[str, object]()
        try:
            share = self._sharing(meter)
            capture = self._capture()
            own = own_world(capture)
            chosen = views_for(self.method.info, own)
            lends = None if own is not capture else truth
            result = self._reconstruction(chosen.capture, lends, meter, share)
            self._require_planned_scoring(result)
            if truth is not None:
                # Scoring is no cost of the method's.
                others = self._sharing(StageMeter())
                # On all photos, whichever of them the method was given.
                every = capture.from_front()
                result, moved = brought(result, capture, truth.mesh)
                scores = scores_of(result, every, truth, self.protocol, others)
                scores = with_cameras(scores, self.method.info, result, capture, truth.mesh)
        except MissingPart as error:
            return CellResult("missing", str(error), by_method=False, stages=tuple(meter.stages))
        except (Killed, WriteError) as error:
            # Neither says anything of the method.
            return CellResult("failed", str(error), by_method=False, stages=tuple(meter.stages))
        except HarnessError as error:
            return CellResult("failed", str(error), stages=tuple(meter.stages))
        return CellResult(
            "ok",
            scores=scores,
            stages=tuple(meter.stages),
            shared_work=_taken_over(share),
            details={**result.details, **chosen.details, **moved},
            files=self._written(result),
        )

    def _sharing(self, meter: StageMeter) -> Sharing:
        folder = self.job.source.workspace.shared
        if not self.job.share:
            return alone
        return SharedResults(folder, meter, is_current=lambda: not self.changed())

    def _reconstruction(
        self, capture: Capture, truth: Truth | None, meter: StageMeter, share: Sharing
    ) -> Reconstruction:
        info = self.method.info
        if truth is None:
            lent = _nothing_lent(info)
        else:
            lent = lent_to(as_given(info, self._capture()), capture, truth.mesh)
        with self._workdir() as workdir:
            context = Context(
                seed=seed_for(self.job.seed, self.job.method.name, self.job.subject),
                workdir=workdir,
                stage=meter.stage,
                privileged=lent,
                keep=self.job.keep,
                share=share,
            )
            return reconstructed(self.method.method, capture, context)

    @contextlib.contextmanager
    def _workdir(self) -> Iterator[Path]:
        """A fresh folder for intermediate results: one that stays, or one that goes away."""
        if self.job.keep:
            workdir = self.job.folder / "work"
            workdir.mkdir(parents=True)
            yield workdir
        else:
            with tempfile.TemporaryDirectory(prefix="harness-work-") as name:
                yield Path(name)

    def _require_planned_scoring(self, result: Reconstruction) -> None:
        """Refuse results whose scoring code the record's key does not count."""
        planned = self.job.inputs
        uncounted: list[str] = []
        if result.body and not planned.counts_body_scoring:
            uncounted.append("a body")
        if result.normals and not planned.counts_normal_scoring:
            uncounted.append("normal maps")
        if "surface" in result.details and not planned.counts_surfacing:
            uncounted.append("points")
        if uncounted:
            raise MethodError(
                f"the method returned {' and '.join(uncounted)}, which its code does not name",
                expected="'Body', 'NormalMaps', 'DepthMaps', 'PointCloud' or 'Gaussians' by name",
                hint="Import the name in the method's own module",
            )

    def _written(self, result: Reconstruction) -> dict[str, str]:
        """The sha256 of the results' files, by name."""
        folder = self.job.folder
        save_mesh(folder / MESH_FILE, result.mesh)
        if result.body:
            save_body(folder / BODY_FILE, result.body)
        if result.normals:
            save_normals(folder / NORMALS_FILE, result.normals)
        files = sorted(path for path in folder.iterdir() if path.is_file())
        return {path.name: file_sha256(path) for path in files}


def _taken_over(share: Sharing) -> tuple[str, ...]:
    """Which work was taken over, each kind once."""
    return tuple(dict.fromkeys(share.taken)) if isinstance(share, SharedResults) else ()


def _nothing_lent(method: MethodInfo) -> dict[str, object]:
    """What a method is lent where there is no scan, or one in another world: nothing.

    Raises:
        MethodError: it cannot do without.
    """
    needed = [privilege.label for privilege in method.privileges if privilege in _OF_THE_SCAN]
    if needed:
        raise MethodError(
            f"method '{method.name}' is given the {' and '.join(needed)} of a scan",
            got="photos in a world of their own: imported, or with estimated cameras",
            hint="Run a method that sees photos alone",
        )
    return {}


if __name__ == "__main__":
    worker_main(handle)

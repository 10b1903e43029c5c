"""``harness conform``: a method is tried on one subject, several times, and asked every question.

A good method needs three trials: one as it is; one with another name, another folder, without the
photos that it does not declare, and with another seed where it says that seeds change nothing,
which has to give the same mesh; and one that is killed. Where the second gives another mesh, each
of its changes is tried alone.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import signal
import tempfile
import time
import uuid
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from harness.board.conform_trial import (
    CHECKS,
    OF_THE_FRAME,
    Answer,
    Certificate,
    Check,
    Trial,
    TrialResult,
    frame_checks,
)
from harness.core.artifacts import Capture
from harness.core.errors import HarnessError
from harness.core.files.atomic import write_json
from harness.core.files.hashing import content_hash, file_sha256
from harness.core.process.workers import WorkerDied, run_worker
from harness.core.protocols import MethodInfo, Privilege
from harness.core.typed_json import from_json
from harness.files.mesh_files import load_mesh
from harness.report.seeds import is_deterministic
from harness.run.captures import photograph
from harness.run.method_choice import ChosenMethod
from harness.run.progress import Progress
from harness.run.record_inputs import environment, method_code, utc_now
from harness.run.sources import Source
from harness.run.view_choice import views_for

#: An environment variable that a trial's worker starts with, by which its processes are found:
#: what it forks has it too, also before it runs another program.
MARK = "CONFORM_TRIAL"

#: How long a process may take to end after the one that started it.
_PATIENCE_S = 5.0
_POLL_S = 0.1
_PROC = Path("/proc")


def left_behind(mark: str) -> tuple[int, ...] | None:
    """The process ids with a mark, once they had time to end; None where nobody can say."""
    if not (_PROC / "self" / "environ").is_file():
        return None
    end = time.monotonic() + _PATIENCE_S
    while (found := _marked(mark)) and time.monotonic() < end:
        time.sleep(_POLL_S)
    return found


def ended(processes: tuple[int, ...]) -> None:
    """End processes of a trial that did not end with it."""
    for process in processes:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.kill(process, signal.SIGKILL)


def _marked(mark: str) -> tuple[int, ...]:
    wanted = f"{MARK}={mark}".encode()
    found: list[int] = []
    for entry in _PROC.glob("[0-9]*"):
        with contextlib.suppress(OSError):
            if wanted in (entry / "environ").read_bytes().split(b"\0") and not _is_dead(entry):
                found.append(int(entry.name))
    return tuple(sorted(found))


def _is_dead(entry: Path) -> bool:
    return (entry / "stat").read_text().rpartition(")")[2].split()[0] == "Z"


_WORKER = "harness.board.conform_trial"
_TRIALS = "trials"
#: Surfaces this near everywhere are the same: the order of floating-point sums may differ.
_SAME_MM = 0.05


@dataclass(frozen=True, slots=True)
class ConformRequest:
    """What ``harness conform`` was asked for.

    Attributes:
        source: The dataset, with one subject.
        method: The method with its settings.
        seed: The seed of the trials.
        timeout_s: Longest time for a trial; None is no limit.
        memory_mib: Most memory for a trial; None is no limit.
    """

    source: Source
    method: ChosenMethod
    seed: int = 0
    timeout_s: float | None = 3600.0
    memory_mib: float | None = None

    @property
    def subject(self) -> str:
        """The subject's id."""
        return self.source.subjects[0]


def conform(request: ConformRequest, progress: Progress) -> Certificate:
    """The verdict on a method; what it does wrong is in there, and raises nothing.

    Raises:
        HarnessError: there are no photos, or there is no scan.
    """
    capture = photograph(request.source, request.subject, progress, request.timeout_s)
    with tempfile.TemporaryDirectory(prefix="harness-conform-") as name:
        run = _Run(request, capture, Path(name), progress)
        run.all_questions()
    info = request.method.info
    return Certificate(
        method=info.name,
        title=info.title,
        checks=tuple(run.found.get(each) or Check(each, "not asked", "there was no mesh")
                     for each in CHECKS),
        identity=info.identity(),
        environment_sha256=_environment_sha256(request.method, info),
        dataset=request.source.name,
        subject=request.subject,
        recipe=request.source.recipe_name,
        photos=capture.key,
        seed=request.seed,
        harness=environment(),
        created_utc=utc_now(),
    )  # fmt: skip


def _environment_sha256(method: ChosenMethod, info: MethodInfo) -> str:
    code = method_code(method.module, info.privileges).to_dict()
    return content_hash({"identity": info.identity(), **code})


@dataclass(slots=True)
class _Changes:
    """How the photos and the call of a trial differ from the plain ones."""

    renamed: bool = False
    spoilt: bool = False
    seed: int | None = None


@dataclass(slots=True)
class _Run:
    """The trials of one method, and what was found so far."""

    request: ConformRequest
    capture: Capture
    place: Path
    progress: Progress
    found: dict[str, Check] = field(default_factory=dict[str, Check])
    left: dict[str, int] = field(default_factory=dict[str, int])
    can_look: bool = True

    def all_questions(self) -> None:
        """Ask everything that can be asked."""
        info = self.request.method.info
        self._say("environment", "yes", _environment_text(info))
        self.progress.expect(_TRIALS, 3)
        plain = self._tried("plain", _Changes())
        if isinstance(plain, str):
            self._say("runs", "no", plain)
            self._say_left()
            return
        self._say("runs", "yes", f"in {plain.wall_s:.1f} s")
        self._cost(plain)
        truth = self.request.source.load(self.request.subject)[1]
        is_scan = Privilege.GROUND_TRUTH_MESH in info.privileges
        checks = frame_checks(load_mesh(Path(plain.mesh)), truth, is_scan=is_scan)
        if Privilege.OWN_FRAME in info.privileges:
            frame = "it answers in a frame of its own"
            checks = [
                Check(each.id, "not asked", frame) if each.id in OF_THE_FRAME else each
                for each in checks
            ]
        self.found.update({check.id: check for check in checks})
        self._same(plain, info)
        self._killed(plain)
        self._say_left()

    def _say(self, name: str, answer: Answer, text: str) -> None:
        self.found[name] = Check(name, answer, text)

    def _cost(self, plain: TrialResult) -> None:
        most = self.request.memory_mib
        fits = most is None or plain.peak_rss_mib <= most
        allowed = "" if most is None else f", {most:.0f} MiB allowed"
        text = f"{plain.wall_s:.1f} s, {plain.peak_rss_mib:.0f} MiB{allowed}"
        self._say("cost", "yes" if fits else "no", text)

    def _tried(self, name: str, changes: _Changes) -> TrialResult | str:
        """A trial's result, or why there is no mesh."""
        try:
            result = self._carried_out(name, changes, self.request.timeout_s)
        except HarnessError as error:
            return str(error)
        return result.reason or result

    def _carried_out(self, name: str, changes: _Changes, timeout_s: float | None) -> TrialResult:
        trial, mark = self._trial(name, changes), uuid.uuid4().hex
        try:
            values = run_worker(_WORKER, trial, timeout_s=timeout_s, environment={MARK: mark})
            return from_json(TrialResult, values, "the worker's answer", "a trial's result")
        finally:
            self._look(name, mark)
            self.progress.done(_TRIALS)

    def _trial(self, name: str, changes: _Changes) -> Trial:
        request, folder = self.request, self.place / name
        (folder / "made").mkdir(parents=True)
        photos = self.capture.directory
        if changes.renamed or changes.spoilt:
            photos = _changed_photos(self.capture, folder, request.method.info, changes)
        seed = request.seed if changes.seed is None else changes.seed
        return Trial(
            source=request.source,
            method=request.method.ref,
            capture=photos,
            seed=seed,
            folder=folder / "made",
        )

    def _look(self, name: str, mark: str) -> None:
        """Look for processes that a trial left."""
        left = left_behind(mark)
        if left is None:
            self.can_look = False
        elif left:
            self.left[name] = len(left)
            ended(left)

    def _say_left(self) -> None:
        if not self.can_look:
            self._say(
                "leaves_nothing", "not asked", "this system does not tell whose processes run"
            )
        elif self.left:
            trials = ", ".join(f"{number} after the {name} trial"
                               for name, number in self.left.items())  # fmt: skip
            self._say("leaves_nothing", "no", f"processes stayed: {trials}")
        else:
            self._say("leaves_nothing", "yes", "none stayed")

    def _same(self, plain: TrialResult, info: MethodInfo) -> None:
        """The questions of what changes nothing."""
        deterministic = is_deterministic(self.request.method)
        seed = self.request.seed + 1 if deterministic else None
        spoils = bool(_undeclared(self.capture, info))
        asked = {
            "repeats": _Changes(),
            "deterministic": _Changes(seed=seed) if deterministic else None,
            "declared_views": _Changes(spoilt=True) if spoils else None,
            "renamed": _Changes(renamed=True),
        }
        why_not = {"deterministic": "it takes a seed", "declared_views": "it declares all photos"}
        together = self._difference("changed", plain, _Changes(True, spoils, seed))
        if together.holds:
            answers: dict[str, _Same] = dict.fromkeys(asked, together)
        else:
            self.progress.expect(_TRIALS, sum(changes is not None for changes in asked.values()))
            answers = {}
            for name, changes in asked.items():
                if changes is not None:
                    answers[name] = self._difference(name, plain, changes)
                # What does not repeat cannot be asked what changes it.
                if not answers["repeats"].holds:
                    break
        for name, changes in asked.items():
            if changes is None:
                self._say(name, "not asked", why_not[name])
            elif name not in answers:
                self._say(name, "not asked", "the same trial does not repeat")
            else:
                self._say(name, "yes" if answers[name].holds else "no", answers[name].text)

    def _difference(self, name: str, plain: TrialResult, changes: _Changes) -> _Same:
        other = self._tried(name, changes)
        return _Same(False, other) if isinstance(other, str) else _compared(plain, other)

    def _killed(self, plain: TrialResult) -> None:
        """A trial that is killed in the middle."""
        half_s = plain.before_s + plain.wall_s / 2
        try:
            self._carried_out("killed", _Changes(), half_s)
        except WorkerDied:
            pass
        except HarnessError as error:
            self.progress.say(f"the trial that was to be killed: {error}")


@dataclass(frozen=True, slots=True)
class _Same:
    """Whether two trials gave the same, and how near they are."""

    holds: bool
    text: str


def _compared(plain: TrialResult, other: TrialResult) -> _Same:
    if file_sha256(Path(plain.mesh)) == file_sha256(Path(other.mesh)):
        return _Same(True, "the same to the bit")
    from scipy.spatial import KDTree

    a, b = (load_mesh(Path(each.mesh)).vertices for each in (plain, other))
    apart_m = max(float(np.max(KDTree(x).query(y)[0])) for x, y in ((a, b), (b, a)))
    return _Same(1000 * apart_m <= _SAME_MM, f"up to {1000 * apart_m:.3f} mm apart")


def _undeclared(capture: Capture, info: MethodInfo) -> list[Path]:
    """The pictures that a method does not declare."""
    chosen = views_for(info, capture).capture
    count = len(chosen.cameras)
    declared = {chosen.image_path(view) for view in info.views_of(count) if view < count}
    every = map(capture.image_path, range(len(capture.cameras)))
    return [path for path in every if path not in declared]


def _changed_photos(capture: Capture, folder: Path, info: MethodInfo, changes: _Changes) -> Path:
    """A copy of the photos under another name, or without those that are not declared."""
    subject = "somebody-else" if changes.renamed else capture.subject
    copy = folder / (f"moved-{uuid.uuid4().hex}" if changes.renamed else "copy") / subject
    shutil.copytree(capture.directory, copy)
    if changes.renamed:
        _rename(copy / "capture.json", {"subject": subject, "dataset": "elsewhere"})
    if changes.spoilt:
        for path in _undeclared(capture, info):
            (copy / path.relative_to(capture.directory)).write_bytes(b"not a picture")
    return copy


def _rename(path: Path, names: Mapping[str, object]) -> None:
    write_json(path, {**json.loads(path.read_text(encoding="utf-8")), **names})


def _environment_text(info: MethodInfo) -> str:
    used = ", ".join(f"{part.role} {part.name}" for part in info.parts)
    return used or "the harness's own"

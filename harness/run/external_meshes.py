"""Scoring meshes, clouds or splats made elsewhere: a folder, one per subject, or a pair."""

from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path

from harness.core.errors import DataError, HarnessError, MissingPart, did_you_mean
from harness.core.files.hashing import file_sha256
from harness.core.files.names import checked_name, inside, named_from
from harness.core.mesh import Mesh
from harness.core.metric_catalog import METRICS
from harness.core.protocols import MethodInfo, Privilege
from harness.core.records import CaptureStamp, MetricValue, ProtocolStamp, Record, Scores, Status
from harness.core.settings import MetricProtocol
from harness.core.truth import face_regions
from harness.data.manifest import load_manifest
from harness.files.mesh_files import MESH_SUFFIXES, load_mesh, save_mesh
from harness.files.point_files import load_points
from harness.geometry.images import load_rgba
from harness.run.mesh_scores import mesh_scores
from harness.run.progress import Progress
from harness.run.publication import MESH_FILE
from harness.run.record_inputs import Inputs, environment, scored_elsewhere, utc_now
from harness.run.sources import ScanSet
from harness.run.store import CellFolder, Outcome, RunStore
from methods.catalog import METHODS
from methods.perceptual import perceptual_distance
from methods.points.surfacing import load_surface
from metrics.photos import VIEW_RECIPES, view_numbers
from metrics.score import Score, score_all

_SEAMS = (
    "normals end at the seams of its texture, which the mesh that is kept does not have: hand in "
    "results of a mesh without texture coordinates, such as a PLY"
)


@dataclass(frozen=True, slots=True)
class FolderRequest:
    """A folder of meshes named by subject, to be filed as a method.

    Attributes:
        folder: Holds ``<id>.ply``, ``.obj``, ``.glb``, ``.off`` or ``.stl``: metres, world frame. A
            PLY without faces is a cloud or Gaussians.
        name: The method's name in records and tables.
        title: Its title in tables.
        truth: What it is measured against.
        protocol: How it is measured.
        store: Where records go.
    """

    folder: Path
    name: str
    title: str
    truth: ScanSet
    protocol: MetricProtocol
    store: RunStore

    def told(self, message: str) -> str:
        """The message, with meshes and scans named from their own folders, as a record has it."""
        for folder in (self.folder, self.truth.root):
            message = named_from(message, folder.parent)
        return message


def score_folder(request: FolderRequest, progress: Progress) -> list[Outcome]:
    """One record per subject of the dataset; a subject without a mesh is ``missing``, not dropped.

    Raises:
        HarnessError: no such folder, not one mesh named by a subject, or a link out of it, a name
            that no method may have or that one run here has.
    """
    checked_name("method", request.name)
    if request.name in METHODS.targets():
        raise HarnessError(
            f"'{request.name}' is a method that is run here",
            hint="File meshes made elsewhere under another --name",
        )
    if not request.folder.is_dir():
        raise HarnessError(f"no folder at {request.folder}")
    subjects = request.truth.subjects
    meshes = {subject: _mesh_of(request.folder, subject) for subject in subjects}
    if not any(meshes.values()):
        present = sorted(path.stem for path in request.folder.iterdir())
        raise DataError(
            f"{request.folder} holds no mesh of dataset '{request.truth.name}'",
            expected=f"files such as {subjects[0]}.ply",
            got=", ".join(present[:5]) or "an empty folder",
            hint=did_you_mean(present[0], subjects) if present else "",
        )
    request.store.begin()
    progress.expect("meshes", len(subjects))
    outcomes: list[Outcome] = []
    for subject, path in meshes.items():
        folder = request.store.cell(request.name, subject)
        with folder.locked():
            outcome = _score_subject(request, folder, subject, path)
        if outcome.status != "ok":
            progress.say(outcome.line)
        progress.done("meshes")
        outcomes.append(outcome)
    return outcomes


def _mesh_of(folder: Path, subject: str) -> Path | None:
    found = [folder / f"{subject}{suffix}" for suffix in MESH_SUFFIXES]
    found = [path for path in found if path.is_file()]
    if len(found) > 1:
        raise DataError(
            f"{folder} holds several meshes of subject '{subject}'",
            expected="one",
            got=", ".join(path.name for path in found),
        )
    return inside(folder, found[0], folder) if found else None


@dataclass(frozen=True, slots=True)
class _Scored:
    """How scoring one subject's mesh ended; ``by_mesh`` is False where the truth is unreadable."""

    status: Status
    reason: str = ""
    by_mesh: bool = True
    scores: Scores = field(default_factory=Scores)
    inputs: Inputs | None = None
    files: Mapping[str, str] = field(default_factory=dict[str, str])
    details: Mapping[str, object] = field(default_factory=dict[str, object])


def _score_subject(
    request: FolderRequest, folder: CellFolder, subject: str, path: Path | None
) -> Outcome:
    """The subject's record, filed; an earlier good one stays where the truth cannot be read."""
    method = MethodInfo(request.name, request.title, privileges=(Privilege.MADE_ELSEWHERE,))
    attempt = folder.new_attempt()
    found = _scored(request, method, subject, path, attempt.results / MESH_FILE)
    record = Record(
        key=found.inputs.key if found.inputs else "",
        method=method,
        dataset=request.truth.name,
        subject=subject,
        # Made elsewhere: nobody here knows from which photos.
        recipe="",
        protocol=ProtocolStamp.of(request.protocol),
        capture=CaptureStamp(),
        seed=request.protocol.seed,
        status=found.status,
        reason=request.told(found.reason),
        metrics=found.scores.metrics,
        regions=found.scores.regions,
        warnings=tuple(map(request.told, found.scores.warnings)),
        diagnostics=found.scores.diagnostics,
        environment=environment(),
        created_utc=utc_now(),
        scale_rule=request.truth.dataset.scale,
        identity=request.truth.dataset.person_of(subject),
        inputs=found.inputs.to_dict() if found.inputs else {},
        files=found.files,
        details=found.details,
    )
    return folder.file(record, attempt, own_failure=found.by_mesh)


def _scored(
    request: FolderRequest, method: MethodInfo, subject: str, path: Path | None, kept: Path
) -> _Scored:
    """A mesh's scores; what was scored is kept, so that it can be looked at and handed in.

    Of a mesh with texture coordinates this loses the seams, at which normals end.
    """
    if path is None:
        return _Scored("missing", f"no mesh of {subject} in {request.folder}")
    try:
        scan, truth = request.truth.load(subject)
        face_regions(scan, truth)
    except HarnessError as error:
        return _Scored("failed", str(error), by_mesh=False)
    inputs: Inputs | None = None
    try:
        is_points = load_points(path) is not None
        inputs = scored_elsewhere(
            method, file_sha256(path), scan, request.protocol, is_points=is_points
        )
        surface = load_surface(path)
        predicted = surface.mesh
        scores = mesh_scores(predicted, scan, truth, request.protocol, misplaced="refuse")
    except HarnessError as error:
        return _Scored("failed", str(error), inputs=inputs)
    if file_sha256(path) != inputs.mesh:
        return _Scored("failed", f"{path} changed while it was scored")
    save_mesh(kept, predicted.geometry())
    files = {kept.name: file_sha256(kept)}
    if predicted.uv is not None and request.protocol.texture_seams == "split":
        scores = replace(scores, warnings=(*scores.warnings, _SEAMS))
    return _Scored("ok", scores=scores, inputs=inputs, files=files, details=surface.details)


@dataclass(frozen=True, slots=True, eq=False)
class PairScores:
    """What ``score`` found; ``print`` shows it as ``harness score`` does.

    Attributes:
        predicted: The file of the prediction, or what its mesh is called.
        truth: That of the truth.
        scores: By protocol.
        failed: Why a protocol could not measure the two, where several were asked for.
        notice: What a reader should know whatever the protocol.
    """

    predicted: str
    truth: str
    scores: Mapping[str, Score]
    failed: Mapping[str, HarnessError]
    notice: tuple[str, ...] = ()

    @property
    def single(self) -> Score:
        """The score under the one protocol that was asked for.

        Raises:
            HarnessError: several were.
        """
        if self._several:
            names = [*self.scores, *self.failed]
            raise HarnessError(
                "there are scores of several protocols",
                got=", ".join(names),
                hint=f"Take one: scores['{names[0]}']",
            )
        return next(iter(self.scores.values()))

    @property
    def metrics(self) -> Mapping[str, MetricValue]:
        """The numbers by metric, each with its unit and standard error; of one protocol alone."""
        return self.single.metrics

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a reader should know of the numbers, each once."""
        found = (warning for score in self.scores.values() for warning in score.warnings)
        return tuple(dict.fromkeys([*found, *self.notice]))

    @property
    def _several(self) -> bool:
        return len(self.scores) + len(self.failed) > 1

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values, as ``harness score --json`` prints them."""
        about: dict[str, object] = {"predicted": self.predicted, "truth": self.truth}
        if not self._several:
            return {**self.single.to_dict(), **about, "warnings": list(self.warnings)}
        return {
            **about,
            "warnings": list(self.notice),
            "protocols": {name: score.to_dict() for name, score in self.scores.items()},
            "failed": {name: str(error) for name, error in self.failed.items()},
        }

    def __str__(self) -> str:
        return "\n".join(self._lines())

    def _lines(self) -> Iterator[str]:
        lead = f"{self.predicted} against {self.truth}"
        if self._several:
            yield lead
        for score in self.scores.values():
            title = f"protocol {score.protocol.name} v{score.protocol.version}"
            yield title if self._several else f"{lead}, {title}"
            yield from _metric_lines(score)
        for name, error in self.failed.items():
            yield f"protocol {name}: {error}"
        for warning in self.warnings:
            yield f"  warning: {warning}"


def score(
    predicted: Mesh | str | Path,
    truth: Mesh | str | Path,
    protocol: MetricProtocol | str = "mexecon",
    *,
    keep_points: bool = False,
    manifest: str | Path | None = None,
) -> PairScores:
    """The metrics of a mesh against the true surface; ``.metrics`` has them by name.

    Both are in metres and in the world frame. Nothing is scaled or repaired, or aligned but where
    a protocol says so.

    Args:
        predicted: A mesh or its file; or a PLY file of points or Gaussians, whose surface is made
            by the steps that methods' results are made surfaces by.
        truth: The true surface, or its file.
        protocol: By name, from the manifest or of the field, such as ``exact``; several with
            commas, or ``all``; or a protocol itself.
        keep_points: Whether the errors are wanted point by point, under one protocol.
        manifest: File that names protocols; by default the one that commands use.

    Raises:
        DataError: a mesh that cannot be read, or compared under any of the protocols.
        HarnessError: an unknown protocol, or points under several.
    """
    rules = (
        (protocol,)
        if isinstance(protocol, MetricProtocol)
        else load_manifest(manifest).protocols_of(protocol)
    )
    if keep_points and len(rules) > 1:
        raise HarnessError("errors point by point are of one protocol", got=str(len(rules)))
    with ThreadPoolExecutor(max_workers=2) as pool:
        mine, true = pool.submit(_surface, predicted), pool.submit(_mesh, truth)
        mine, true = mine.result(), true.result()
    found = score_all(mine, true, rules, keep_points=keep_points)
    return PairScores(
        predicted=_name(predicted),
        truth=_name(truth),
        scores={name: each for name, each in found.items() if isinstance(each, Score)},
        failed={name: each for name, each in found.items() if isinstance(each, HarnessError)},
        notice=_as_it_lies(truth),
    )


@dataclass(frozen=True, slots=True)
class ViewNumbers:
    """A rendered picture against a photo, by recipe.

    Attributes:
        numbers: ``psnr`` in dB, ``ssim``, ``ms_ssim`` and ``lpips``, as far as there are any.
        lacking: Why a recipe has no ``lpips``.
    """

    numbers: Mapping[str, Mapping[str, float]]
    lacking: Mapping[str, str]

    def __str__(self) -> str:
        lines: list[str] = []
        for name, of_recipe in self.numbers.items():
            lines.append(f"recipe {name} v{VIEW_RECIPES[name].version}")
            lines += [f"  {key:8} {value:9.4f}" for key, value in of_recipe.items()]
            lines += [f"  lpips: {self.lacking[name]}"] if name in self.lacking else []
        return "\n".join(lines)


def score_views(rendered: Path, photo: Path, recipes: str) -> ViewNumbers:
    """A rendered picture against a photo of its size; both are PNG, the photo with its mask.

    Args:
        rendered: What a method made; its coverage is not looked at.
        photo: The true picture, whose coverage of at least one half is the subject.
        recipes: Names with commas.

    Raises:
        DataError: a picture that cannot be read, or another size.
        HarnessError: no such recipe.
    """
    mine, true = load_rgba(rendered), load_rgba(photo)
    picture, shown = (each[..., :3] / 255.0 for each in (mine, true))
    numbers, lacking = {}, {}
    for name in recipes.split(","):
        if name not in VIEW_RECIPES:
            raise HarnessError(f"no recipe '{name}' for pictures", expected=", ".join(VIEW_RECIPES))
        try:
            perceptual = perceptual_distance(VIEW_RECIPES[name].lpips)
        except MissingPart as error:
            perceptual, lacking[name] = None, str(error)
        mask = true[..., 3] >= _HALF
        numbers[name] = view_numbers(picture, shown, mask, VIEW_RECIPES[name], perceptual)
    return ViewNumbers(numbers, lacking)


#: Coverage from which a pixel is the subject's.
_HALF = 128


def _surface(given: Mesh | str | Path) -> Mesh:
    return given if isinstance(given, Mesh) else load_surface(given).mesh


def _mesh(given: Mesh | str | Path) -> Mesh:
    return given if isinstance(given, Mesh) else load_mesh(Path(given), seams=True)


def _name(given: Mesh | str | Path) -> str:
    return given.source if isinstance(given, Mesh) else str(given)


def _as_it_lies(truth: Mesh | str | Path) -> tuple[str, ...]:
    """What a reader should know of a file in the place of a dataset's scan; empty elsewhere."""
    if isinstance(truth, Mesh):
        return ()
    folder = Path(truth).resolve().parent
    if folder.parent.name != "model" or folder.name != Path(truth).stem:
        return ()
    return (
        f"{truth} is compared as it lies in its file; a dataset's scan is turned, scaled and "
        "centred when it is read: score meshes in the world frame with --dataset and --name",
    )


def _metric_lines(score: Score) -> Iterator[str]:
    mexecon = not score.protocol.summary
    for key, value in score.metrics.items():
        # A name is one publication's: what others call P2S or NC is something else.
        title = METRICS[key].title if mexecon else key
        floor = f"   floor {value.floor:.3f} {value.unit}" if value.floor else ""
        yield (
            f"  {title:18} {value.value:9.3f} {value.unit:3} "
            f"± {value.standard_error:.3f} (standard error, n = {value.n}){floor}"
        )
    done = score.alignment
    if done.by != "none":
        mirror = ", mirrored" if done.mirrored else ""
        yield (
            f"  aligned by {done.by}: scale {done.scale:.4f}{mirror}, mean vertex distance "
            f"{done.before_mm:.2f} mm before and {done.after_mm:.2f} mm after"
        )

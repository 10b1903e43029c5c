"""Measures the landmark offsets of SMPL-X, on scans of THuman whose SMPL-X body is known.

What ``landmark_offsets`` measures for Anny on generated people, a user with the licensed files can
measure for SMPL-X: the body of a scan's fit is its true body. An offset is how far a landmark is
detected from that body's point, and to it how far a body that is fitted with such offsets still is.
Subjects that the manifest lists are tested on, and never used.
"""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from harness.core.arrays import Floats
from harness.core.artifacts import Capture, Scan
from harness.core.camera import Camera
from harness.core.errors import DataError, HarnessError, MethodError
from harness.core.files.names import subject_range
from harness.core.files.pickles import read_array_pickle
from harness.core.process.threads import silent
from harness.core.protocols import Context
from harness.core.truth import true_parameters
from harness.core.units import MM_PER_METRE
from harness.data.manifest import Dataset, Manifest, load_manifest
from harness.data.subjects import fit_of
from harness.run.sources import Source
from harness.run.workspace import Workspace
from methods.body.fitting import fitted_parameters
from methods.body.models.anatomy import blend_landmarks
from methods.body.models.anny_body import AnnyBody
from methods.body.models.model import LandmarkTable, ParametricBody, Posed
from methods.body.models.smplx_body import SmplxBody
from methods.body.models.smplx_part import MODEL, SMPLX
from methods.body.models.thuman_body import MODEL_NAME, fit_parameters, placing
from methods.body.photos.agreement import placed
from methods.body.photos.detection import MIRRORED, Detections, detect
from methods.body.photos.views import Views, load_views
from methods.body.smplx_offsets import (
    MeasuredOffset,
    SmplxOffsets,
    forget_offsets,
    keep_offsets,
    offsets_file,
)  # fmt: skip
from methods.body_fit import jmbo8_plus

_DATASET, _SIZE_LANDMARK_OFFSETS = "avatars-train", (540, 960)
#: Distances at which a view's ray, and a subject's deviation, count half.
_NEAR_M, _HALF_MM = 0.02, 20.0
_ROUNDS = 30
_MIRROR = np.array([-1.0, 1.0, 1.0])


def deviations_mm(
    cameras: Sequence[Camera], found: Detections, posed: Posed, table: LandmarkTable
) -> Floats:
    """(K, 3) from a true body's landmarks to the detected ones, in their carriers' rest axes."""
    blends = blend_landmarks(replace(table, offsets=np.zeros_like(table.offsets)), posed)
    turns = posed.turns[0, table.carriers].double().numpy()
    chosen = table.landmarks
    points, _, _ = placed(cameras, found.pixels[:, chosen], found.confidence[:, chosen], _NEAR_M)
    away = points - blends[0].double().numpy()
    return np.einsum("kji,kj->ki", turns, away) * MM_PER_METRE


def remaining_mm(fitted: Posed, truth: Posed, body: ParametricBody) -> Floats:
    """(K, 3) from a true body's landmarks to a fitted one's, in the true carriers' rest axes."""
    turns = truth.turns[0, body.landmarks.carriers].double().numpy()
    away = (body.landmark_points(fitted) - body.landmark_points(truth))[0].double().numpy()
    return np.einsum("kji,kj->ki", turns, away) * MM_PER_METRE


def symmetric_means(deviations: Floats, landmarks: Sequence[int]) -> tuple[Floats, Floats]:
    """Robust means (K, 3) of deviations (S, K, 3), mirrored left to right, and spreads (K,).

    The spread is the median distance from the mean, in the deviations' unit.
    """
    order = list(landmarks)
    other = [order.index(MIRRORED[landmark]) for landmark in order]
    both = np.concatenate([deviations, deviations[:, other] * _MIRROR])
    means = np.median(both, axis=0)
    for _ in range(_ROUNDS):
        away = np.linalg.norm(both - means, axis=2)
        weight = 1.0 / (1.0 + (away / _HALF_MM) ** 2)
        means = (weight[..., None] * both).sum(axis=0) / weight.sum(axis=0)[:, None]
    return means, np.median(np.linalg.norm(both - means, axis=2), axis=0)


def true_posed(body: AnnyBody, scan: Scan) -> Posed:
    """A generated subject's true body in the world frame.

    Raises:
        DataError: as ``true_parameters``, or the body was moved off the model, so that the model's
            surface, from which landmarks are blended, is not the true one.
    """
    import torch

    truth = true_parameters(scan)
    if truth.off_model_m:
        raise DataError(
            f"the body of {scan.subject} is none that the body model can give",
            expected="a body whose parameters give its surface",
            got=f"one {truth.off_model_m * MM_PER_METRE:.1f} mm off",
            hint="Use subjects of avatars-train",
        )
    posed = body.posed_as(truth.pose_parameters, truth.phenotype)
    shift = torch.tensor(scan.scan_to_world[:3, 3], dtype=torch.float32)
    return replace(posed, vertices=posed.vertices + shift, joints=posed.joints + shift)


def _main(subjects: str) -> None:
    chosen = subject_range(subjects) or tuple(subjects.split(","))
    source = Source.select(load_manifest(None), Workspace.default(), _DATASET, chosen, "paper8")
    width, height = _SIZE_LANDMARK_OFFSETS
    recipe = replace(
        source.render_recipe, name="offsets8", renderer="raycast", width=width, height=height
    )
    source = replace(source, recipe=recipe)
    body = AnnyBody()
    people: list[tuple[Capture, Posed]] = []
    detected: list[Floats] = []
    for subject in chosen:
        try:
            capture = source.ensure_capture(subject, silent)
        except HarnessError as error:
            # Some of the training recipes cannot be made; it is said which.
            sys.stderr.write(f"{subject} left out: {error}\n")
            continue
        views = range(len(capture.cameras))
        posed = true_posed(body, source.load(subject)[0])
        people.append((capture, posed))
        detected.append(
            deviations_mm(capture.cameras, detect(capture, views), posed, body.landmarks)
        )
    order = body.landmarks.landmarks.tolist()
    offsets, _ = symmetric_means(np.array(detected), order)
    body.landmarks = replace(body.landmarks, offsets=(offsets / MM_PER_METRE).astype(np.float32))
    remaining, spreads = symmetric_means(np.array(list(_left_after(body, people))), order)
    for landmark, offset, spread in zip(order, offsets + remaining, spreads, strict=True):
        x, y, z = np.round(offset).astype(int)
        sys.stdout.write(f"    {landmark}: ({x}, {y}, {z}),  # {spread:.0f} mm\n")


def _left_after(body: AnnyBody, people: Sequence[tuple[Capture, Posed]]) -> Iterator[Floats]:
    """What remains between each person and the body that is fitted to the photos."""
    import torch

    torch.set_num_threads(1)
    context = Context(seed=0, workdir=Path(), stage=lambda _: contextlib.nullcontext())
    for done, (capture, truth) in enumerate(people, start=1):
        sys.stderr.write(f"fitting {done} of {len(people)}: {capture.subject}\n")
        views = load_views(capture, range(len(capture.cameras)), jmbo8_plus.settings.subject_px)
        fit = fitted_parameters(body, views, jmbo8_plus.settings, context)
        with torch.no_grad():
            yield remaining_mm(body.posed(fit.parameters), truth, body)


if __name__ == "__main__":
    _main(sys.argv[1])


#: Fewer say more of themselves than of people.
FEWEST_SUBJECTS = 6
_USUAL, _LAST_OF_VERSION_2 = 36, 525
_SIZE = (540, 960)
#: A landmark is worked out from the photos in which it is seen.
_FEWEST_VIEWS = 4
_FIT_RULE, _KIND = "fit", "thuman"

Tell = Callable[[str], None]


@dataclass(frozen=True, slots=True, eq=False)
class _Person:
    """One subject's views, true body, and how far landmarks are detected from it."""

    subject: str
    views: Views
    truth: Posed
    away_mm: Floats


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationRequest:
    """What offsets are measured on.

    Attributes:
        manifest: Lists the subjects that are tested on.
        workspace: Where photos are kept.
        dataset: One of THuman, in metres by the fits.
        subjects: Ids; none for the first 36 that have a fit.
        recipe: Whose cameras are used.
        model: Name of the imported model that is fitted; empty for the neutral one.
        replace: Whether offsets that were measured before may be replaced.
    """

    manifest: Manifest
    workspace: Workspace
    dataset: str
    subjects: tuple[str, ...] = ()
    recipe: str = "paper8"
    model: str = ""
    replace: bool = False


def calibrate_smplx(request: CalibrationRequest, tell: Tell) -> SmplxOffsets:
    """The offsets, measured and kept for every later fit.

    Args:
        request: What they are measured on.
        tell: Called with a line for each subject.

    Raises:
        HarnessError: another dataset, a subject that the manifest lists, or offsets that are there.
        MissingPart: a model, the scans, or MediaPipe is not there.
        DataError: too few subjects can be used.
    """
    if offsets_file().is_file() and not request.replace:
        raise HarnessError(
            f"landmark offsets were measured before: {offsets_file()}",
            hint="Say --replace to measure them again, or --forget to have none",
        )
    body, true_body = SmplxBody(request.model), SmplxBody(MODEL_NAME)
    found = _calibrated(_source(request), body, true_body, tell)
    keep_offsets(found)
    return found


def forget_smplx() -> str:
    """What was done, in words: all offsets are zero from now on."""
    there = forget_offsets()
    return "landmark offsets deleted: all are zero" if there else "no landmark offsets were there"


def _source(request: CalibrationRequest) -> Source:
    """Subjects that nothing is tested on, in small photos."""
    manifest, workspace, dataset = request.manifest, request.workspace, request.dataset
    subjects = request.subjects
    name, found, _ = manifest.select(dataset)
    if found.kind != _KIND or found.scale != _FIT_RULE:
        raise HarnessError(
            f"dataset '{dataset}' does not know its subjects' SMPL-X bodies in metres",
            expected=f"kind {_KIND} and scale {_FIT_RULE}",
            got=f"kind {found.kind} and scale {found.scale}",
        )
    tested = [subject for subject in subjects if subject in found.subjects]
    if tested:
        raise HarnessError(
            f"subject '{tested[0]}' of '{name}' is one that methods are tested on",
            hint="Calibrate on subjects that the manifest does not list",
        )
    width, height = _SIZE
    small = replace(
        manifest.recipe(request.recipe),
        name="offsets8",
        renderer="raycast",
        width=width,
        height=height,
    )
    root = manifest.root(name, workspace.root)
    chosen = subjects or tuple(_with_fits(found, root))
    if len(chosen) < FEWEST_SUBJECTS:
        raise DataError(
            f"too few subjects of '{name}' to measure landmark offsets",
            expected=f"{FEWEST_SUBJECTS} that the manifest does not list, with their fits",
            got=str(len(chosen)),
            hint="Name them with --subjects, or unpack more scans",
        )
    return Source(manifest.path.resolve(), workspace, name, chosen, small)


def _calibrated(source: Source, body: SmplxBody, true_body: SmplxBody, tell: Tell) -> SmplxOffsets:
    """The offsets, measured on all subjects of a source that can be used."""
    people = list(_people(source, true_body, tell))
    if len(people) < FEWEST_SUBJECTS:
        raise DataError(
            "too few subjects could be used to measure landmark offsets",
            expected=str(FEWEST_SUBJECTS),
            got=str(len(people)),
        )
    order = body.landmarks.landmarks.tolist()
    offsets, _ = symmetric_means(np.array([person.away_mm for person in people]), order)
    metres = (offsets / MM_PER_METRE).astype(np.float32)
    body.landmarks = replace(body.landmarks, offsets=metres)
    remaining, spreads = symmetric_means(np.array(list(_after_fits(body, people, tell))), order)
    rows = zip(order, np.round(offsets + remaining, 1).tolist(), spreads.tolist(), strict=True)
    return SmplxOffsets(
        dataset=source.name,
        subjects=tuple(person.subject for person in people),
        recipe=source.recipe_name,
        model_sha256=body.part.sha256,
        measured=tuple(
            MeasuredOffset(int(landmark), (x, y, z), round(spread, 1))
            for landmark, (x, y, z), spread in rows
        ),
    )


def true_smplx(body: SmplxBody, scan: Scan, fit: Path) -> Posed:
    """The body of a scan's fit in the world frame.

    Args:
        body: The model that the fits refer to.
        scan: Placed by its fit.
        fit: Its ``smplx_param.pkl``.

    Raises:
        DataError: a value of the fit is missing or of another size.
    """
    import torch
    from scipy.spatial.transform import Rotation

    document = read_array_pickle(fit)
    place = placing(document)
    values = fit_parameters(document, SMPLX.find(MODEL_NAME).file(MODEL))
    moved = {name: values.pop(name) for name in ("betas", "body_pose", "global_orient")}
    posed_body = body.holding(values)
    parameters = {
        "shape": torch.tensor(moved["betas"][None], dtype=torch.float32),
        "pose": torch.tensor(moved["body_pose"].reshape(1, -1, 3), dtype=torch.float32),
        "orientation": torch.tensor(
            Rotation.from_rotvec(moved["global_orient"]).as_matrix()[None, :, :2],
            dtype=torch.float32,
        ),
        "translation": torch.zeros(1, 3),
    }
    with torch.no_grad():
        posed = posed_body.posed(parameters)
    # The model's own origin is not its root joint, which was put to the origin here.
    root = torch.tensor(posed_body.rest_root(moved["betas"]))
    shift_in_scan = torch.tensor(place.shift)
    size = float(np.cbrt(np.linalg.det(scan.scan_to_world[:3, :3])))
    turn = torch.tensor(scan.scan_to_world[:3, :3] / size, dtype=torch.float64)
    shift = torch.tensor(scan.scan_to_world[:3, 3])

    def placed(points: torch.Tensor) -> torch.Tensor:
        in_scan = (points.double() + root) * place.scale + shift_in_scan
        return (size * in_scan @ turn.T + shift).float()

    return Posed(
        vertices=placed(posed.vertices),
        joints=placed(posed.joints),
        turns=(turn @ posed.turns.double()).float(),
    )


def _with_fits(dataset: Dataset, root: Path) -> Iterator[str]:
    """The first subjects of version 2.0, which stand upright, that have a scan and a fit, and that
    no split of the dataset tests.
    """
    found = 0
    for number in range(_LAST_OF_VERSION_2 + 1):
        subject = f"{number:04d}"
        if subject in dataset.subjects or found == _USUAL:
            continue
        with contextlib.suppress(DataError):
            if fit_of(dataset, root, subject) is not None:
                found += 1
                yield subject


def _people(source: Source, true_body: SmplxBody, tell: Tell) -> Iterator[_Person]:
    dataset = source.manifest.datasets[source.name]
    for place, subject in enumerate(source.subjects, start=1):
        where = f"{place} of {len(source.subjects)}: {subject}"
        try:
            capture = source.ensure_capture(subject, silent)
            scan = source.load(subject)[0]
            fit = fit_of(dataset, source.root(), subject)
            if fit is None or scan.body_path is None:
                raise DataError("; ".join(scan.warnings) or "it has no fit")
            truth = true_smplx(true_body, scan, fit)
            views = load_views(capture, range(len(capture.cameras)), jmbo8_plus.settings.subject_px)
            if len(views.indices) < _FEWEST_VIEWS:
                raise DataError(f"people were detected in {len(views.indices)} photos alone")
            cameras = [capture.cameras[view] for view in views.indices]
            # Whole pictures, as for Anny; what was read of each is remembered.
            found = detect(capture, views.indices)
            away = deviations_mm(cameras, found, truth, true_body.landmarks)
        except (DataError, MethodError) as error:
            tell(f"{where} left out: {error}")
            continue
        tell(f"{where} measured")
        yield _Person(subject, views, truth, away)


def _after_fits(body: SmplxBody, people: Sequence[_Person], tell: Tell) -> Iterator[Floats]:
    """What remains between each person and the body that is fitted to the photos."""
    import torch

    torch.set_num_threads(1)
    context = Context(seed=0, workdir=Path(), stage=lambda _: contextlib.nullcontext())
    settings = jmbo8_plus.settings
    for place, person in enumerate(people, start=1):
        fit = fitted_parameters(body, person.views, settings, context)
        tell(f"{place} of {len(people)}: {person.subject} fitted")
        with torch.no_grad():
            yield remaining_mm(body.posed(fit.parameters), person.truth, body)

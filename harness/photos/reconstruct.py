"""``harness reconstruct``: from imported photos, a capture's folder or one photo to files."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from harness.core.artifacts import Capture
from harness.core.errors import DataError, HarnessError, did_you_mean
from harness.core.files.atomic import atomic_directory, atomic_path, write_json
from harness.core.photo_scores import PhotoScores
from harness.core.process.workers import run_worker
from harness.core.records import Record
from harness.core.typed_json import from_json, to_json
from harness.data.camera_files import camera_file
from harness.data.manifest import Manifest
from harness.data.pictures import PICTURE_SUFFIXES
from harness.files.coloured_mesh import ColouredMesh, save_coloured
from harness.files.mesh_files import load_mesh, save_mesh
from harness.geometry.colouring import coloured
from harness.geometry.photo import open_photo
from harness.photos.one_photo import ASSUMED_HEIGHT_M, OnePhotoRequest, assumes_camera
from harness.photos.request import Imported, ImportRequest, import_capture
from harness.run.evaluate import evaluate
from harness.run.method_choice import ChosenMethod
from harness.run.photo_figures import photo_quality
from harness.run.plan import EvalRequest
from harness.run.progress import Progress
from harness.run.publication import BODY_FILE, MESH_FILE, NORMALS_FILE, load_body_mesh, load_normals
from harness.run.sources import (
    CAPTURES,
    IMPORTED,
    Source,
    captures_below,
    imported_capture,
    imported_state,
    imported_subjects,
    name_for,
)
from harness.run.store import PHOTOS_RUN, RunStore
from harness.run.workspace import Workspace
from reports.figures.photo_sheet import SheetInput, draw_photo_sheet


@dataclass(frozen=True, slots=True)
class WrittenResult:
    """A result as files.

    Attributes:
        folder: Holds them.
        silhouette_iou: Of each photo's mask and the mesh's, by the photo's number from the front.
        seen_share: Share of the mesh's vertices that a photo shows.
    """

    folder: Path
    silhouette_iou: tuple[float, ...]
    seen_share: float


def write_result(store: RunStore, record: Record, capture: Capture, folder: Path) -> WrittenResult:
    """Write a good record's result into a folder, which is replaced as a whole.

    The folder gets ``mesh.ply``, ``mesh.glb`` and ``mesh.obj`` with colours at the vertices,
    ``body.ply`` where the method fits a body, ``sheet.png``, and ``figures.json`` with figures of
    quality that need no scan.

    Args:
        store: Of the record.
        record: A good one.
        capture: All its photos, counted from the front.
        folder: To be made.

    Raises:
        DataError: a result that is gone or changed, or the disk refuses.
    """
    mesh = load_mesh(store.result(record, MESH_FILE))
    photos = [open_photo(capture, view) for view in range(len(capture.cameras))]
    painted = coloured(mesh, photos)
    maps = ()
    if NORMALS_FILE in record.files:
        maps = load_normals(store.result(record, NORMALS_FILE))
    quality = photo_quality(mesh, capture, maps)
    iou = tuple(view.silhouette_iou for view in quality.views)
    figures = _figures(record, capture, quality, painted)
    with atomic_directory(folder) as made:
        save_coloured(made / "mesh.ply", painted)
        save_coloured(made / "mesh.glb", painted)
        _write_coloured_obj(made / "mesh.obj", painted)
        if BODY_FILE in record.files:
            body = load_body_mesh(store.result(record, BODY_FILE), "fitted body")
            save_mesh(made / "body.ply", body)
        sheet = SheetInput(
            f"{record.method.title} of '{record.subject}'",
            photos,
            mesh,
            painted.colours,
            [f"IoU {value:.3f}" for value in iou],
        )
        draw_photo_sheet(sheet, made / "sheet.png")
        write_json(made / "figures.json", figures)
    return WrittenResult(folder, iou, painted.seen_share)


def _figures(
    record: Record, capture: Capture, quality: PhotoScores, painted: ColouredMesh
) -> dict[str, object]:
    mesh = painted.mesh
    extent = [float(side) for side in mesh.extent]
    imported = capture.provenance.get("imported", {})
    return {
        "method": record.method_name,
        "capture": capture.subject,
        "photos": [view.get("photo", "") for view in imported.get("views", [])],
        "masks": sorted({str(view.get("mask", "")) for view in imported.get("views", [])}),
        "world": imported.get("world", {}).get("notes", []),
        "warnings": list(capture.warnings),
        "quality": to_json(quality),
        "vertices_seen_share": painted.seen_share,
        "mesh": {"vertices": len(mesh.vertices), "faces": len(mesh.faces), "extent_m": extent},
        "stages": [{"name": stage.name, "wall_s": stage.wall_s} for stage in record.stages],
        "details": dict(record.details),
    }


def _write_coloured_obj(path: Path, painted: ColouredMesh) -> None:
    """An OBJ with each vertex' colour after its place, 0 to 1 in sRGB, as MeshLab and Blender do.

    The format itself has no colours; a program that does not know them reads the places.
    """
    rows = np.hstack([painted.mesh.vertices, painted.colours / 255.0]).tolist()
    lines = ["v {:.6f} {:.6f} {:.6f} {:.4f} {:.4f} {:.4f}".format(*row) for row in rows]
    lines += ["f {} {} {}".format(*face) for face in (painted.mesh.faces + 1).tolist()]
    with atomic_path(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="ascii")


_PHOTO_WORKER = "harness.photos.one_photo"


@dataclass(frozen=True, slots=True)
class Assumptions:
    """What is told of photos without cameras.

    Attributes:
        field_deg: Field of view along the longer side, degrees; None takes it from the files, or
            for one photo the default, and for several finds it.
        height_m: How high the person is in the photos, metres; for one photo None is 1.7.
        mask: The photo's mask, or the folder of several photos'; None takes alpha, or makes masks.
    """

    field_deg: float | None = None
    height_m: float | None = None
    mask: Path | None = None

    @property
    def options(self) -> tuple[str, ...]:
        """The options that gave one."""
        given = {"--fov": self.field_deg, "--height": self.height_m, "--mask": self.mask}
        return tuple(name for name, value in given.items() if value is not None)


@dataclass(frozen=True, slots=True, eq=False)
class ReconstructRequest:
    """What ``harness reconstruct`` was asked for.

    Attributes:
        what: Name of an imported capture, a folder with a ``capture.json`` or of photos, or a
            photo.
        methods: The methods with their settings.
        output: Folder for results, one folder for each method.
        manifest: Defines the dataset of imported captures.
        workspace: Where captures and runs lie.
        assumed: Of photos without cameras.
        name: Of the capture that a photo or folder becomes; empty takes its own name.
        seed: Root of all randomness.
        timeout_s: Longest time for a method; None is no limit.
    """

    what: str
    methods: tuple[ChosenMethod, ...]
    output: Path | None
    manifest: Manifest
    workspace: Workspace
    assumed: Assumptions
    name: str = ""
    seed: int = 0
    timeout_s: float | None = 3600.0


@dataclass(frozen=True, slots=True)
class MethodOutcome:
    """How one method ended.

    Attributes:
        method: Its row.
        failure: Why there is no result; empty where there is one.
        result: Its files; None where there is none.
    """

    method: str
    failure: str = ""
    result: WrittenResult | None = None


@dataclass(frozen=True, slots=True)
class Reconstructed:
    """What ``harness reconstruct`` did.

    Attributes:
        capture: Name of the capture.
        notes: What was found or assumed at an import that was part of it.
        warnings: Doubts about the photos.
        outcomes: One for each method.
    """

    capture: str
    notes: tuple[str, ...]
    warnings: tuple[str, ...]
    outcomes: tuple[MethodOutcome, ...]

    @property
    def all_ok(self) -> bool:
        """Whether every method has a result."""
        return all(outcome.result for outcome in self.outcomes)


def reconstruct(request: ReconstructRequest, progress: Progress) -> Reconstructed:
    """Run methods on photos and write what they make.

    Results that are there and current are kept, as in ``harness eval``.

    Raises:
        HarnessError: no such capture, a photo that cannot be used, or assumptions of what is known;
            what goes wrong with one method is its outcome instead.
    """
    _require_dataset(request.manifest)
    name, imported = _capture_of(request, progress)
    capture = imported_capture(request.workspace, name)
    store = RunStore(request.workspace.run(PHOTOS_RUN))
    source = Source.select(request.manifest, request.workspace, CAPTURES, (name,), IMPORTED)
    protocol = next(iter(request.manifest.protocols.values()))  # nothing is measured with it
    summary = evaluate(
        EvalRequest(
            source=source,
            methods=request.methods,
            protocol=protocol,
            store=store,
            seed=request.seed,
            timeout_s=request.timeout_s,
        ),
        progress,
    )
    outcomes: list[MethodOutcome] = []
    folder = request.output or Path(name)
    for outcome in summary.outcomes:
        record = outcome.record
        if outcome.status != "ok":
            # A good record that was kept is of other photos, or of other code.
            outcomes.append(MethodOutcome(record.method_name, outcome.kept or record.reason))
            continue
        target = folder.resolve() / record.method_name
        outcomes.append(
            MethodOutcome(record.method_name, result=write_result(store, record, capture, target))
        )
    notes = imported.notes if imported else ()
    return Reconstructed(name, notes, capture.warnings, tuple(outcomes))


def _require_dataset(manifest: Manifest) -> None:
    if CAPTURES not in manifest.datasets or manifest.datasets[CAPTURES].kind != "captures":
        raise HarnessError(
            f"{manifest.path} has no dataset '{CAPTURES}'",
            expected="an entry of kind 'captures'",
            hint="Copy it from the manifest that is installed, or leave --manifest out",
        )


def _capture_of(request: ReconstructRequest, progress: Progress) -> tuple[str, Imported | None]:
    """The name of the capture, which is made of a photo or a folder if need be."""
    path = Path(request.what)
    if path.is_file():
        return _photo(request, path)
    known = imported_subjects(request.workspace)
    has_capture = (path / "capture.json").is_file()
    if request.assumed.options and (has_capture or not path.is_dir()):
        raise HarnessError(
            f"{' and '.join(request.assumed.options)} for '{request.what}', which has cameras",
            expected="photos, of which nothing else tells it",
            hint="Cameras, size and masks of a capture are told at its import: harness capture "
            "import --help",
        )
    if has_capture:
        return _folder(request, path, progress)
    if path.is_dir() and (request.assumed.options or request.what not in known):
        return _photos(request, path, progress)
    if request.what in known:
        if request.name:
            raise HarnessError(
                f"--name {request.name} for '{request.what}', which has its name",
                expected="a name for one photo, or for a folder",
            )
        return request.what, None
    raise HarnessError(
        f"'{request.what}' is no imported capture, no folder and no photo",
        hint=did_you_mean(request.what, known),
    )


def _photos(
    request: ReconstructRequest, path: Path, progress: Progress
) -> tuple[str, Imported | None]:
    """A folder of photos is imported, with cameras of a file in it or with estimated ones."""
    if hint := captures_below(path):
        raise HarnessError(f"{path} holds no capture.json", hint=hint)
    name, assumed = request.name or name_for(path), request.assumed
    job = ImportRequest(
        photos=str(path.resolve()),
        cameras=camera_file(path),
        masks="" if assumed.mask is None else str(assumed.mask.resolve()),
        directory=str(request.workspace.capture(CAPTURES, name, IMPORTED)),
        dataset=CAPTURES,
        subject=name,
        recipe=IMPORTED,
        height_m=assumed.height_m or 0.0,
        field_deg=assumed.field_deg or 0.0,
    )
    return name, import_capture(job, progress, request.timeout_s)


def _photo(request: ReconstructRequest, path: Path) -> tuple[str, Imported]:
    if path.suffix.lower() not in PICTURE_SUFFIXES:
        raise DataError(f"{path} is no photo", expected=", ".join(PICTURE_SUFFIXES))
    name, assumed = request.name or name_for(path), request.assumed
    _keep_other_photos(request.workspace, name)
    job = OnePhotoRequest(
        photo=str(path.resolve()),
        mask="" if assumed.mask is None else str(assumed.mask.resolve()),
        directory=str(request.workspace.capture(CAPTURES, name, IMPORTED)),
        dataset=CAPTURES,
        subject=name,
        recipe=IMPORTED,
        field_deg=assumed.field_deg,
        height_m=ASSUMED_HEIGHT_M if assumed.height_m is None else assumed.height_m,
    )
    answer = run_worker(_PHOTO_WORKER, job, timeout_s=request.timeout_s)
    return name, from_json(Imported, answer, "the worker's answer", "an import")


def _keep_other_photos(workspace: Workspace, name: str) -> None:
    """Refuse to replace photos with cameras of their own by one photo that has their name."""
    directory = workspace.capture(CAPTURES, name, IMPORTED)
    if imported_state(directory)[0] == "cached" and not assumes_camera(Capture.load(directory)):
        raise HarnessError(
            f"imported photos with cameras are called '{name}', and one photo would replace them",
            hint="Give the capture of this photo another --name",
        )


def _folder(
    request: ReconstructRequest, path: Path, progress: Progress
) -> tuple[str, Imported | None]:
    """A capture of ours becomes an imported one; one that is imported already stays."""
    found = Capture.load(path)
    if path.resolve() == request.workspace.capture(CAPTURES, found.subject, IMPORTED):
        return found.subject, None
    name = request.name or f"{found.dataset}-{found.subject}-{found.recipe}"
    job = ImportRequest(
        photos=str(path.resolve()),
        cameras=str((path / "capture.json").resolve()),
        directory=str(request.workspace.capture(CAPTURES, name, IMPORTED)),
        dataset=CAPTURES,
        subject=name,
        recipe=IMPORTED,
        # Under its own name it is the same folder, whose photos may have been made anew.
        replace=not request.name,
    )
    made = import_capture(job, progress, request.timeout_s)
    return name, made

"""Cameras of photos that come with none, or with inexact ones: from the photos themselves."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from harness.core.artifacts import image_name
from harness.core.errors import HarnessError
from harness.core.files.hashing import content_hash, file_sha256
from harness.core.process.source_digest import SourceTree
from harness.core.process.threads import StepReport
from harness.core.typed_json import to_json
from harness.data.camera_files import LAYOUTS
from harness.data.lens import ForeignCameras, ForeignView
from harness.data.pictures import find_mask, find_photos, photo_folder, picture_facts
from harness.geometry.images import load_rgba
from harness.geometry.place import MEAN_HEIGHT_M
from harness.geometry.similarity import Similarity
from harness.photos.load_photos import TakenView
from harness.photos.matching import MatchedPhoto
from harness.photos.one_photo import check_field, level_camera
from harness.photos.request import AUTO, ImportRequest, check_height
from harness.run.uncalibrated import (
    ESTIMATE,
    ESTIMATORS,
    REFINED,
    found_cameras,
    refined_cameras,
)
from methods.cameras.values import EstimatedCameras, Focal, PhotoView

#: Photos' files tell focal lengths in whole millimetres of 35 mm film, and phones crop.
_FILE_SD = 0.02
_LEVEL_DEG = 50.0


def level_cameras(request: ImportRequest) -> ForeignCameras:
    """Cameras that know of each photo its size, and its field of view where that is told.

    Raises:
        HarnessError: options of a camera file, no height, or a field of view that no lens has.
    """
    given = {"--up": request.up != AUTO, "--facing": request.facing != AUTO,
             "--origin": request.origin != "subject", "--refine-cameras": request.refine,
             "--scale": request.scale not in ("", AUTO)}  # fmt: skip
    if named := [option for option, is_given in given.items() if is_given]:
        raise HarnessError(
            f"{named[0]} for photos without cameras in {request.photos}",
            expected=f"a camera file: {LAYOUTS}",
            hint=f"Name it with --cameras FILE, or leave {named[0]} out",
        )
    if not request.height_m and request.scale != AUTO:
        raise HarnessError(
            f"the height of the person in {request.photos} has to be told: photos alone, without a "
            "camera file, do not tell it",
            expected="--height 1.72 (metres, as the person stands in the photos), or --scale auto",
        )
    if request.height_m:
        check_height(request.height_m)
    if request.field_deg:
        check_field(request.field_deg)
    folder = photo_folder(Path(request.photos))
    photos = find_photos(folder)
    masks = {find_mask(folder, path) for path in photos}
    views = []
    for path in photos:
        if path not in masks:
            facts = picture_facts(path)
            field_deg = request.field_deg or facts.field_deg or _LEVEL_DEG
            views.append(ForeignView(path.name, level_camera(facts, field_deg)))
    return ForeignCameras(folder, "estimated", tuple(views), in_world=True)


@dataclass(frozen=True, slots=True, eq=False)
class Posed:
    """Photos with the cameras that were found.

    Attributes:
        views: Those that have one; their pictures are numbered anew.
        told: For the capture's provenance.
        notes: What was found, assumed or left out, one sentence each.
        warnings: What a reader of results should know.
    """

    views: tuple[TakenView, ...]
    told: dict[str, object]
    notes: tuple[str, ...]
    warnings: tuple[str, ...]


def estimated(
    request: ImportRequest, views: Sequence[TakenView], folder: Path, report: StepReport
) -> Posed:
    """Photos of a still person with the cameras that outlines and photos tell.

    Args:
        request: The height and the field of view, as far as they are told.
        views: With pictures below ``folder``, and level cameras.
        folder: Of the capture.
        report: Called after every step, counted on from the photos.

    Raises:
        MethodError: no cameras can be trusted of these photos.
        MissingPart: MediaPipe is not installed.
    """
    photos = _photo_views(views, folder)
    px = tuple(float(view.camera.K[0, 0]) for view in views)
    height_m = request.height_m or MEAN_HEIGHT_M
    if request.field_deg:
        focal, source = Focal(px), "given"
    elif all(picture_facts(view.photo.path).field_deg > 0 for view in views):
        focal, source = Focal(px, _FILE_SD), "file"
    else:
        focal, source = Focal.unknown(photos), "found"
    found, told = found_cameras(photos, (focal, source), height_m, report)
    words = {"given": "as given", "file": "about as the photos' files tell",
             "found": "found with the cameras, one for all photos"}  # fmt: skip
    used = [value for value in found.focal_px if np.isfinite(value)]
    notes = (
        f"cameras were estimated from the photos: {found.gauge}",
        f"the focal length is {np.median(used):.0f} pixels, {words[source]}",
        f"the person is {height_m:g} m high in the photos, "
        + ("as given" if request.height_m else "which is assumed"),
        f"a camera's turn is sure to {found.turn_sd_deg:.2g} degrees (standard deviation)",
    )
    return _posed(views, found, folder, {ESTIMATE: told}, notes)


def posed_in(world: Similarity, views: Sequence[TakenView], foreign: ForeignCameras) -> Posed:
    """Photos with the cameras of their file, world metres."""
    cameras = [world.camera(view.camera) for view in views]
    moved = tuple(replace(v, camera=c) for v, c in zip(views, cameras, strict=True))
    # Our own say themselves how they are known.
    is_exact = foreign.in_world or any(camera.is_orthographic for camera in cameras)
    note = "the cameras are taken as exact: --refine-cameras corrects those that are not"
    return Posed(moved, {}, () if is_exact else (note,), ())


def refined(views: Sequence[TakenView], folder: Path, report: StepReport) -> Posed:
    """Photos with given cameras, world metres, after outlines and photos have corrected them.

    Raises:
        MethodError: photos and cameras contradict each other.
    """
    given = [view.camera for view in views]
    found = refined_cameras(_photo_views(views, folder), given, report)
    apart = [
        (np.degrees(np.arccos(min(1.0, float(view.camera.forward @ new.forward)))),
         1e3 * float(np.linalg.norm(view.camera.position - new.position)))
        for view, new in zip(views, found.cameras, strict=True) if new is not None
    ]  # fmt: skip
    turn_deg, move_mm = np.median(apart, axis=0)
    note = f"cameras were refined: by {turn_deg:.2f} degrees and {move_mm:.1f} mm in the median"
    return _posed(views, found, folder, {REFINED: found.to_dict()}, (note,))


def _photo_views(views: Sequence[TakenView], folder: Path) -> list[PhotoView]:
    return [
        PhotoView(view.photo.name, load_rgba(folder / image_name(number)))
        for number, view in enumerate(views)
    ]


def _posed(
    views: Sequence[TakenView],
    found: EstimatedCameras,
    folder: Path,
    told: dict[str, object],
    notes: tuple[str, ...],
) -> Posed:
    """The photos with a camera, with their pictures in its place."""
    kept: list[TakenView] = []
    for number, (view, camera) in enumerate(zip(views, found.cameras, strict=True)):
        picture = folder / image_name(number)
        if camera is None:
            picture.unlink()
        else:
            picture.rename(folder / image_name(len(kept)))
            kept.append(replace(view, camera=camera))
    return Posed(tuple(kept), told, notes, found.remarks)


def import_key(request: ImportRequest, photos: Sequence[MatchedPhoto]) -> str:
    """Content id of everything that an import with such cameras depends on."""
    code = SourceTree.installed().digest(
        ["harness.photos.importing", ESTIMATORS.module("estimate")], [SourceTree.__module__]
    )
    files = [[photo.name, file_sha256(photo.path), photo.mask and file_sha256(photo.mask)]
             for photo in photos]  # fmt: skip
    places = {"directory": "", "photos": "", "masks": "", "replace": False}
    camera = [photo.view.camera.to_dict() for photo in photos]
    asked = to_json(replace(request, **places))
    return content_hash({"asked": asked, "files": files, "cameras": camera, **code.to_dict()})

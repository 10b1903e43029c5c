"""Photos and cameras of another program become a capture like any other, in a child process."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from harness.core.artifacts import Capture, image_name
from harness.core.camera_frames import write_transforms_json
from harness.core.errors import HarnessError
from harness.core.files.atomic import atomic_directory, exclusive_lock, write_json
from harness.core.files.hashing import content_hash, file_sha256
from harness.core.process.threads import StepReport
from harness.core.process.workers import worker_main
from harness.data.camera_files import read_cameras
from harness.data.lens import ForeignCameras
from harness.photos.align_world import Placed, check_scale, found_up, placed
from harness.photos.estimated import (
    Posed,
    estimated,
    import_key,
    level_cameras,
    posed_in,
    refined,
)
from harness.photos.load_photos import LoadRules, take_photos
from harness.photos.masks import mask_maker
from harness.photos.matching import MatchedPhotos, matched_photos
from harness.photos.request import AUTO, ORIENTATIONS, Imported, ImportRequest

_LEAST_PX = 64


def import_photos(request: ImportRequest, report: StepReport) -> Imported:
    """Make a capture of photos, in place of one of some of these photos.

    Args:
        request: Photos, cameras if there are any, and what is known of their world.
        report: Called after every photo, and after every step towards cameras.

    Raises:
        HarnessError: files that cannot be read, photos that contradict their cameras, a world of
            which too little is known, or a capture of other photos that is there.
        MissingPart: MediaPipe is needed, and not installed.
    """
    if request.longest_px < _LEAST_PX:
        raise HarnessError(f"--longest {request.longest_px}", expected=f"at least {_LEAST_PX}")
    if request.mask_orientation not in (AUTO, *ORIENTATIONS):
        what = f"--mask-orientation {request.mask_orientation}"
        raise HarnessError(what, expected=f"{AUTO}, {' or '.join(ORIENTATIONS)}")
    if request.cameras:
        foreign = read_cameras(Path(request.cameras), Path(request.photos))
        check_scale(request, foreign)
    else:
        foreign = level_cameras(request)
    masks = Path(request.masks) if request.masks else None
    matched = matched_photos(Path(request.photos), foreign, masks, incomplete=request.incomplete)
    if not request.replace:
        _keep_others(request, [photo.path for photo in matched.photos])
    used = replace(foreign, views=tuple(photo.view for photo in matched.photos))
    directory = Path(request.directory)
    with exclusive_lock(directory.parent / f".{directory.name}.lock"):
        return _known(request, matched) or _imported(request, used, matched, report)


def _known(request: ImportRequest, matched: MatchedPhotos) -> Imported | None:
    """What was made of the same before, where that takes long and is there."""
    if request.cameras and not request.refine:
        return None
    directory = Path(request.directory)
    try:
        capture = Capture.load(directory)
        imported: Any = capture.provenance["imported"]
        if capture.damage() or imported["inputs"] != import_key(request, matched.photos):
            return None
        notes = tuple(map(str, imported["world"]["notes"]))
    except (HarnessError, KeyError, TypeError):
        return None
    return Imported(str(directory), len(capture.cameras), notes, capture.warnings)


def _imported(
    request: ImportRequest, foreign: ForeignCameras, matched: MatchedPhotos, report: StepReport
) -> Imported:
    """The import itself."""
    up, up_note = found_up(request, foreign)
    is_estimated = not request.cameras
    rules = LoadRules(
        request.longest_px,
        mask_maker(request.masks_by),
        request.incomplete,
        camera_shown=True if is_estimated else None,
        mask_shown=ORIENTATIONS.get(request.mask_orientation),
        posed=not is_estimated,
    )
    directory = Path(request.directory)
    with atomic_directory(directory) as folder:
        taken = take_photos(matched.photos, up, folder, report, rules)
        if is_estimated:
            posed = estimated(request, taken.views, folder, report)
            known = replace(request, height_m=0.0, scale="")
            found = placed(known, foreign, up, posed.views, folder)
            found = replace(found, notes=posed.notes)
        else:
            found = placed(request, foreign, up, taken.views, folder)
            posed = posed_in(found.world, taken.views, foreign)
            if request.refine:
                posed = refined(posed.views, folder, report)
            found = replace(found, notes=(up_note, *found.notes, *posed.notes))
        warnings = (*matched.warnings, *taken.warnings, *posed.warnings, *found.warnings)
        capture = _capture(request, foreign, posed, found, folder)
        told = {**capture.provenance, **posed.told}
        told["imported"]["inputs"] = import_key(request, matched.photos) if posed.told else ""
        capture = replace(capture, directory=directory, warnings=warnings, provenance=told)
        images = [image_name(number) for number in range(len(posed.views))]
        write_transforms_json(folder / "transforms.json", capture.cameras, images)
        write_json(folder / "capture.json", capture.to_dict())
    return Imported(str(directory), len(posed.views), found.notes, warnings)


def _keep_others(request: ImportRequest, photos: Sequence[Path]) -> None:
    """Refuse to replace a capture with which the photos, by their sha256, have none in common."""
    try:
        imported: Any = Capture.load(Path(request.directory)).provenance["imported"]
        before = {view["sha256"] for view in imported["views"]}
    except (HarnessError, KeyError, TypeError):
        # None is there, or one that nobody can use.
        return
    if before and before.isdisjoint(map(file_sha256, photos)):
        raise HarnessError(
            f"a capture '{request.subject}' of other photos is there already",
            hint="Give another --name, or say --replace with 'harness capture import'",
        )


def _capture(
    request: ImportRequest,
    foreign: ForeignCameras,
    posed: Posed,
    found: Placed,
    folder: Path,
) -> Capture:
    """The capture whose pictures lie in ``folder``; its key is that of pictures and cameras."""
    cameras = tuple(view.camera for view in posed.views)
    names = [image_name(number) for number in range(len(posed.views))]
    images = {name: file_sha256(folder / name) for name in names}
    key = content_hash(
        {
            "images": images,
            "cameras": [camera.to_dict() for camera in cameras],
            "front_yaw_deg": found.front_yaw_deg,
        }
    )
    return Capture(
        dataset=request.dataset,
        subject=request.subject,
        recipe=request.recipe,
        key=key,
        directory=folder,
        cameras=cameras,
        front_yaw_deg=found.front_yaw_deg,
        provenance={
            "imported": {
                "cameras": foreign.layout,
                "views": [view.to_dict() for view in posed.views],
                "world": found.to_dict(),
            },
            "images": images,
        },
    )


def handle(job: ImportRequest, report: StepReport) -> Imported:
    """Import."""
    return import_photos(job, report)


if __name__ == "__main__":
    worker_main(handle)

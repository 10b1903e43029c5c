"""One photo without a camera becomes a capture: what cannot be known is assumed, and said."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from harness.core.artifacts import Capture, image_name
from harness.core.camera import Camera, look_at
from harness.core.camera_frames import write_transforms_json
from harness.core.errors import DataError, HarnessError
from harness.core.files.atomic import atomic_directory, exclusive_lock, write_json
from harness.core.files.hashing import content_hash, file_sha256
from harness.core.process.threads import StepReport, silent
from harness.core.process.workers import worker_main
from harness.data.lens import ForeignView
from harness.data.pictures import PictureFacts, picture_facts
from harness.geometry.window import Window
from harness.photos.load_photos import LoadRules, TakenView, take_photos
from harness.photos.matching import MatchedPhoto
from harness.photos.request import Imported, check_height
from harness.photos.world import stance_of

#: How high a person is taken to be where nothing tells it.
ASSUMED_HEIGHT_M = 1.7

_UP = np.array([0.0, 1.0, 0.0])
_FIELDS_DEG = (5.0, 150.0)
_ASSUMED = "assumed"


@dataclass(frozen=True, slots=True)
class OnePhotoRequest:
    """A photo, and what is assumed of it.

    Attributes:
        photo: Its file.
        mask: Its mask's file; empty takes alpha, or makes one.
        directory: Folder of the capture to be made.
        dataset: Its dataset.
        subject: Its name there.
        recipe: Its recipe.
        field_deg: Field of view along the longer side, degrees; None takes it from the file if it
            tells, else ``assumed_deg``.
        assumed_deg: Field of view that is taken where nothing tells it.
        height_m: How high the person is as they stand in the photo, metres.
        longest_px: A photo with a longer side is made smaller.
    """

    photo: str
    directory: str
    dataset: str
    subject: str
    recipe: str
    mask: str = ""
    field_deg: float | None = None
    assumed_deg: float = 50.0
    height_m: float = ASSUMED_HEIGHT_M
    longest_px: int = 1920


def import_one_photo(request: OnePhotoRequest) -> Imported:
    """Make a capture of one photo, in place of one that was there.

    The camera is assumed to be held level, to have its optical axis in the middle of the picture,
    and to see the person from the front.

    Raises:
        DataError: the photo cannot be read, or shows no person.
        HarnessError: a field of view that no photo has, or a height that nobody has.
        MissingPart: MediaPipe is not installed.
    """
    check_height(request.height_m)
    path = Path(request.photo)
    facts = picture_facts(path)
    field_deg, source = _field(request, facts.field_deg)
    level = level_camera(facts, field_deg)
    mask = Path(request.mask) if request.mask else None
    photo = MatchedPhoto(path, ForeignView(path.name, level), mask, path.name)
    rules = LoadRules(request.longest_px, camera_shown=True)
    directory = Path(request.directory)
    with (
        exclusive_lock(directory.parent / f".{directory.name}.lock"),
        atomic_directory(directory) as folder,
    ):
        taken = take_photos([photo], _UP, folder, silent, rules)
        view = taken.views[0]
        camera = _before_the_person(view, request.height_m)
        notes = _notes(camera, field_deg, source, request)
        warnings = (*taken.warnings, *_doubts(folder, camera))
        capture = _capture(request, view, camera, notes, folder)
        capture = replace(capture, directory=directory, warnings=warnings)
        write_transforms_json(folder / "transforms.json", [camera], [image_name(0)])
        write_json(folder / "capture.json", capture.to_dict())
    return Imported(str(directory), 1, notes, warnings)


def assumes_camera(capture: Capture) -> bool:
    """Whether an imported capture is one photo, whose camera was assumed."""
    imported = capture.provenance.get("imported")
    return isinstance(imported, Mapping) and imported.get("cameras") == _ASSUMED


def level_camera(facts: PictureFacts, field_deg: float) -> Camera:
    """A level camera of a photo as viewers show it, with this field along its longer side."""
    width, height = facts.turn.size(facts.size)
    focal = max(width, height) / 2 / math.tan(math.radians(field_deg) / 2)
    K = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1.0]])
    return Camera(K, look_at([0.0, 0.0, 1.0], [0.0, 0.0, 0.0]), width, height)


def check_field(field_deg: float) -> None:
    """Refuse a field of view, as ``--fov`` gave it, that no lens has.

    Raises:
        HarnessError: it is outside 5 to 150 degrees.
    """
    low, high = _FIELDS_DEG
    if not low <= field_deg <= high:
        raise HarnessError(f"--fov {field_deg:g}", expected=f"{low:g} to {high:g}")


def _field(request: OnePhotoRequest, told_deg: float) -> tuple[float, str]:
    low, high = _FIELDS_DEG
    if request.field_deg is not None:
        check_field(request.field_deg)
        return request.field_deg, "as given"
    if low <= told_deg <= high:
        return told_deg, "as the photo's file tells"
    return request.assumed_deg, "which is assumed: --fov gives another"


def _before_the_person(view: TakenView, height_m: float) -> Camera:
    """The camera, level, so far from the person at the origin that they are so high."""
    camera = view.camera
    box = Window.around(view.coverage >= 128)
    distance = camera.K[1, 1] * height_m / box.height
    middle = np.array([(box.left + box.right) / 2, (box.top + box.bottom) / 2])
    aside = (middle - camera.K[:2, 2]) / camera.K[[0, 1], [0, 1]] * distance
    # OpenCV's axes are right, down, forward; the camera looks along -Z with +Y up.
    position = np.array([-aside[0], aside[1], distance])
    return Camera(camera.K, look_at(position, position - [0.0, 0.0, 1.0]), *camera.size)


def _notes(
    camera: Camera, field_deg: float, source: str, request: OnePhotoRequest
) -> tuple[str, ...]:
    return (
        f"the field of view is {field_deg:.1f} degrees along the longer side, {source}",
        f"the person is taken to be {request.height_m:g} m high in the photo, so that they stand "
        f"{camera.position[2]:.2f} m away; one photo does not tell size or distance",
        "the camera is taken to be level, and what it sees is taken for the front",
    )


def _doubts(folder: Path, camera: Camera) -> list[str]:
    """What landmarks say against the assumptions.

    Raises:
        DataError: the person stands on their head.
    """
    stance = stance_of(Capture("", "", "", "", folder, (camera,)), _UP)
    if stance is None:
        return ["no landmarks of a person were found: methods that fit a body will fail"]
    if not stance.upright:
        raise DataError(
            "the person in the photo stands head down",
            hint="Turn the photo by 180 degrees if it is upside-down",
        )
    turned_deg = math.degrees(math.atan2(stance.forward[0], stance.forward[2]))
    return [] if abs(turned_deg) < 60 else [
        f"the person is turned by about {turned_deg:.0f} degrees from the camera"
    ]  # fmt: skip


def _capture(
    request: OnePhotoRequest, view: TakenView, camera: Camera, notes: tuple[str, ...], folder: Path
) -> Capture:
    images = {image_name(0): file_sha256(folder / image_name(0))}
    return Capture(
        dataset=request.dataset,
        subject=request.subject,
        recipe=request.recipe,
        key=content_hash({"images": images, "cameras": [camera.to_dict()]}),
        directory=folder,
        cameras=(camera,),
        provenance={
            "imported": {
                "cameras": _ASSUMED,
                "views": [view.to_dict()],
                "world": {"notes": list(notes)},
            },
            "images": images,
        },
    )


def handle(job: OnePhotoRequest, report: StepReport) -> Imported:  # noqa: ARG001
    """Import."""
    return import_one_photo(job)


if __name__ == "__main__":
    worker_main(handle)

"""What ``harness capture import`` was asked for, what came of it, and the process that does it."""

from dataclasses import dataclass
from pathlib import Path

from harness.core.errors import HarnessError
from harness.core.process.workers import run_worker
from harness.core.typed_json import from_json
from harness.data.camera_files import read_cameras
from harness.data.pictures import find_photos, photo_folder
from harness.run.progress import CAMERAS, PHOTOS, PhotoSteps, Progress
from methods.cameras.values import STEPS

_WORKER = "harness.photos.importing"
#: What the cameras, the photos or a stated prior decide.
AUTO = "auto"
#: Where the origin may go.
ORIGINS = ("subject", "file")
#: Of which form of photos that their files turn masks may be; whether that is what viewers show.
ORIENTATIONS = {"stored": False, "shown": True}
#: Nobody is so small or so high: another unit. Metres.
POSSIBLE_HEIGHT_M = (0.3, 3.0)


def check_height(height_m: float) -> None:
    """Refuse a height, as ``--height`` gave it, that nobody has.

    Raises:
        HarnessError: it is outside 0.3 to 3 metres.
    """
    low, high = POSSIBLE_HEIGHT_M
    if not low <= height_m <= high:
        raise HarnessError(f"--height {height_m:g}", expected=f"{low} to {high} metres")


@dataclass(frozen=True, slots=True)
class ImportRequest:
    """Photos with cameras, and how their world is to become ours.

    Attributes:
        photos: Folder with the photos, or with ``images`` that has them.
        cameras: File or folder with their cameras; empty estimates them from the photos.
        masks: Folder with their masks; empty takes alpha, and where there is none makes masks.
        masks_by: The imported network that makes masks; empty is MediaPipe.
        directory: Folder of the capture to be made.
        dataset: Its dataset.
        subject: Its name there.
        recipe: Its recipe.
        up: ``auto``, or an axis of the file such as ``+z`` or ``0,-1,0``.
        facing: ``auto``, such an axis, or the name of a photo that was taken from the front.
        height_m: How high the person is in the photos, metres; 0 where ``scale`` tells.
        scale: Metres per unit of the file; ``auto`` or empty where it is not known.
        origin: ``subject`` puts the origin in the middle of the person, ``file`` leaves it.
        longest_px: Photos with a longer side are made smaller.
        accept: Whether photos that contradict their cameras are imported all the same.
        replace: Whether a capture of other photos may be there, and is replaced.
        incomplete: Whether photos and masks that are named may be missing or empty.
        mask_orientation: ``auto``, ``stored`` or ``shown``: of what masks of turned photos are.
        field_deg: Field of view along the longer side, degrees, of photos without cameras; 0 takes
            it from the files, or finds it.
        refine: Whether cameras are refined by outlines and photos.
    """

    photos: str
    cameras: str
    directory: str
    dataset: str
    subject: str
    recipe: str
    masks: str = ""
    masks_by: str = ""
    up: str = AUTO
    facing: str = AUTO
    height_m: float = 0.0
    scale: str = ""
    origin: str = "subject"
    longest_px: int = 1920
    accept: bool = False
    replace: bool = False
    incomplete: bool = False
    mask_orientation: str = AUTO
    field_deg: float = 0.0
    refine: bool = False


@dataclass(frozen=True, slots=True)
class Imported:
    """What came of an import.

    Attributes:
        directory: The capture's folder.
        views: Number of its photos.
        notes: How the world was found, one sentence each.
        warnings: What a reader of results should know.
    """

    directory: str
    views: int
    notes: tuple[str, ...]
    warnings: tuple[str, ...]

    @property
    def path(self) -> Path:
        """The capture's folder."""
        return Path(self.directory)


def import_capture(
    request: ImportRequest, progress: Progress, timeout_s: float | None = None
) -> Imported:
    """Make a capture of photos; their cameras are estimated where none are given.

    Args:
        request: Photos, cameras, and what is known of their world.
        progress: Hears of every photo, and of every step towards cameras.
        timeout_s: How long it may take; None is no limit.

    Raises:
        HarnessError: files that cannot be read, photos that contradict their cameras, or a world
            of which too little is known.
        MissingPart: MediaPipe is needed, and not installed.
    """
    if request.cameras:
        count = len(read_cameras(Path(request.cameras), Path(request.photos)).views)
    else:
        count = len(find_photos(photo_folder(Path(request.photos))))
    towards = STEPS if request.refine or not request.cameras else 0
    progress.expect(PHOTOS, count)
    progress.expect(CAMERAS, towards)
    steps = PhotoSteps(progress, count, towards)
    answer = run_worker(_WORKER, request, progress=steps, timeout_s=timeout_s)
    steps.end()
    return from_json(Imported, answer, "the worker's answer", "an import")

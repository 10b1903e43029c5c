"""Which photo each camera took."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from harness.core.errors import DataError
from harness.data.captures.pictures import find_mask, find_photo, find_photos
from harness.data.captures.views import ForeignCameras, ForeignView

#: More photos than this are not used: methods were not tried with more.
MOST_VIEWS = 64


@dataclass(frozen=True, slots=True, eq=False)
class MatchedPhoto:
    """A photo, its camera, and the file of its mask.

    Attributes:
        path: The photo's file.
        view: Its camera as the camera file has it.
        mask: Its mask's file; None where alpha tells, or nothing does.
    """

    path: Path
    view: ForeignView
    mask: Path | None

    @property
    def name(self) -> str:
        """What the photo is called in messages."""
        return self.path.name


@dataclass(frozen=True, slots=True)
class MatchedPhotos:
    """The photos that have a camera.

    Attributes:
        photos: In the order of the camera file.
        warnings: What was left out, in words.
    """

    photos: tuple[MatchedPhoto, ...]
    warnings: tuple[str, ...]


def matched_photos(folder: Path, foreign: ForeignCameras, masks: Path | None) -> MatchedPhotos:
    """The photos of a camera file: by their names, or by order where the file names none.

    Args:
        folder: Holds the photos.
        foreign: Their cameras.
        masks: Folder of masks; None where the photos or the camera file tell them.

    Raises:
        DataError: photos that are not there, another number of photos than of nameless cameras,
            or a photo without a mask in the folder of masks.
    """
    base = foreign.path if foreign.path.is_dir() else foreign.path.parent
    warnings: list[str] = []
    pairs: list[tuple[Path, ForeignView]] = []
    if foreign.is_named:
        missing: list[DataError] = []
        for view in foreign.views:
            try:
                pairs.append((find_photo(folder, base, view.image), view))
            except DataError as error:
                missing.append(error)
        if missing and len(pairs) < max(1, len(missing)):
            raise missing[0]
        warnings += [f"left out: {error.what}" for error in missing]
    else:
        pairs = _by_order(folder, foreign)
    if len(pairs) > MOST_VIEWS:
        chosen = np.linspace(0, len(pairs) - 1, MOST_VIEWS).round().astype(int)
        warnings.append(
            f"{MOST_VIEWS} of {len(pairs)} photos are used, evenly spread over their order"
        )
        pairs = [pairs[int(index)] for index in chosen]
    photos = tuple(MatchedPhoto(p, v, _mask(base, folder, masks, p, v)) for p, v in pairs)
    return MatchedPhotos(photos, tuple(warnings))


def _by_order(folder: Path, foreign: ForeignCameras) -> list[tuple[Path, ForeignView]]:
    photos = find_photos(folder)
    if len(photos) != len(foreign.views):
        raise DataError(
            f"{foreign.path} does not name its photos, and their number is another",
            expected=f"{len(foreign.views)} photos in {folder}, in the order of their names",
            got=str(len(photos)),
            hint="Remove what is no photo of the set, or use a camera file that names photos",
        )
    return list(zip(photos, foreign.views, strict=True))


def _mask(
    base: Path, folder: Path, masks: Path | None, photo: Path, view: ForeignView
) -> Path | None:
    if masks is not None:
        found = find_mask(masks, photo)
        if found is None:
            raise DataError(
                f"no mask of {photo.name} in {masks}",
                expected=f"{photo.stem}.png or {photo.name}.png",
                hint="Leave --masks out to have masks made",
            )
        return found
    if not view.mask:
        return None
    return next((p for p in (base / view.mask, folder / view.mask) if p.is_file()), None)

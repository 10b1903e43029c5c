"""Which photo each camera took."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from harness.core.errors import DataError, listed
from harness.core.files.names import inside
from harness.data.lens import ForeignCameras, ForeignView
from harness.data.pictures import (
    PICTURE_SUFFIXES,
    NamedPictures,
    find_mask,
    find_photos,
    photo_folder,
)

#: More photos than this are not used: methods were not tried with more.
MOST_VIEWS = 64


@dataclass(frozen=True, slots=True, eq=False)
class MatchedPhoto:
    """A photo, its camera, and the file of its mask.

    Attributes:
        path: The photo's file.
        view: Its camera as the camera file has it.
        mask: Its mask's file; None where alpha tells, or nothing does.
        name: What the photo is called in messages: its path from the folder that holds all photos.
    """

    path: Path
    view: ForeignView
    mask: Path | None
    name: str


@dataclass(frozen=True, slots=True)
class MatchedPhotos:
    """The photos that have a camera.

    Attributes:
        photos: In the order of the camera file.
        warnings: What was left out, in words.
    """

    photos: tuple[MatchedPhoto, ...]
    warnings: tuple[str, ...]


def matched_photos(
    named: Path, foreign: ForeignCameras, masks: Path | None, *, incomplete: bool = False
) -> MatchedPhotos:
    """The photos of a camera file: by their paths, or by order where the file names none.

    Args:
        named: Folder that the user named for photos.
        foreign: Their cameras.
        masks: Folder of masks; None where the photos or the camera file tell them.
        incomplete: Whether photos and masks may be missing.

    Raises:
        DataError: photos or masks that are not there or lie elsewhere, one photo with two cameras,
            or another number of photos than of nameless cameras.
    """
    folder, pictures = photo_folder(named), NamedPictures(foreign.path, named)
    warnings: list[str] = []
    if foreign.is_named:
        found = [(pictures.find(view.image), view) for view in foreign.views]
        pairs = [(path, view) for path, view in found if path is not None]
        missing = [view.image for path, view in found if path is None]
        what = f"{len(missing)} of {len(found)} photos that {foreign.path} names are not there"
        warnings += _missing(what, missing, folder, incomplete=incomplete and bool(pairs))
        warnings += _without_camera(folder, pairs)
    else:
        pairs = _by_order(folder, foreign)
    if len(pairs) > MOST_VIEWS:
        chosen = np.linspace(0, len(pairs) - 1, MOST_VIEWS).round().astype(int)
        warnings.append(
            f"{MOST_VIEWS} of {len(pairs)} photos are used, evenly spread over their order"
        )
        pairs = [pairs[int(index)] for index in chosen]
    photos = _with_masks(pictures, masks, pairs)
    unmasked = [photo.name for photo in photos if photo.mask is None and (masks or photo.view.mask)]
    what = f"{len(unmasked)} of {len(photos)} photos have no mask at the place that is named"
    warnings += _missing(what, unmasked, masks or foreign.path, incomplete=incomplete)
    return MatchedPhotos(photos, tuple(warnings))


def _missing(what: str, names: Sequence[str], place: Path, *, incomplete: bool) -> list[str]:
    """What to warn of where files are missing and may be."""
    if names and not incomplete:
        raise DataError(f"{what}: {listed(names)}", expected=f"each of them in {place}",
                        hint="Add them, or import what is there with --incomplete")  # fmt: skip
    return [f"{what}: {listed(names)}"] if names else []


def _without_camera(folder: Path, pairs: Sequence[tuple[Path, ForeignView]]) -> list[str]:
    """Photos beside those that are used, of which the camera file says nothing; masks are none."""
    used: dict[str, str] = {}
    for path, view in pairs:
        first = used.setdefault(os.path.realpath(path), view.image)
        if first is not view.image:
            raise DataError(
                f"the camera file has two cameras for the photo {path.name}",
                got=f"'{first}' and '{view.image}'",
            )
    used |= {os.path.realpath(mask): "" for path, _ in pairs if (mask := find_mask(folder, path))}
    beside = (path for path in folder.iterdir() if path.suffix.lower() in PICTURE_SUFFIXES)
    others = sorted(path.name for path in beside if os.path.realpath(path) not in used)
    return [f"{len(others)} photos have no camera: {listed(others)}"] if others else []


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


def _with_masks(
    pictures: NamedPictures, masks: Path | None, pairs: Sequence[tuple[Path, ForeignView]]
) -> tuple[MatchedPhoto, ...]:
    """The photos with their masks; None where none is there, or none was named.

    In a folder of masks they lie as the photos do; side by side only where names differ.
    """
    top = os.path.commonpath([path.absolute().parent for path, _ in pairs])
    is_flat = len({path.stem for path, _ in pairs}) == len(pairs)
    photos: list[MatchedPhoto] = []
    for path, view in pairs:
        below = path.absolute().relative_to(top)
        if masks is None:
            mask = pictures.find(view.mask) if view.mask else None
            mask = None if mask and mask.samefile(path) else mask  # no photo is its own mask
        else:
            mask = find_mask(masks / below.parent, path)
            mask = find_mask(masks, path) if mask is None and is_flat else mask
            mask = mask and inside(masks, mask, masks)
        photos.append(MatchedPhoto(path, view, mask, str(below)))
    return tuple(photos)

"""Photos as a capture holds them: upright, without their lens, with the coverage of one person."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from harness.core.arrays import Bytes, Floats
from harness.core.artifacts import image_name
from harness.core.cameras.camera import Camera
from harness.core.errors import DataError
from harness.core.files.hashing import file_sha256
from harness.core.process.steps import StepReport
from harness.data.captures.pictures import TakenPhoto, read_photo
from harness.geometry.images import load_rgba, save_png
from harness.geometry.outline import Outline
from harness.geometry.place import place_of
from harness.pipeline.importing.masks import (
    MaskMaker,
    by_mediapipe,
    cut_sides,
    one_person,
    shows_others,
)
from harness.pipeline.importing.matching import MatchedPhoto
from harness.pipeline.importing.world import quarters_upright


@dataclass(frozen=True, slots=True, eq=False)
class TakenView:
    """A photo that is used.

    Attributes:
        photo: Its file, camera and mask as they were given.
        camera: The pinhole of the picture as the capture holds it, in the file's world.
        coverage: (H, W) uint8 of the person.
        mask_from: Where the mask came from, in words.
        sha256: Of the photo's file.
    """

    photo: MatchedPhoto
    camera: Camera
    coverage: Bytes
    mask_from: str
    sha256: str

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values, as the capture's provenance has them."""
        return {
            "photo": self.photo.name,
            "sha256": self.sha256,
            "mask": self.mask_from,
            "lens": self.photo.view.lens.to_dict() if self.photo.view.lens.bends else None,
        }


@dataclass(frozen=True, slots=True, eq=False)
class TakenViews:
    """The photos that are used, and what was left out.

    Attributes:
        views: By the number of their picture.
        warnings: In words.
    """

    views: tuple[TakenView, ...]
    warnings: tuple[str, ...]


def take_photos(
    photos: Sequence[MatchedPhoto],
    up: Floats,
    longest_px: int,
    folder: Path,
    report: StepReport,
    maker: MaskMaker | None = None,
) -> TakenViews:
    """Write the photos' pictures below ``folder``; a photo without a person is left out.

    Args:
        photos: With their cameras.
        up: (3,) in the world of the cameras.
        longest_px: Pictures with a longer side are made smaller.
        folder: Of the capture.
        report: Called after every photo.
        maker: Makes the masks that are missing; MediaPipe if none is given.

    Raises:
        DataError: a photo or mask that cannot be read, or no photo that shows a person.
        MissingPart: masks have to be made, and what makes them is not installed.
    """
    maker = maker or by_mediapipe()
    views: list[TakenView] = []
    warnings: list[str] = []
    for number, photo in enumerate(photos):
        taken = read_photo(photo.path, photo.view, photo.mask)
        taken = taken.turned(quarters_upright(taken.camera, up)).resized(longest_px)
        coverage, mask_from = _coverage(taken, photo, maker)
        coverage = np.minimum(coverage, taken.shown)
        if (coverage >= 128).any():
            picture = np.dstack([taken.rgb, coverage])
            save_png(folder / image_name(len(views)), picture)
            sha256 = file_sha256(photo.path)
            chosen_by_maker = maker.chooses and mask_from == maker.title
            if chosen_by_maker and shows_others(taken.rgb, coverage):
                warnings.append(
                    f"more than one person in {photo.name}: the one whom MediaPipe chose is kept; "
                    "give a mask if another is meant"
                )
            views.append(TakenView(photo, taken.camera, coverage, mask_from, sha256))
        else:
            warnings.append(f"left out: {photo.name} shows no person, or its mask is empty")
        report(number + 1, len(photos))
    if not views:
        raise DataError(
            "no photo shows a person",
            expected="photos with alpha, masks, or a person that is found in them",
            hint="Give masks with --masks FOLDER",
        )
    views, chosen = _same_person(views)
    for number, view in enumerate(views):
        _only_the_person(folder / image_name(number), view)
    return TakenViews(tuple(views), (*warnings, *chosen, *_cut(views)))


def _coverage(taken: TakenPhoto, photo: MatchedPhoto, maker: MaskMaker) -> tuple[Bytes, str]:
    """The coverage of a picture, and where it came from."""
    if taken.alpha is not None:
        return taken.alpha, "the photo's alpha" if photo.mask is None else "a mask file"
    made = maker(taken.rgb)
    return (np.zeros(taken.rgb.shape[:2], np.uint8) if made is None else made), maker.title


def _same_person(views: list[TakenView]) -> tuple[list[TakenView], list[str]]:
    """The views with one person each: the largest, where several views tell a common place."""
    found = [one_person(view.coverage) for view in views]
    several = [view.photo.name for view, one in zip(views, found, strict=True) if one.others]
    if not several:
        return views, []
    largest = [replace(view, coverage=one.coverage) for view, one in zip(views, found, strict=True)]
    note = f"more than one person in {', '.join(several)}"
    if len(views) < 2:
        return largest, [f"{note}: the largest was chosen"]
    outlines = [Outline(view.camera, view.coverage / 255.0) for view in largest]
    centre = place_of(outlines).centre
    chosen: list[TakenView] = []
    for view in views:
        near = view.camera.project(centre[None])[0][0]
        chosen.append(replace(view, coverage=one_person(view.coverage, near).coverage))
    return chosen, [f"{note}: the one nearest to where the photos' largest people meet was chosen"]


def _only_the_person(path: Path, view: TakenView) -> None:
    """Leave nothing of the photo but the person."""
    picture = load_rgba(path).copy()
    picture[..., 3] = view.coverage
    picture[view.coverage == 0] = 0
    save_png(path, picture)


def _cut(views: Sequence[TakenView]) -> list[str]:
    cut = {view.photo.name: cut_sides(view.coverage) for view in views}
    parts = [f"{name} ({', '.join(sides)})" for name, sides in cut.items() if sides]
    return [f"the frame cuts the person in {'; '.join(parts)}"] if parts else []

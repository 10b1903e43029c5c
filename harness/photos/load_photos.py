"""Photos as a capture holds them: upright, without their lens, with the coverage of one person."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from harness.core.arrays import Bytes, Floats
from harness.core.artifacts import image_name
from harness.core.camera import Camera
from harness.core.errors import DataError, listed
from harness.core.files.hashing import file_sha256
from harness.core.process.threads import StepReport
from harness.data.pictures import (
    READINGS,
    Reading,
    TakenPhoto,
    fitting_readings,
    picture_facts,
    read_photo,
)
from harness.geometry.images import load_rgba, save_png
from harness.geometry.outline import Outline
from harness.geometry.place import place_of
from harness.photos.agreement import hull_agreement
from harness.photos.masks import MaskMaker, by_mediapipe, cut_sides, one_person, shows_others
from harness.photos.matching import MatchedPhoto
from harness.photos.world import quarters_upright, upright

Made = TypeVar("Made")

#: Readings of turned photos are tried on small pictures; such differences tell nothing.
_TRIED_PX, _TIED = 320, 0.02


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


@dataclass(frozen=True, slots=True)
class LoadRules:
    """How photos are loaded.

    Attributes:
        longest_px: Pictures with a longer side are made smaller.
        maker: Makes the masks that are missing; MediaPipe if none is given.
        incomplete: Whether photos that show no person may be left out.
        camera_shown: Whether cameras of photos that their files turn are of what viewers show; None
            lets sizes and agreement tell.
        mask_shown: Whether masks of such photos are.
        posed: Whether cameras stand where they took the photos.
    """

    longest_px: int
    maker: MaskMaker | None = None
    incomplete: bool = False
    camera_shown: bool | None = None
    mask_shown: bool | None = None
    posed: bool = True


def take_photos(
    photos: Sequence[MatchedPhoto],
    up: Floats,
    folder: Path,
    report: StepReport,
    rules: LoadRules,
) -> TakenViews:
    """Write the photos' pictures below ``folder``.

    Args:
        photos: With their cameras.
        up: (3,) in the world of the cameras.
        folder: Of the capture.
        report: Called after every photo.
        rules: How they are loaded.

    Raises:
        DataError: photos or masks that cannot be read, or that show no person.
        MissingPart: masks have to be made, and what makes them is not installed.
    """
    maker = rules.maker or by_mediapipe()
    reading, warnings = _reading(photos, up, rules, maker)
    views: list[TakenView] = []
    empty: list[str] = []
    inverted: list[str] = []

    def take(photo: MatchedPhoto) -> None:
        taken = _upright(photo, up, reading).resized(rules.longest_px)
        coverage, mask_from = _coverage(taken, photo, maker)
        coverage = np.minimum(coverage, taken.shown)
        if (coverage >= 128).any():
            save_png(folder / image_name(len(views)), np.dstack([taken.rgb, coverage]))
            sha256 = file_sha256(photo.path)
            views.append(TakenView(photo, taken.camera, coverage, mask_from, sha256))
            inverted.extend([photo.name] if taken.inverted else [])
            chosen_by_maker = maker.chooses and mask_from == maker.title
            if chosen_by_maker and shows_others(taken.rgb, coverage):
                warnings.append(
                    f"more than one person in {photo.name}: the one whom MediaPipe chose is kept; "
                    "give a mask if another is meant"
                )
        else:
            empty.append(photo.name)
        report(len(views) + len(empty), len(photos))

    _of_each(photos, take)
    warnings += _left_out(empty, len(photos), incomplete=rules.incomplete)
    if inverted:
        warnings.append(f"masks are white around the person, and were inverted: {listed(inverted)}")
    views, chosen = _same_person(views, posed=rules.posed)
    for number, view in enumerate(views):
        _only_the_person(folder / image_name(number), view)
    return TakenViews(tuple(views), (*warnings, *chosen, *_cut(views)))


def _of_each(photos: Sequence[MatchedPhoto], use: Callable[[MatchedPhoto], Made]) -> list[Made]:
    """What ``use`` makes of each photo; all that cannot be used are told at once."""
    made: list[Made] = []
    faults: list[DataError] = []
    for photo in photos:
        try:
            made.append(use(photo))
        except DataError as error:
            faults.append(error)
    if len(faults) > 1:
        what = f"{len(faults)} of {len(photos)} photos cannot be used"
        raise DataError(f"{what}: {'; '.join(map(str, faults))}")
    if faults:
        raise faults[0]
    return made


def _left_out(empty: Sequence[str], count: int, *, incomplete: bool) -> list[str]:
    """What to warn of where photos show no person."""
    if len(empty) == count:
        raise DataError(
            "no photo shows a person",
            expected="photos with alpha, masks, or a person that is found in them",
            hint="Give masks with --masks FOLDER",
        )
    what = f"{len(empty)} of {count} photos show no person, or their masks are empty"
    if empty and not incomplete:
        raise DataError(f"{what}: {listed(empty)}", hint="Mend their masks, or leave these photos "
                        "out with --incomplete")  # fmt: skip
    return [f"{what}, and are left out: {listed(empty)}"] if empty else []


def _upright(photo: MatchedPhoto, up: Floats, reading: Reading) -> TakenPhoto:
    taken = read_photo(photo.path, photo.view, photo.mask, reading)
    return taken.turned(quarters_upright(taken.camera, up))


def _reading(
    photos: Sequence[MatchedPhoto], up: Floats, rules: LoadRules, maker: MaskMaker
) -> tuple[Reading, list[str]]:
    """What cameras and masks of turned photos are of: sizes tell, else what agrees, else nothing.

    Where cameras fit both alike, that one is taken in which what a photo's file says is up is up,
    and else the stored picture, since most programs see these.
    """
    fits = _of_each(photos, lambda photo: fitting_readings(photo.path, photo.view, photo.mask))
    common = [
        reading
        for reading in READINGS
        if rules.camera_shown in (None, reading.camera_shown)
        and rules.mask_shown in (None, reading.mask_shown)
        and all(reading in fit for fit in fits)
    ]
    if not common:
        raise DataError(
            "no one reading of photos that their files turn fits all sizes",
            expected="cameras, and masks, all of stored pictures or all of what viewers show",
            hint="Save the photos without an orientation tag, with cameras and masks of them",
        )
    turns = [(photo, picture_facts(photo.path).turn) for photo in photos]
    turned = [(photo, turn) for photo, turn in turns if turn.moves]
    masked = any(photo.mask for photo, _ in turned)
    # Those that differ: masks of photos that are not turned, or have none, are the same either way.
    common = [r for r in common if turned or r == common[0]]
    common = [r for r in common if masked or r.mask_shown == common[0].mask_shown]
    if len(common) == 1:
        return common[0], []
    scores = {reading: _agreement(photos, up, reading, maker) for reading in common}
    close = [r for r in common if scores[r] > max(scores.values()) - _TIED]
    quarters = [(turn.quarters, quarters_upright(p.view.camera, up)) for p, turn in turned]
    best = max(close, key=lambda r: sum(w == (0 if r.camera_shown else q) for q, w in quarters))
    found = [r for r in close if r.camera_shown == best.camera_shown]
    if len(found) > 1:
        raise DataError(
            f"masks fit {listed([photo.name for photo, _ in turned])} both as the files store them "
            "and as viewers show them",
            hint="Say --mask-orientation stored or shown, or save the photos without an "
            "orientation tag",
        )
    words = {False: "as they are stored", True: "as viewers show them"}
    return found[0], [
        f"of photos that their files turn, cameras are taken {words[found[0].camera_shown]} and "
        f"masks {words[found[0].mask_shown]}, because they agree best so"
    ]


def _agreement(
    photos: Sequence[MatchedPhoto], up: Floats, reading: Reading, maker: MaskMaker
) -> float:
    taken = [_upright(photo, up, reading).resized(_TRIED_PX) for photo in photos]
    masks = [_coverage(t, photo, maker)[0] for t, photo in zip(taken, photos, strict=True)]
    world = upright(up)
    return hull_agreement([world.camera(t.camera) for t in taken], masks, coarse=True).mean


def _coverage(taken: TakenPhoto, photo: MatchedPhoto, maker: MaskMaker) -> tuple[Bytes, str]:
    """The coverage of a picture, and where it came from."""
    if taken.alpha is not None:
        return taken.alpha, "the photo's alpha" if photo.mask is None else "a mask file"
    made = maker(taken.rgb)
    return (np.zeros(taken.rgb.shape[:2], np.uint8) if made is None else made), maker.title


def _same_person(views: list[TakenView], *, posed: bool) -> tuple[list[TakenView], list[str]]:
    """The views with one person each: the largest, where several views tell a common place."""
    found = [one_person(view.coverage) for view in views]
    several = [view.photo.name for view, one in zip(views, found, strict=True) if one.others]
    if not several:
        return views, []
    largest = [replace(view, coverage=one.coverage) for view, one in zip(views, found, strict=True)]
    note = f"more than one person in {', '.join(several)}"
    if len(views) < 2 or not posed:
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

"""Masks of a person: made from a photo alone, and which of the people in them is meant.

MediaPipe's network (Pose 0.10.21, Apache-2.0, inside its wheel) marks the person on 256 x 256
pixels; a network that the user imported (``methods/masks``) may do so instead. A guided filter then
moves the outline to the edges that the photo itself has.

Source of the filter: He, Sun, Tang, "Guided Image Filtering", TPAMI 2013.
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from harness.core.arrays import Bytes, Floats, Ints32, Mask
from methods.masks import imported_network
from methods.parts.mediapipe_solutions import solutions, titled

#: Radius of the filter's window as a share of the photo's height, and what it takes for flat, in
#: squared colours of 0 to 1: a step of 0.01.
_RADIUS, _FLAT = 1 / 120, 1e-4
#: The filter leaves a faint veil over similar colours: what is between these becomes 0 to 1.
_VEIL = (0.25, 0.75)
#: Another person is at least so large, as a share of the one chosen, and so far from them, as a
#: share of the photo's height; looked for in a photo of about so many rows.
_OTHER_PERSON, _NEAR, _SMALL_PX = 0.2, 0.02, 256
#: Pieces of a mask with more than this share of the largest one's pixels may be another person;
#: smaller ones are strands of hair, or a hand that a bag parts from the rest.
_PERSON_SIZED = 0.15
#: A frame cuts a person where the mask touches it along more than this share of its side.
_TOUCHING = 0.01


@dataclass(frozen=True, slots=True)
class MaskMaker:
    """What makes masks.

    Attributes:
        title: As captures name it.
        marked: The coverage (H, W), 0 to 1, that a network gives a photo (H, W, 3) uint8; None if
            nobody is in it.
        chooses: Whether the network marks one person where there are several.
    """

    title: str
    marked: Callable[[Bytes], Floats | None]
    chooses: bool

    def __call__(self, rgb: Bytes) -> Bytes | None:
        """(H, W) uint8 coverage by the person in a photo (H, W, 3); None without one.

        Raises:
            MissingPart: what the network needs is not installed.
        """
        rough = self.marked(rgb)
        if rough is None or not (rough > 0.5).any():
            return None
        return _refined(rgb, rough)


def mask_maker(name: str = "") -> MaskMaker:
    """The maker of a name: an imported network, or without a name MediaPipe.

    Raises:
        MissingPart: no network of that name was imported.
        DataError: its file is not the one that was imported.
    """
    if not name:
        return by_mediapipe()
    network = imported_network(name)
    return MaskMaker(f"made with {network.title} and a guided filter", network, chooses=False)


def by_mediapipe() -> MaskMaker:
    """MediaPipe, which marks the most prominent person."""
    title = f"made with {titled('Pose')} and a guided filter"
    return MaskMaker(title, _marked_by_mediapipe, chooses=True)


def _marked_by_mediapipe(rgb: Bytes) -> Floats | None:
    found = _network().process(np.ascontiguousarray(rgb))
    if found.pose_landmarks is None or found.segmentation_mask is None:
        return None
    return np.clip(np.asarray(found.segmentation_mask, dtype=np.float64), 0.0, 1.0)


def _refined(rgb: Bytes, rough: Floats) -> Bytes:
    """(H, W) uint8 coverage whose outline follows the photo's own edges."""
    fine = _guided(rgb / 255.0, rough, max(2, round(_RADIUS * rgb.shape[0])))
    low, high = _VEIL
    return np.round(255 * np.clip((fine - low) / (high - low), 0.0, 1.0)).astype(np.uint8)


def shows_others(rgb: Bytes, coverage: Bytes) -> bool:
    """Whether a photo (H, W, 3) seems to show people besides the one in a made mask (H, W).

    MediaPipe's other segmentation marks all people at once: what it marks away from the mask, in
    one piece about as large as a person, is somebody else.

    Raises:
        MissingPart: MediaPipe is not installed.
    """
    from scipy.ndimage import binary_dilation
    from skimage.measure import label

    everybody = np.asarray(_everybody().process(np.ascontiguousarray(rgb)).segmentation_mask) > 0.5
    step = max(1, rgb.shape[0] // _SMALL_PX)
    chosen = coverage[::step, ::step] >= 128
    reach = max(1, round(_NEAR * chosen.shape[0]))
    near = np.asarray(binary_dilation(chosen, iterations=reach), dtype=bool)
    pieces = np.asarray(label(everybody[::step, ::step] & ~near), dtype=np.int64)
    sizes = np.bincount(pieces.ravel())[1:]
    return bool(len(sizes) and sizes.max() > _OTHER_PERSON * chosen.sum())


def _guided(guide: Floats, values: Floats, radius: int) -> Floats:
    """(H, W) values as linear functions, window by window, of a guide (H, W, 3)."""
    from scipy.ndimage import uniform_filter

    def mean(layer: Floats) -> Floats:
        return np.asarray(uniform_filter(layer, 2 * radius + 1), dtype=np.float64)

    colour = np.stack([mean(guide[..., c]) for c in range(3)], axis=-1)
    middle = mean(values)
    shared = np.stack(
        [mean(guide[..., c] * values) - colour[..., c] * middle for c in range(3)], axis=-1
    )
    spread = np.empty((*values.shape, 3, 3))
    for a in range(3):
        for b in range(a, 3):
            product = mean(guide[..., a] * guide[..., b]) - colour[..., a] * colour[..., b]
            spread[..., a, b] = spread[..., b, a] = product
    slope = np.linalg.solve(spread + _FLAT * np.eye(3), shared[..., None])[..., 0]
    offset = middle - (slope * colour).sum(axis=-1)
    slopes = np.stack([mean(slope[..., c]) for c in range(3)], axis=-1)
    return (slopes * guide).sum(axis=-1) + mean(offset)


@functools.lru_cache(maxsize=1)
def _network() -> Any:
    """The network, loaded once; in still-picture mode it remembers nothing of earlier pictures."""
    return _solutions().pose.Pose(
        static_image_mode=True, model_complexity=1, enable_segmentation=True
    )


@functools.lru_cache(maxsize=1)
def _everybody() -> Any:
    """The network that marks all people, loaded once."""
    return _solutions().selfie_segmentation.SelfieSegmentation(model_selection=0)


def _solutions() -> Any:
    return solutions("making masks", "or give masks with --masks FOLDER")


@dataclass(frozen=True, slots=True, eq=False)
class OnePerson:
    """A mask of which one person is left.

    Attributes:
        coverage: (H, W) uint8.
        others: How many other pieces, each about as large as a person, were taken away.
    """

    coverage: Bytes
    others: int


def one_person(coverage: Bytes, near_px: Floats | None = None) -> OnePerson:
    """One of the people in a mask (H, W): the largest, or the one nearest to a place.

    Pieces that are too small to be a person stay where they are.

    Args:
        coverage: uint8; the subject is where it is at least 128.
        near_px: (2,) pixel coordinates x, y where the person is known to be; None if not known.
    """
    from scipy.ndimage import center_of_mass

    pieces = _pieces(coverage >= 128)
    sizes = np.bincount(pieces.ravel())[1:]
    count = len(sizes)
    if count < 2:
        return OnePerson(coverage, 0)
    people = [piece for piece in range(count) if sizes[piece] > _PERSON_SIZED * sizes.max()]
    if len(people) < 2:
        return OnePerson(coverage, 0)
    chosen = int(np.argmax(sizes))
    if near_px is not None:
        middles = center_of_mass(np.ones_like(pieces), pieces, [piece + 1 for piece in people])
        away = [float(np.hypot(x - near_px[0], y - near_px[1])) for y, x in middles]
        chosen = people[int(np.argmin(away))]
    return OnePerson(_without(coverage, pieces, people, chosen), len(people) - 1)


def _pieces(mask: Mask) -> Ints32:
    """(H, W) the number, from 1 on, of the connected piece that each pixel is in; 0 outside."""
    from skimage.measure import label

    return np.asarray(label(mask, connectivity=1), dtype=np.int32)


def _without(coverage: Bytes, pieces: Ints32, people: list[int], chosen: int) -> Bytes:
    """The mask without all that is nearer to another person's piece than to the chosen one's."""
    from scipy.ndimage import distance_transform_edt

    kept = np.asarray(distance_transform_edt(pieces != chosen + 1))
    other = np.isin(pieces, [piece + 1 for piece in people if piece != chosen])
    nearer = kept <= np.asarray(distance_transform_edt(~other))
    return np.where(nearer, coverage, 0).astype(np.uint8)


def cut_sides(coverage: Bytes) -> tuple[str, ...]:
    """The sides of the frame that cut the person in a mask (H, W) uint8."""
    mask = coverage >= 128
    sides = {"top": mask[0], "bottom": mask[-1], "left": mask[:, 0], "right": mask[:, -1]}
    return tuple(name for name, line in sides.items() if line.mean() > _TOUCHING)

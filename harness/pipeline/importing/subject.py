"""Which of the people in a photo is meant, and where the frame cuts them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.core.arrays import Bytes, Floats, Ints32, Mask

#: Pieces of a mask with more than this share of the largest one's pixels may be another person;
#: smaller ones are strands of hair, or a hand that a bag parts from the rest.
_OTHER_PERSON = 0.15
#: A frame cuts a person where the mask touches it along more than this share of its side.
_TOUCHING = 0.01


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
    people = [piece for piece in range(count) if sizes[piece] > _OTHER_PERSON * sizes.max()]
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

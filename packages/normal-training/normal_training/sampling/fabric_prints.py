"""Prints that are no geometry: stripes, shapes and letters over a texture.

A network that sees only plain and woven cloth takes every edge for a fold. Prints lie on the whole
texture, skin and hair included: as tattoos, make-up and dye do.
"""

from __future__ import annotations

import string

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

_ELEMENTS = (6, 28)
_SIZE = (0.01, 0.09)
_STRIPES_SHARE, _LETTERS_SHARE = 0.35, 0.25
_STRIPE_PERIOD = (0.008, 0.05)
_LONGEST = 8

Texture = NDArray[np.uint8]


def printed(texture: Texture, draw: np.random.Generator) -> Texture:
    """(H, W, 3) uint8: a texture with a few tens of drawn prints on it.

    Args:
        texture: (H, W, 3) sRGB.
        draw: Source of randomness.
    """
    picture = Image.fromarray(texture)
    # Sizes are shares of the texture's side, so that any resolution shows the same prints.
    for _ in range(draw.integers(*_ELEMENTS)):
        stencil = Image.new("L", picture.size, 0)
        kind = draw.random()
        if kind < _STRIPES_SHARE:
            _stripes(stencil, draw)
        elif kind < _STRIPES_SHARE + _LETTERS_SHARE:
            _letters(stencil, draw)
        else:
            _shape(stencil, draw)
        opaque = draw.uniform(0.4, 1.0)
        colour = Image.new("RGB", picture.size, tuple(int(c) for c in draw.integers(0, 256, 3)))
        picture.paste(colour, mask=stencil.point(lambda value, share=opaque: int(value * share)))
    return np.asarray(picture)


def _place(stencil: Image.Image, draw: np.random.Generator) -> tuple[float, float, float]:
    """Column, row and half a size, texels."""
    half = draw.uniform(*_SIZE) * max(stencil.size)
    return draw.uniform(0, stencil.width), draw.uniform(0, stencil.height), half


def _shape(stencil: Image.Image, draw: np.random.Generator) -> None:
    """An ellipse or a polygon."""
    column, row, half = _place(stencil, draw)
    pen = ImageDraw.Draw(stencil)
    if draw.random() < 0.5:
        tall = half * draw.uniform(0.4, 1.0)
        pen.ellipse((column - half, row - tall, column + half, row + tall), fill=255)
        return
    turns = np.sort(draw.uniform(0, 2 * np.pi, draw.integers(3, 9)))
    reach = half * draw.uniform(0.5, 1.0, len(turns))
    pen.polygon(
        [*zip(column + reach * np.cos(turns), row + reach * np.sin(turns), strict=True)], fill=255
    )


def _stripes(stencil: Image.Image, draw: np.random.Generator) -> None:
    """Parallel lines within a square that is turned at random."""
    column, row, half = _place(stencil, draw)
    half *= 3.0
    period = draw.uniform(*_STRIPE_PERIOD) * max(stencil.size)
    turn = draw.uniform(0, np.pi)
    along, across = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
    pen, centre = ImageDraw.Draw(stencil), np.array([column, row])
    width = max(1, round(period * draw.uniform(0.15, 0.6)))
    for offset in np.arange(-half, half, period):
        ends = [tuple(centre + offset * across + side * half * along) for side in (-1, 1)]
        pen.line(ends, fill=255, width=width)


def _letters(stencil: Image.Image, draw: np.random.Generator) -> None:
    column, row, half = _place(stencil, draw)
    letters = draw.choice([*string.ascii_uppercase, *string.digits], draw.integers(1, _LONGEST))
    font = ImageFont.load_default(size=max(8.0, half))
    ImageDraw.Draw(stencil).text((column, row), "".join(letters), fill=255, font=font, anchor="mm")

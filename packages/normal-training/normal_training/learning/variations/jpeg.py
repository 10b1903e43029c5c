"""What JPEG leaves of a picture, worked out on any device, without its file.

What loses something is done: colour at half of the columns and rows, eight by eight cosines in
steps of the standard's tables, and whole numbers at the end. What packs the steps loses nothing and
is left out. Source: ITU-T T.81 (1992), annex K; the tables' scale is that of the Independent JPEG
Group.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

_SIDE = 8
#: Steps of the cosines of brightness and of colour at quality 50.
_BRIGHT = (
    (16, 11, 10, 16, 24, 40, 51, 61),
    (12, 12, 14, 19, 26, 58, 60, 55),
    (14, 13, 16, 24, 40, 57, 69, 56),
    (14, 17, 22, 29, 51, 87, 80, 62),
    (18, 22, 37, 56, 68, 109, 103, 77),
    (24, 35, 55, 64, 81, 104, 113, 92),
    (49, 64, 78, 87, 103, 121, 120, 101),
    (72, 92, 95, 98, 112, 100, 103, 99),
)
_COLOUR = (
    (17, 18, 24, 47, 99, 99, 99, 99),
    (18, 21, 26, 66, 99, 99, 99, 99),
    (24, 26, 56, 99, 99, 99, 99, 99),
    (47, 66, 99, 99, 99, 99, 99, 99),
    *[(99,) * 8] * 4,
)
#: Brightness and two colours of red, green and blue (ITU-R BT.601), and the inverse.
_FROM_RGB = (
    (0.299, 0.587, 0.114),
    (-0.168736, -0.331264, 0.5),
    (0.5, -0.418688, -0.081312),
)
_TO_RGB = ((1.0, 0.0, 1.402), (1.0, -0.344136, -0.714136), (1.0, 1.772, 0.0))
_COSINES = [
    [
        math.sqrt((1 if row == 0 else 2) / _SIDE)
        * math.cos((2 * column + 1) * row * math.pi / (2 * _SIDE))
        for column in range(_SIDE)
    ]
    for row in range(_SIDE)
]


def compressed(light: Tensor, quality: int) -> Tensor:
    """A picture (3, H, W) in [0, 1] as it comes back from a JPEG file of a quality, 1 to 100."""
    height, width = light.shape[1:]
    pixels = (255.0 * light.clamp(0.0, 1.0)).round()
    across, down = -width % (2 * _SIDE), -height % (2 * _SIDE)
    pixels = torch.nn.functional.pad(pixels[None], (0, across, 0, down), mode="replicate")
    planes = torch.einsum("ij,bjhw->bihw", pixels.new_tensor(_FROM_RGB), pixels)
    # Levels are counted from the middle grey, colours from none.
    bright = _stepped(planes[:, :1] - 128.0, _BRIGHT, quality) + 128.0
    colours = torch.nn.functional.avg_pool2d(planes[:, 1:], 2).round()
    colours = _stepped(colours, _COLOUR, quality)
    colours = torch.nn.functional.interpolate(colours, scale_factor=2.0, mode="bilinear")
    found = torch.cat([bright, colours], dim=1)
    rgb = torch.einsum("ij,bjhw->bihw", pixels.new_tensor(_TO_RGB), found)
    return rgb.round().clamp(0.0, 255.0)[0, :, :height, :width] / 255.0


def _stepped(planes: Tensor, table: tuple[tuple[int, ...], ...], quality: int) -> Tensor:
    """Planes (1, C, H, W) whose cosines are whole numbers of steps."""
    scale = 5000 / quality if quality < 50 else 200 - 2 * quality
    steps = ((planes.new_tensor(table) * scale + 50.0) / 100.0).floor().clamp(1.0, 255.0)
    cosines = planes.new_tensor(_COSINES)
    blocks = planes.unfold(2, _SIDE, _SIDE).unfold(3, _SIDE, _SIDE)
    parts = cosines @ blocks @ cosines.T
    blocks = cosines.T @ ((parts / steps).round() * steps) @ cosines
    return blocks.movedim(4, 3).reshape(planes.shape).round().clamp(-128.0, 127.0)

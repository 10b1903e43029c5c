"""Folds of a map made stronger: a network that is unsure of a fold answers with a flatter one.

What is least off on average is flatter than the truth wherever the place of a fold is in doubt.
What a blur takes away from a map is given back with a factor: where its direction is right it comes
nearer to the truth, elsewhere further from it.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

__all__ = ["StrongerFolds"]

#: Standard deviation of the blur: 15 mm on a subject that fills the picture, as ``metrics.folds``.
_BLUR_PX = 4.0
_REACH_PX = 12
#: Three components and the mask.
_MAPS = 4
#: Share of the blur that lies on the subject, from which on it knows all sides of a pixel.
_ONE_SIDED = 0.84


class StrongerFolds(nn.Module):
    """Normals whose difference from their own blur is a number of times as large.

    Args:
        gain: The number; 1 leaves maps as they are.
    """

    column: Tensor
    row: Tensor

    def __init__(self, gain: float) -> None:
        super().__init__()
        self.gain = gain
        offsets = torch.arange(-_REACH_PX, _REACH_PX + 1, dtype=torch.float32)
        weights = torch.exp(-0.5 * (offsets / _BLUR_PX) ** 2)
        weights = (weights / weights.sum()).repeat(_MAPS, 1)
        self.register_buffer("column", weights[:, None, :, None])
        self.register_buffer("row", weights[:, None, None, :])

    def forward(self, normals: Tensor, mask: Tensor) -> Tensor:
        """Normals (B, 3, H, W) of about unit length.

        Args:
            normals: (B, 3, H, W) of any length.
            mask: (B, 1, H, W) 1 where the subject is, 0 elsewhere. Near its edge, where the blur
                knows one side only, normals stay as they are.
        """
        if math.isclose(self.gain, 1.0):
            return normals
        # Folds are differences between numbers that are nearly equal. And on one processor the blur
        # along rows was not done after 100 s in bfloat16, which takes 0.06 s for eight pictures.
        with torch.autocast(normals.device.type, enabled=False):
            return self._stronger(normals.float(), mask.float())

    def _stronger(self, normals: Tensor, mask: Tensor) -> Tensor:
        unit = normals * (normals.square().sum(1, keepdim=True) + 1e-12).rsqrt()
        blurred = self._blurred(torch.cat([unit * mask, mask], dim=1))
        slow, share = blurred.split((3, 1), dim=1)
        slow = slow * (slow.square().sum(1, keepdim=True) + 1e-12).rsqrt()
        known = ((share - _ONE_SIDED) / (1.0 - _ONE_SIDED)).clamp(0.0, 1.0)
        return unit + (self.gain - 1.0) * known * (unit - slow)

    def _blurred(self, maps: Tensor) -> Tensor:
        maps = nn.functional.conv2d(maps, self.column, padding=(_REACH_PX, 0), groups=_MAPS)
        return nn.functional.conv2d(maps, self.row, padding=(0, _REACH_PX), groups=_MAPS)

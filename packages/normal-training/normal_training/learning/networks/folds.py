"""Folds of a map made stronger: a network that is unsure of a fold answers with a flatter one.

What is least off on average is flatter than the truth wherever the place of a fold is in doubt.
What a blur takes away from a map is given back with a factor: where its direction is right it comes
nearer to the truth, elsewhere further from it. Most is lost in creased clothes, in small photos and
with a poor body, and there the network also expects to be far off. So the factor grows with that.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

#: Standard deviation of the blur: 15 mm on a subject that fills 512 pixels, as ``metrics.folds``.
BLUR_PX = 4.0
#: How far it reaches, in standard deviations.
_REACH = 3
#: Three components and the mask.
_MAPS = 4
#: Mean error that the network expects, radians, from which on a map gets the whole factor.
_UNSURE = math.radians(15.0)
#: Share of the blur that lies on the subject, from which on it knows all sides of a pixel.
_ONE_SIDED = 0.84


class StrongerFolds(nn.Module):
    """Normals whose difference from their own blur is a number of times as large.

    Args:
        gain: The number, where the network expects normals to be off by 15 degrees or more on
            average. Below that, what it has beyond 1 falls with the fourth power of this mean, so
            that surer maps nearly stay; 1 leaves all maps as they are.
        blur_px: Standard deviation of the blur, pixels.
    """

    column: Tensor
    row: Tensor

    def __init__(self, gain: float, blur_px: float = BLUR_PX) -> None:
        super().__init__()
        self.gain, self.reach = gain, round(_REACH * blur_px)
        offsets = torch.arange(-self.reach, self.reach + 1, dtype=torch.float32)
        weights = torch.exp(-0.5 * (offsets / blur_px) ** 2)
        weights = (weights / weights.sum()).repeat(_MAPS, 1)
        self.register_buffer("column", weights[:, None, :, None])
        self.register_buffer("row", weights[:, None, None, :])

    def forward(self, normals: Tensor, error: Tensor, mask: Tensor) -> Tensor:
        """Normals (B, 3, H, W) of about unit length.

        Args:
            normals: (B, 3, H, W) of any length.
            error: (B, 1, H, W) how far off they are expected to be, radians.
            mask: (B, 1, H, W) 1 where the subject is, 0 elsewhere. Near its edge, where the blur
                knows one side only, normals stay as they are.
        """
        if math.isclose(self.gain, 1.0):
            return normals
        # Folds are differences between numbers that are nearly equal. And on one processor the blur
        # along rows was not done after 100 s in bfloat16, which takes 0.06 s for eight pictures.
        with torch.autocast(normals.device.type, enabled=False):
            return self._stronger(normals.float(), error.float(), mask.float())

    def _stronger(self, normals: Tensor, error: Tensor, mask: Tensor) -> Tensor:
        unit = normals * (normals.square().sum(1, keepdim=True) + 1e-12).rsqrt()
        blurred = self._blurred(torch.cat([unit * mask, mask], dim=1))
        slow, share = blurred.split((3, 1), dim=1)
        slow = slow * (slow.square().sum(1, keepdim=True) + 1e-12).rsqrt()
        known = ((share - _ONE_SIDED) / (1.0 - _ONE_SIDED)).clamp(0.0, 1.0)
        more = (self.gain - 1.0) * _unsure(error, mask)
        return unit + more * known * (unit - slow)

    def _blurred(self, maps: Tensor) -> Tensor:
        maps = nn.functional.conv2d(maps, self.column, padding=(self.reach, 0), groups=_MAPS)
        return nn.functional.conv2d(maps, self.row, padding=(0, self.reach), groups=_MAPS)


def _unsure(error: Tensor, mask: Tensor) -> Tensor:
    """(B, 1, 1, 1) 1 for maps that may be far off, less for better ones."""
    places = mask.sum((1, 2, 3), keepdim=True).clamp(min=1.0)
    expected = (error * mask).sum((1, 2, 3), keepdim=True) / places
    return (expected / _UNSURE).pow(4).clamp(max=1.0)

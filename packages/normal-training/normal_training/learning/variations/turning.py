"""Samples turned and enlarged in the picture's plane: another view of the same scene, for nothing.

A photo that is turned shows the turned scene under turned light, so normals turn with it; one that
is enlarged shows the same normals from nearer by.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from normal_training.learning.settings import Turning

#: A blend of normals and of nothing is a normal where at least half of it is.
_LEAST_LENGTH = 0.5


class Placement:
    """How the pictures of a batch are turned and enlarged about their middles.

    Args:
        angle: (B,) radians, counter-clockwise on the screen.
        zoom: (B,) factors; above 1 the subject grows.
        device: Of the pictures; the processor unless given.
    """

    def __init__(self, angle: Tensor, zoom: Tensor, device: torch.device | None = None) -> None:
        moved = torch.nonzero((angle != 0) | (zoom != 1))[:, 0]
        angle = angle[moved]
        self._moved, self._cos, self._sin, self._zoom = (
            values.to(device or angle.device)
            for values in (moved, torch.cos(angle), torch.sin(angle), zoom[moved])
        )

    def moved(self, maps: Sequence[Tensor], turning: Sequence[bool]) -> list[Tensor]:
        """Maps (B, C, H, W) where they go; 0 where they say nothing.

        Args:
            maps: All of one height and width.
            turning: Which of them are normals (x right, y up), and turn with the picture.
        """
        if not len(self._moved):
            return list(maps)
        # At once: where each pixel's value comes from is the same for all.
        together = torch.cat([values[self._moved].contiguous() for values in maps], dim=1)
        parts = self._sampled(together).split([values.shape[1] for values in maps], dim=1)
        found = []
        for before, now, turns in zip(maps, parts, turning, strict=True):
            after = before.clone(memory_format=torch.channels_last)
            after[self._moved] = self._turned(now) if turns else now
            found.append(after)
        return found

    def _turned(self, normals: Tensor) -> Tensor:
        x, y, z = normals.split(1, dim=1)
        cos, sin = (value.view(-1, 1, 1, 1) for value in (self._cos, self._sin))
        found = torch.cat([cos * x - sin * y, sin * x + cos * y, z], dim=1)
        # Ten times as fast as the norm over a dimension that is not the last in memory.
        length = found.square().sum(dim=1, keepdim=True).sqrt()
        return torch.where(length >= _LEAST_LENGTH, found / length.clamp(min=1e-6), 0.0)

    def _sampled(self, maps: Tensor) -> Tensor:
        height, width = maps.shape[2:]
        # The inverse, in shares of half the picture's sides.
        shape, zero = width / height, torch.zeros_like(self._cos)
        rows = (
            torch.stack([self._cos, -self._sin / shape, zero], 1),
            torch.stack([self._sin * shape, self._cos, zero], 1),
        )
        inverse = torch.stack(rows, 1) / self._zoom.view(-1, 1, 1)
        grid = torch.nn.functional.affine_grid(inverse, list(maps.shape), align_corners=False)
        return torch.nn.functional.grid_sample(maps, grid, align_corners=False)


def drawn_placement(
    count: int, turning: Turning, draw: torch.Generator, device: torch.device | None = None
) -> Placement:
    """Placements of some pictures; those that are left alone are neither turned nor enlarged."""
    moved = torch.rand(count, generator=draw) < turning.share
    angle = torch.deg2rad(turning.angle_deg * torch.randn(count, generator=draw))
    zoom = torch.exp(turning.zoom * torch.randn(count, generator=draw))
    return Placement(torch.where(moved, angle, 0.0), torch.where(moved, zoom, 1.0), device)

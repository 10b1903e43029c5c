"""The open normal network: a U-Net that corrects the body's normals by what the photo shows.

Two heads as in ECON: the near side, which the photo shows, and the far side, which it only hints
at. A few channels see the photo at half its resolution, where edges and small folds are; most of
the work is done at a quarter and below, so that a processor without a GPU trains it within an hour.
It is fully convolutional: any height and width that 32 divides.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

__all__ = ["MULTIPLE", "NormalNetwork"]

#: Sides of the input are multiples of this.
MULTIPLE = 32
_FOLD = 2
#: Image, mask, body front and back.
_CHANNELS = 3 + 1 + 3 + 3
#: Both sides' normals.
_ANSWERS = 3 + 3


class _Block(nn.Module):
    """Two 3 x 3 convolutions and a shortcut; at the start the shortcut alone."""

    def __init__(self, inside: int, outside: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(inside, outside, 3, padding=1)
        self.second = nn.Conv2d(outside, outside, 3, padding=1)
        # Without normalisation layers a deep sum stays tame only if it starts shallow.
        nn.init.zeros_(self.second.weight)
        self.shortcut = nn.Conv2d(inside, outside, 1) if inside != outside else nn.Identity()

    def forward(self, features: Tensor) -> Tensor:
        inner = self.second(torch.relu(self.first(features)))
        return torch.relu(inner + self.shortcut(features))


class NormalNetwork(nn.Module):
    """Photo, mask and body normals to clothed normals of both sides.

    Args:
        fine: Channels at half the photo's resolution.
        widths: Channels at a quarter of it, and at each half of that.
    """

    def __init__(self, fine: int = 24, widths: tuple[int, ...] = (64, 128, 192, 224)) -> None:
        super().__init__()
        self.fold = nn.PixelUnshuffle(_FOLD)
        self.stem = nn.Conv2d(_CHANNELS * _FOLD**2, fine, 3, padding=1)
        self.enter = nn.Conv2d(fine, widths[0], 4, stride=2, padding=1)
        self.down = nn.ModuleList(
            _Block(before, after)
            for before, after in zip((widths[0], *widths), widths, strict=False)
        )
        self.deepest = _Block(widths[-1], widths[-1])
        self.halve = nn.MaxPool2d(2)
        self.up = nn.ModuleList(
            _Block(deep + level, level)
            for level, deep in zip(widths[-2::-1], widths[:0:-1], strict=True)
        )
        self.enlarge = nn.Upsample(scale_factor=2.0, mode="nearest")
        self.leave = nn.Conv2d(widths[0], 2 * fine * _FOLD**2, 1)
        self.unfold = nn.PixelShuffle(_FOLD)
        self.sharpen = _Block(3 * fine, 2 * fine)
        self.out = nn.Conv2d(2 * fine, _ANSWERS * _FOLD**2, 3, padding=1)
        # At the start the answer is the body's own normals.
        nn.init.zeros_(self.out.weight)
        nn.init.zeros_(self.out.bias)  # type: ignore[arg-type] - it has one

    def forward(
        self, image: Tensor, mask: Tensor, body_front: Tensor, body_back: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Normals (B, 3, H, W) of the near and far side, map frame, of any length.

        Args:
            image: (B, 3, H, W) sRGB in [-1, 1], 0 outside the subject.
            mask: (B, 1, H, W) 1 inside, 0 outside.
            body_front: (B, 3, H, W) unit normals of the body's near side, 0 where there is none.
            body_back: The same of its far side.
        """
        photo = self.fold(torch.cat([image, mask, body_front, body_back], dim=1))
        fine = torch.relu(self.stem(photo))
        features = torch.relu(self.enter(fine))
        seen: list[Tensor] = []
        for level, block in enumerate(self.down):
            features = block(self.halve(features) if level else features)
            seen.append(features)
        features = self.deepest(features)
        for block, beside in zip(self.up, seen[-2::-1], strict=True):
            features = block(torch.cat([self.enlarge(features), beside], dim=1))
        features = torch.cat([self.unfold(self.leave(features)), fine], dim=1)
        front, back = self.unfold(self.out(self.sharpen(features))).split(3, dim=1)
        return body_front + front, body_back + back


class Mirrored(nn.Module):
    """A network's mean answer to a scene and to its mirror image, which have one truth."""

    turn: Tensor

    def __init__(self, network: NormalNetwork) -> None:
        super().__init__()
        self.network = network
        self.register_buffer("turn", torch.tensor([-1.0, 1.0, 1.0]).view(1, 3, 1, 1))

    def forward(
        self, image: Tensor, mask: Tensor, body_front: Tensor, body_back: Tensor
    ) -> tuple[Tensor, Tensor]:
        """As ``NormalNetwork.forward``."""
        plain = self.network(image, mask, body_front, body_back)
        mirrored = self.network(
            image.flip(3),
            mask.flip(3),
            body_front.flip(3) * self.turn,
            body_back.flip(3) * self.turn,
        )
        front, back = (
            (one + other.flip(3) * self.turn) / 2.0
            for one, other in zip(plain, mirrored, strict=True)
        )
        return front, back

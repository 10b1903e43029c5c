"""The open normal network: a U-Net that corrects the body's normals by what the photo shows.

Two heads as in ECON: the near side, which the photo shows, and the far side, which it only hints
at. A few channels see the photo at half its resolution, where edges and small folds are; most of
the work is done at a quarter and below, and at a thirty-second of it every place attends to every
other: light and pose are matters of the whole picture. It is fully convolutional: any height and
width that 32 divides.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

import torch
from torch import Tensor, nn

from methods.normals.onnx_estimator import MULTIPLE
from normal_training.learning.networks.folds import StrongerFolds

#: Image, mask, body front and back.
CHANNELS = 3 + 1 + 3 + 3
#: Both sides' normals, and the logarithms of their expected errors.
_ANSWERS = 3 + 3 + 1 + 1
_HEADS = 4
#: Pixels added at the left, right, top and bottom of a picture that is moved: no multiple of a
#: coarser pixel's side, but together one of the coarsest.
_MOVE = (13, MULTIPLE - 13, 3, MULTIPLE - 3)
#: At the start every normal is expected to be 20 degrees off.
_FIRST_ERROR = -1.05


class Answer(NamedTuple):
    """What a network says of a batch (a tuple, because ONNX files are made from such).

    Attributes:
        front: (B, 3, H, W) normals of the near side, map frame, of any length.
        back: The same of the far side.
        front_error: (B, 1, H, W) chord, about the angle in radians, by which the network expects
            ``front`` to be off.
        back_error: The same of ``back``.
    """

    front: Tensor
    back: Tensor
    front_error: Tensor
    back_error: Tensor


class Block(nn.Module):
    """Two 3 x 3 convolutions beside a shortcut; at the start the shortcut alone."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(channels, channels, 3, padding=1)
        self.second = nn.Conv2d(channels, channels, 3, padding=1)
        # Without normalisation layers a deep sum stays tame only if it starts shallow.
        nn.init.zeros_(self.second.weight)
        nn.init.zeros_(self.second.bias)  # type: ignore[arg-type] - it has one

    def forward(self, features: Tensor) -> Tensor:
        """Features (B, C, H, W), and what the convolutions add to them."""
        return features + self.second(torch.relu(self.first(torch.relu(features))))


class _Attention(nn.Module):
    """Every place looks at every other; at the start at none."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.normalise = nn.LayerNorm(channels)
        self.ask = nn.Conv2d(channels, 3 * channels, 1)
        self.answer = nn.Conv2d(channels, channels, 1)
        nn.init.zeros_(self.answer.weight)

    def forward(self, features: Tensor) -> Tensor:
        alike = self.normalise(features.permute(0, 2, 3, 1)).permute(0, 3, 1, 2)
        asked = self.ask(alike).flatten(2).unflatten(1, (3, _HEADS, -1)).transpose(-1, -2)
        query, key, value = asked.unbind(1)
        found = nn.functional.scaled_dot_product_attention(query, key, value)
        return features + self.answer(found.transpose(-1, -2).reshape(features.shape))


def _blocks(count: int, channels: int) -> nn.Sequential:
    return nn.Sequential(*[Block(channels) for _ in range(count)])


class NormalNetwork(nn.Module):
    """Photo, mask and body normals to clothed normals of both sides.

    Args:
        fine: Channels at half the photo's resolution.
        widths: Channels at a quarter of it, and at each half of that; multiples of four.
        depths: Blocks on the way down at each of these.
        lifted: Blocks on the way up at each of them but the last.
        sharp: Blocks at half the photo's resolution, before anything else sees it and at the end:
            a third of what is wrong with smooth clothes, and two fifths with creased ones, is
            finer than three pixels.
    """

    def __init__(
        self,
        fine: int = 24,
        widths: tuple[int, ...] = (64, 128, 224, 288),
        depths: tuple[int, ...] = (2, 2, 2, 2),
        lifted: tuple[int, ...] = (2, 1, 1),
        sharp: tuple[int, int] = (1, 2),
    ) -> None:
        super().__init__()
        self.stem = nn.Conv2d(CHANNELS, fine, 6, stride=2, padding=2)
        self.look = _blocks(sharp[0], fine)
        self.enter = nn.Conv2d(fine, widths[0], 4, stride=2, padding=1)
        self.halve = nn.ModuleList(
            nn.Conv2d(before, after, 2, stride=2) for before, after in itertools.pairwise(widths)
        )
        self.down = nn.ModuleList(map(_blocks, depths, widths))
        self.attend = _Attention(widths[-1])
        self.deepest = Block(widths[-1])
        self.lift = nn.ModuleList(
            nn.Conv2d(deep, level, 1)
            for level, deep in zip(widths[-2::-1], widths[:0:-1], strict=True)
        )
        self.up = nn.ModuleList(map(_blocks, lifted[::-1], widths[-2::-1]))
        self.enlarge = nn.Upsample(scale_factor=2.0, mode="nearest")
        self.leave = nn.ConvTranspose2d(widths[0], 2 * fine, 2, stride=2)
        self.sharpen = nn.Conv2d(3 * fine, 2 * fine, 3, padding=1)
        self.refine = _blocks(sharp[1], 2 * fine)
        self.out = nn.ConvTranspose2d(2 * fine, _ANSWERS, 6, stride=2, padding=2)
        # At the start the answer is the body's own normals.
        nn.init.zeros_(self.out.weight)
        with torch.no_grad():
            start = torch.tensor([0.0] * 6 + [_FIRST_ERROR] * 2)
            self.out.bias.copy_(start)  # type: ignore[union-attr] - it has one

    def forward(self, image: Tensor, mask: Tensor, body_front: Tensor, body_back: Tensor) -> Answer:
        """Normals of both sides, and how far off they may be.

        Args:
            image: (B, 3, H, W) sRGB in [-1, 1], 0 outside the subject.
            mask: (B, 1, H, W) 1 inside, 0 outside.
            body_front: (B, 3, H, W) unit normals of the body's near side, 0 where there is none.
            body_back: The same of its far side.
        """
        seen_at_once = torch.cat([image, mask, body_front, body_back], dim=1)
        fine = self.look(torch.relu(self.stem(seen_at_once)))
        features = self.enter(fine)
        seen: list[Tensor] = []
        for level, blocks in enumerate(self.down):
            features = blocks(self.halve[level - 1](features) if level else features)
            seen.append(features)
        features = self.deepest(_packed(self.attend(features)))
        for lift, blocks, beside in zip(self.lift, self.up, seen[-2::-1], strict=True):
            features = blocks(self.enlarge(lift(features)) + beside)
        features = self.leave(torch.relu(features))
        features = torch.relu(self.sharpen(torch.cat([features, fine], dim=1)))
        features = self.refine(features)
        front, back, front_error, back_error = self.out(features).split((3, 3, 1, 1), dim=1)
        return Answer(body_front + front, body_back + back, front_error.exp(), back_error.exp())


def _packed(features: Tensor) -> Tensor:
    # What attention returns lies otherwise in memory, and everything after it would be slower.
    return features.contiguous(memory_format=torch.channels_last)


class Averaged(nn.Module):
    """A network's mean answer to a picture, its mirror image, and both moved by a few pixels.

    All four have one truth. A picture that is moved meets the network's coarser pixels elsewhere.

    Args:
        network: The network.
        fold_gain: How many times as strong the mean's folds become in front where the network is
            unsure; less elsewhere.
        every: Whether it answers to all four, or else to the picture and to the mirror image that
            is moved: half of the work for most of the gain.
    """

    turn: Tensor

    def __init__(self, network: NormalNetwork, fold_gain: float = 1.0, every: bool = True) -> None:
        super().__init__()
        self.network, self.every = network, every
        self.stronger = StrongerFolds(fold_gain)
        self.register_buffer("turn", torch.tensor([-1.0, 1.0, 1.0]).view(1, 3, 1, 1))

    def forward(self, image: Tensor, mask: Tensor, body_front: Tensor, body_back: Tensor) -> Answer:
        """As ``NormalNetwork.forward``."""
        scene = (image, mask, body_front, body_back)
        turned = (image.flip(3), mask.flip(3), self._turned(body_front), self._turned(body_back))
        answers = [self.network(*scene)]
        if self.every:
            answers += [self._moved(*scene), self._turned_back(self.network(*turned))]
        answers.append(self._turned_back(self._moved(*turned)))
        front, back, front_error, back_error = (
            torch.stack(same).mean(0) for same in zip(*answers, strict=True)
        )
        return Answer(self.stronger(front, front_error, mask), back, front_error, back_error)

    def _turned(self, normals: Tensor) -> Tensor:
        return normals.flip(3) * self.turn

    def _turned_back(self, answer: Answer) -> Answer:
        front, back, front_error, back_error = answer
        return Answer(
            self._turned(front), self._turned(back), front_error.flip(3), back_error.flip(3)
        )

    def _moved(self, *scene: Tensor) -> Answer:
        answer = self.network(*(nn.functional.pad(channels, _MOVE) for channels in scene))
        left, right, top, bottom = _MOVE
        return Answer(*(channels[..., top:-bottom, left:-right] for channels in answer))

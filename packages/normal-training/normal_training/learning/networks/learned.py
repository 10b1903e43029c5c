"""What a training makes: one network, or both of a ``Detailed`` together; and how it is judged."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor, nn

from normal_training.learning.losses import total
from normal_training.learning.networks.detailed import Detailed, reduced_normals
from normal_training.learning.networks.network import Answer, NormalNetwork
from normal_training.learning.samples import Batch
from normal_training.learning.settings import TrainingSettings
from normal_training.learning.variations.drawing import corner

#: A reduced pixel's normal is asked for if so much of the pixel knows one.
_HALF = 0.5


class Learned(Protocol):
    """A kind of network, and what its training makes small."""

    def network(self) -> nn.Module:
        """One as training starts with; of photos, masks and bodies it makes an ``Answer``."""
        ...

    def loss(
        self, network: nn.Module, batch: Batch, settings: TrainingSettings, draw: torch.Generator
    ) -> Tensor:
        """(), the loss of such a network on a batch, whose source of randomness goes on."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Alone:
    """One network.

    Attributes:
        start: Its first weights; random ones unless given.
        make: Returns a new one.
    """

    start: Mapping[str, Tensor] | None = None
    make: Callable[[], NormalNetwork] = NormalNetwork

    def network(self) -> nn.Module:
        """See ``Learned``."""
        return _started(self.make(), self.start)

    def loss(
        self, network: nn.Module, batch: Batch, settings: TrainingSettings, draw: torch.Generator
    ) -> Tensor:
        """That of its answer."""
        del draw
        return total(answered(network, batch), batch, settings.losses)


@dataclass(frozen=True, slots=True, eq=False)
class Together:
    """Both networks of a ``Detailed``.

    The first one's mean answer to whole people and to their mirror image, moved, is judged at two
    thirds of the photo's size. The second one is given this answer, and judged in windows around
    some of each person's pixels. It does not move the first one's weights.

    Attributes:
        start: First weights of both; random ones unless given.
        make: Returns a new network of either kind.
    """

    start: Mapping[str, Tensor] | None = None
    make: Callable[[], NormalNetwork] = NormalNetwork

    def network(self) -> nn.Module:
        """See ``Learned``."""
        return _started(Detailed(self.make(), self.make()), self.start)

    def loss(
        self, network: nn.Module, batch: Batch, settings: TrainingSettings, draw: torch.Generator
    ) -> Tensor:
        """(), the sum of both losses."""
        assert isinstance(network, Detailed)
        # First, because reading them back waits for everything that is queued on the device.
        corners = _corners(batch.mask, settings, draw)
        first = network.first
        small = _small(network, batch)
        with _halved(batch):
            answer = first.whole(small.image, small.mask, small.body_front, small.body_back)
        answer = _single(answer)
        with torch.no_grad():
            front, back = first.enlarged(answer, batch.mask)
        near = _windows(batch, front, back, corners, _size(batch.mask, settings))
        losses = settings.losses
        return total(answer, small, losses) + total(answered(network.detail, near), near, losses)


def _started(network: nn.Module, start: Mapping[str, Tensor] | None) -> nn.Module:
    # Blocks that an earlier network had not keep their first values.
    network.load_state_dict({**network.state_dict(), **(start or {})})
    return network


def answered(network: nn.Module, batch: Batch) -> Answer:
    """What a network says of a batch, worked out with half the digits where that is faster."""
    with _halved(batch):
        return _single(network(batch.image, batch.mask, batch.body_front, batch.body_back))


def _single(answer: Answer) -> Answer:
    return Answer(*(values.float() for values in answer))


def _halved(batch: Batch) -> torch.autocast:
    kind = batch.image.device.type
    return torch.autocast(kind, dtype=torch.bfloat16, enabled=_gains(kind))


def _gains(kind: str) -> bool:
    """Whether a kind of processor multiplies bfloat16 matrices faster than float32."""
    if kind == "cuda":
        return torch.cuda.is_bf16_supported()
    able = torch.cpu.get_capabilities()
    return bool(able.get("amx_bf16", False) or able.get("avx512_bf16", False))


def _small(network: Detailed, batch: Batch) -> Batch:
    """The batch as the first network sees it, with its truth at that size."""
    with torch.no_grad():
        scene = network.first.seen(batch.image, batch.mask, batch.body_front, batch.body_back)
        insides = [batch.front_inside, batch.back_inside]
        known = [batch.front * insides[0], batch.back * insides[1]]
        # As many maps as the scene has; the last two say nothing new.
        means = network.first.reduced(torch.cat([*known, *insides, *insides], dim=1))
        front, back, *shares = means[:, :8].split((3, 3, 1, 1), dim=1)
        normals = [reduced_normals(values) for values in (front, back)]
        inside = [
            scene[1] * (share >= _HALF) * (unit.abs().sum(1, keepdim=True) > 0)
            for share, unit in zip(shares, normals, strict=True)
        ]
        return Batch(*scene, *normals, *inside)


def _corners(
    mask: Tensor, settings: TrainingSettings, draw: torch.Generator
) -> list[tuple[int, int, int]]:
    """Picture, column and row of the corners of windows around random pixels of masks."""
    count, (across, down) = settings.windows.near_count, _size(mask, settings)
    height, width = mask.shape[2:]
    order = mask.flatten(1).cumsum(1, dtype=torch.int32)
    share = torch.rand(len(mask), count, generator=draw).to(mask.device)
    wanted = (share * order[:, -1:]).int() + 1
    places = torch.searchsorted(order, wanted).clamp(max=height * width - 1).tolist()
    return [
        (
            number,
            corner(place % width, across, width),
            corner(place // width, down, height),
        )
        for number, row in enumerate(places)
        for place in row
    ]


def _size(mask: Tensor, settings: TrainingSettings) -> tuple[int, int]:
    """Columns and rows of windows: as asked for, or all of a smaller sample."""
    across, down = settings.windows.near_px
    return min(across, mask.shape[3]), min(down, mask.shape[2])


def _windows(
    batch: Batch,
    front: Tensor,
    back: Tensor,
    corners: list[tuple[int, int, int]],
    size: tuple[int, int],
) -> Batch:
    """The batch in windows, with first answers in place of bodies."""
    across, down = size
    maps = (
        batch.image,
        batch.mask,
        front,
        back,
        batch.front,
        batch.back,
        batch.front_inside,
        batch.back_inside,
    )
    together = torch.cat(maps, dim=1)
    cut = torch.stack(
        [
            together[number, :, top : top + down, left : left + across]
            for number, left, top in corners
        ]
    ).contiguous(memory_format=torch.channels_last)
    return Batch(*cut.split([values.shape[1] for values in maps], dim=1))

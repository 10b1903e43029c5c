"""Two networks, one after the other: the first sees the whole person, the second sees it larger.

A network that knows where arms and folds are has to see the whole person, and so sees it small: at
512 pixels, two fifths of what is wrong with creased clothes is finer than three of them. The second
network sees the photo one and a half times as large, and in place of the body the first one's
answer. It only has to know what is near a pixel, and is trained on windows from nearby.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from methods.normals.onnx_estimator import MULTIPLE
from normal_training.learning.networks.folds import BLUR_PX, StrongerFolds
from normal_training.learning.networks.network import CHANNELS, Answer, Averaged, NormalNetwork
from normal_training.learning.settings import LARGER

#: Pixels of the small picture for pixels of the large one.
_OUT, _IN = 2, 3
#: Sides of the large picture are multiples of this, so that both networks' are multiples of theirs.
_MULTIPLE = _IN * MULTIPLE
#: A reduced pixel belongs to the subject if so much of it does, and to the body if its mean normal
#: is so long.
_HALF = 0.5


class Detailed(nn.Module):
    """The answer of a second network to a large picture and to a first one's answer to a small one.

    The first one answers to the picture and to its mirror image, moved, and the mean is taken. The
    second one answers once: two answers would be 0.1 to 0.2 degrees better, and take 1.4 times as
    long in all.

    Args:
        whole: The first network.
        detail: The second one.
        fold_gain: As for ``Averaged``, of the second one's answer.
    """

    def __init__(self, whole: NormalNetwork, detail: NormalNetwork, fold_gain: float = 1.0) -> None:
        super().__init__()
        self.first = FirstLook(whole)
        self.detail = detail
        self.stronger = StrongerFolds(fold_gain, blur_px=LARGER * BLUR_PX)

    def forward(self, image: Tensor, mask: Tensor, body_front: Tensor, body_back: Tensor) -> Answer:
        """As ``NormalNetwork.forward``, of a picture that is one and a half times as large."""
        first_front, first_back = self.first(image, mask, body_front, body_back)
        front, back, front_error, back_error = self.detail(image, mask, first_front, first_back)
        return Answer(self.stronger(front, front_error, mask), back, front_error, back_error)


class FirstLook(nn.Module):
    """A network's answer to a picture that it sees at two thirds of its size.

    Args:
        whole: The network.
    """

    def __init__(self, whole: NormalNetwork) -> None:
        super().__init__()
        self.whole = Averaged(whole, every=False)
        self.reduce = _Reduced()
        self.enlarge = nn.Upsample(scale_factor=LARGER, mode="bilinear", align_corners=False)

    def forward(
        self, image: Tensor, mask: Tensor, body_front: Tensor, body_back: Tensor
    ) -> tuple[Tensor, Tensor]:
        """(B, 3, H, W) unit normals of both sides, 0 outside the mask.

        Args:
            image: As for ``NormalNetwork.forward``; so are the others.
            mask: 1 inside, 0 outside.
            body_front: Normals of the body's near side.
            body_back: Those of its far side.
        """
        return self.enlarged(self.whole(*self.seen(image, mask, body_front, body_back)), mask)

    def seen(
        self, image: Tensor, mask: Tensor, body_front: Tensor, body_back: Tensor
    ) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """The same four maps as the network sees them: reduced, in a frame of its own."""
        scene = torch.cat([(image + 1.0) * mask, mask, body_front, body_back], dim=1)
        bright, share, *bodies = self.reduced(scene).split((3, 1, 3, 3), dim=1)
        inside = (share >= _HALF).to(image.dtype)
        near, far = (reduced_normals(normals) for normals in bodies)
        return (bright - 1.0) * inside, inside, near, far

    def reduced(self, maps: Tensor) -> Tensor:
        """Maps (B, 10, H, W) at two thirds of their size, in the network's frame."""
        return self.reduce(nn.functional.pad(maps, _rim(maps)))

    def enlarged(self, answer: Answer, mask: Tensor) -> tuple[Tensor, Tensor]:
        """What the network says, as ``forward`` returns it."""
        left, _, top, _ = _rim(mask)
        height, width = mask.shape[2:]
        # Half the digits are too few for a direction.
        sides = [_unit(normals.float()) for normals in (answer.front, answer.back)]
        large = self.enlarge(torch.cat(sides, dim=1))
        large = large[..., top : top + height, left : left + width]
        front, back = large.split(3, dim=1)
        return _unit(front) * mask, _unit(back) * mask


def reduced_normals(means: Tensor) -> Tensor:
    """Unit normals of reduced ones (B, 3, H, W), 0 where less than half of a pixel has any."""
    return _unit(means) * (_length(means) >= _HALF).to(means.dtype)


def _rim(maps: Tensor) -> tuple[int, int, int, int]:
    """Pixels that are added at the left, right, top and bottom."""
    height, width = maps.shape[2:]
    # Shared between both sides: the subject stays in the middle.
    across, down = -width % _MULTIPLE, -height % _MULTIPLE
    left, top = across // 2, down // 2
    return left, across - left, top, down - top


class _Reduced(nn.Module):
    """Maps at two thirds of their size: each pixel is the mean over what it covers."""

    kernel: Tensor

    def __init__(self) -> None:
        super().__init__()
        # The first of two pixels covers one of three and half of the next. Whole numbers are kept
        # exactly in a file of half precision.
        shares = torch.tensor([[2.0, 1.0, 0.0], [0.0, 1.0, 2.0]])
        kernel = torch.einsum("ai,bj->abij", shares, shares).reshape(-1, 1, _IN, _IN)
        self.register_buffer("kernel", kernel.repeat(CHANNELS, 1, 1, 1))
        self.together = nn.PixelShuffle(_OUT)

    def forward(self, maps: Tensor) -> Tensor:
        """(B, 10, 2H/3, 2W/3) of maps (B, 10, H, W)."""
        # Half the digits are too few for what a photo shows.
        with torch.autocast(maps.device.type, enabled=False):
            means = nn.functional.conv2d(maps, self.kernel, stride=_IN, groups=CHANNELS)
        return self.together(means) / _IN**2


def _length(normals: Tensor) -> Tensor:
    return normals.square().sum(1, keepdim=True).sqrt()


def _unit(normals: Tensor) -> Tensor:
    # What is nearly nothing has no direction, and would differ from one processor to the next.
    return normals / _length(normals).clamp(min=_HALF)

"""How a normal network is trained; needs no PyTorch, so that a command line can offer it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import StrEnum

#: How many times as large as the first network the second one sees a photo: 3 pixels for 2.
LARGER = 1.5

#: More columns than any sample has.
_WHOLE_PX = 4096


class NetworkPart(StrEnum):
    """Which network of two is trained: the first, which sees the person smaller, or the second."""

    FIRST = "first"
    SECOND = "second"
    BOTH = "both"


@dataclass(frozen=True, slots=True)
class LossWeights:
    """Factors of the parts of the loss; the chord of the near side has 1.

    Attributes:
        back: The far side is guessed from the near side's photo: it may not pull the features too
            far.
        steps: How normals change from pixel to pixel.
        expected: The network's estimate of its own error.
    """

    back: float = 0.5
    steps: float = 0.3
    expected: float = 0.05


@dataclass(frozen=True, slots=True)
class FaultShares:
    """Shares of the pictures that have each fault of a camera, a file or a mask.

    Attributes:
        blur: Out of focus or moved.
        small: Taken at a lower resolution.
        grain: With noise that neighbouring pixels share.
        sharp: Sharpened, as telephones do.
        packed: Compressed by JPEG.
        rim: With a mask that is a pixel or two too large or too small.
        cut: With feet or head beyond the frame.
    """

    blur: float = 0.25
    small: float = 0.15
    grain: float = 0.3
    sharp: float = 0.2
    packed: float = 0.15
    rim: float = 0.3
    cut: float = 0.1


@dataclass(frozen=True, slots=True)
class Turning:
    """How samples are turned and enlarged in the picture's plane.

    Attributes:
        share: Share of the pictures that are moved at all.
        angle_deg: Standard deviation of the turns.
        zoom: Standard deviation of the logarithm of the enlargement.
    """

    share: float = 0.6
    angle_deg: float = 10.0
    zoom: float = 0.1


@dataclass(frozen=True, slots=True)
class Windows:
    """Which part of each sample a step sees.

    Most of a sample is empty. A step sees either a strip of its full height, or more samples, as
    many as have the same number of pixels, each from nearby.

    Attributes:
        strip_px: Columns of a strip, at random.
        near_share: Share of the steps that look from nearby.
        near_px: Columns and rows of what these see, around a random pixel of the subject.
        rim_px: What is taken beside that, so that turning it brings no emptiness in.
        near_count: Windows of this kind of each sample, where both networks are trained: the first
            one sees all of the sample, the second one these.
    """

    strip_px: int = 256
    near_share: float = 0.5
    near_px: tuple[int, int] = (192, 256)
    rim_px: int = 24
    near_count: int = 3

    @property
    def wide_near(self) -> tuple[int, int]:
        """Columns and rows of what is seen from nearby, rim included."""
        width, height = self.near_px
        return width + 2 * self.rim_px, height + 2 * self.rim_px


@dataclass(frozen=True, slots=True)
class TrainingSettings:
    """How a network is trained.

    Attributes:
        steps: Number of optimiser steps.
        batch: Number of strips in each step; see ``Windows``.
        rate: Greatest learning rate (Muon; warm-up, then a half cosine).
        decay: Weight decay.
        judge_every: Steps between two looks at the held-out subjects; a checkpoint each.
        seed: Seed of weights, order and augmentation.
        losses: Factors of the parts of the loss.
        faults: How often cameras and masks are at fault.
        turning: How samples are turned and enlarged.
        windows: Which part of each sample a step sees.
        relit: Share of the photos that are seen in another light than they were taken in.
        start: Content id of the weights that training starts from; empty for random ones.
    """

    steps: int = 1500
    batch: int = 8
    rate: float = 3e-3
    decay: float = 1e-2
    judge_every: int = 100
    seed: int = 0
    losses: LossWeights = field(default_factory=LossWeights)
    faults: FaultShares = field(default_factory=FaultShares)
    turning: Turning = field(default_factory=Turning)
    windows: Windows = field(default_factory=Windows)
    relit: float = 0.7
    start: str = ""

    def of(self, part: NetworkPart) -> TrainingSettings:
        """The same for one of two networks, or for both."""
        if part is NetworkPart.SECOND:
            # In another light than the photo was taken in, the first one would have answered
            # otherwise.
            return replace(self, windows=replace(self.windows, near_share=1.0), relit=0.0)
        if part is NetworkPart.BOTH:
            return replace(self, windows=replace(self.windows, strip_px=_WHOLE_PX, near_share=0.0))
        return self

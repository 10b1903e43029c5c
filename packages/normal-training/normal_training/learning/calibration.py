"""Whether a network's expected errors are its true ones, on samples that it never saw."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor, nn

from harness.core.files.atomic import atomic_path
from normal_training.learning.losses import Pixels, chord
from normal_training.learning.samples import Samples

_BINS = 10


@dataclass(frozen=True, slots=True)
class Bin:
    """Pixels whose normals are expected to be off by about as much.

    Attributes:
        expected_deg: Mean expected error, degrees.
        actual_deg: Mean error, degrees.
        pixels: Their number.
    """

    expected_deg: float
    actual_deg: float
    pixels: int


@dataclass(frozen=True, slots=True)
class Reliability:
    """One side's expected errors against the true ones.

    Attributes:
        side: ``front`` or ``back``.
        bins: Tenths of all pixels, by their expected error.
    """

    side: str
    bins: tuple[Bin, ...]

    @property
    def calibration_error_deg(self) -> float:
        """Mean over pixels of how far their bin's expected error is from its true one, degrees."""
        total = sum(part.pixels for part in self.bins)
        off = sum(part.pixels * abs(part.expected_deg - part.actual_deg) for part in self.bins)
        return off / max(1, total)


def measured(network: nn.Module, judges: Samples) -> tuple[Reliability, Reliability]:
    """Front and back reliability of a network, on the processor, over all pixels of samples."""
    network = network.to("cpu").eval()
    rows: dict[str, list[Tensor]] = {"front": [], "back": []}
    with torch.no_grad():
        for index in range(len(judges)):
            batch = judges.at([index])
            answer = network(batch.image, batch.mask, batch.body_front, batch.body_back)
            for side, normals, error, true, inside in (
                ("front", answer.front, answer.front_error, batch.front, batch.front_inside),
                ("back", answer.back, answer.back_error, batch.back, batch.back_inside),
            ):
                pixels = Pixels.of(inside)
                unit = torch.nn.functional.normalize(pixels.rows(normals), dim=1, eps=1e-6)
                truth = torch.nn.functional.normalize(pixels.rows(true), dim=1, eps=1e-6)
                rows[side].append(torch.stack([pixels.rows(error)[:, 0], chord(unit - truth)], 1))
    front, back = (_binned(side, torch.cat(found)) for side, found in rows.items())
    return front, back


def _binned(side: str, rows: Tensor) -> Reliability:
    """From rows (N, 2) of expected and true chords."""
    ordered = rows[rows[:, 0].argsort()].double()
    parts = [part for part in ordered.tensor_split(_BINS) if len(part)]
    means = [part.mean(0) for part in parts]
    bins = [
        Bin(_degrees(mean[0]), _degrees(mean[1]), len(part))
        for mean, part in zip(means, parts, strict=True)
    ]
    return Reliability(side, tuple(bins))


def _degrees(length: Tensor) -> float:
    """The angle whose chord has a length."""
    return float(torch.rad2deg(2.0 * torch.asin((length / 2.0).clamp(max=1.0))))


def write_reliability(path: Path, sides: Sequence[Reliability]) -> None:
    """Write all bins as CSV."""
    with atomic_path(path) as temporary, temporary.open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(["side", "expected_deg", "actual_deg", "pixels"])
        for side in sides:
            for part in side.bins:
                expected, actual = (f"{v:.4f}" for v in (part.expected_deg, part.actual_deg))
                writer.writerow([side.side, expected, actual, part.pixels])

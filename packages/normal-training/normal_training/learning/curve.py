"""How a training goes: what is measured between steps, and the file of it."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path

from harness.core.files.atomic import atomic_path


@dataclass(frozen=True, slots=True)
class Look:
    """One look at the held-out subjects.

    Attributes:
        step: Optimiser steps so far.
        seconds: Time that they took.
        loss: Running mean of the loss.
        front_deg, back_deg: Mean angles to the truth over all pixels, degrees.
        body_front_deg, body_back_deg: The same of the bodies that the network was given.
    """

    step: int
    seconds: float
    loss: float
    front_deg: float
    back_deg: float
    body_front_deg: float
    body_back_deg: float

    def __str__(self) -> str:
        return (
            f"step {self.step}: loss {self.loss:.4f}, held out: front {self.front_deg:.2f} deg "
            f"(body {self.body_front_deg:.2f}), back {self.back_deg:.2f} "
            f"(body {self.body_back_deg:.2f})"
        )


def write_curve(path: Path, looks: Sequence[Look]) -> None:
    """Write looks as CSV, a line each below the names of their values."""
    names = [field.name for field in fields(Look)]
    with atomic_path(path) as temporary, temporary.open("w", newline="") as stream:
        writer = csv.DictWriter(stream, names)
        writer.writeheader()
        writer.writerows(asdict(look) for look in looks)

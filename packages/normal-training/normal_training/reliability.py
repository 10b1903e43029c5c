"""The picture of a network's calibration: expected errors against true ones."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from reports.figures.panels import save

if TYPE_CHECKING:
    # PyTorch takes seconds to import.
    from normal_training.learning.calibration import Reliability


def draw_reliability(sides: Sequence[Reliability], path: Path) -> Path:
    """Draw a line for each side, a point for each bin; returns the file.

    Points on the diagonal are right: as far off as expected. Above it the network is too sure.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.2, 4.0), layout="constrained")
    axes = figure.subplots()
    most = max(max(part.expected_deg, part.actual_deg) for side in sides for part in side.bins)
    axes.plot([0, most], [0, most], color="0.7", linewidth=1)
    for side in sides:
        label = f"{side.side}: {side.calibration_error_deg:.2f} deg off"
        expected = [part.expected_deg for part in side.bins]
        axes.plot(expected, [part.actual_deg for part in side.bins], "o-", label=label)
    axes.set_xlabel("expected error (deg)")
    axes.set_ylabel("true error (deg)")
    axes.set_xlim(0, None)
    axes.set_ylim(0, None)
    axes.set_aspect("equal")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=8)
    save(figure, path)
    return path

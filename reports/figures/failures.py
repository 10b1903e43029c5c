"""The failure figure: where each method is worst on the subjects that suit it least.

The mean over a person hides a lost hand. Here the region with the largest error is outlined where
it should be, and named with its number.
"""

import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats
from harness.core.artifacts import Capture
from harness.core.camera import Camera
from harness.core.errors import HarnessError
from harness.core.mesh import Mesh
from harness.core.records import Record, RegionErrors
from harness.geometry.raycast import Raycaster
from reports.figures.comparison import colour_bar
from reports.figures.panels import (
    ErrorScale,
    canvas,
    heat,
    on_white,
    panel_windows,
    photo,
    save,
    shaded,
    show,
)
from reports.tables.regions import LEAST_SHARE

_PANEL_INCH = 3.2
_TITLE_LENGTH = 22
_LEAST_HEIGHT = 420
#: Height of the pictures in which the view is chosen, pixels.
_GLANCE_HEIGHT = 120
_OUTLINE = "#ff2a2a"
#: A share of missing or bulging surface below this is not worth a word.
_NOTABLE_SHARE = 0.005


@dataclass(frozen=True, slots=True)
class Failure:
    """The worst region of one reconstruction.

    Attributes:
        region: Its label.
        error_mm: The larger of its accuracy and its completeness.
        text: Both, and on a second line the share of missing or bulging surface, for people.
    """

    region: str
    error_mm: float
    text: str


@dataclass(frozen=True, slots=True, eq=False)
class FailedMesh:
    """A reconstruction, world metres, its (V,) errors in mm, and where it is worst."""

    mesh: Mesh
    errors_mm: Floats
    failure: Failure


@dataclass(frozen=True, slots=True, eq=False)
class FailurePanel:
    """A method, and what it made of a subject; None where it made nothing."""

    title: str
    found: FailedMesh | None


@dataclass(frozen=True, slots=True, eq=False)
class FailureRow:
    """One subject.

    Attributes:
        capture: Its photos.
        truth: Its scan, world metres.
        face_regions: (F,) label of each face of the scan.
        panels: What the methods made of it.
    """

    capture: Capture
    truth: Mesh
    face_regions: NDArray[np.str_]
    panels: tuple[FailurePanel, ...]


def worst_region(record: Record) -> Failure | None:
    """The region with the largest error, of those large enough to count; None without regions."""
    failures = [
        _failure(name, errors)
        for name, errors in record.regions.items()
        if errors.area_share >= LEAST_SHARE
    ]
    return max(failures, key=lambda failure: failure.error_mm, default=None)


def _failure(region: str, errors: RegionErrors) -> Failure:
    error_mm = max(errors.accuracy_mm or 0.0, errors.completeness_mm or 0.0)
    shares = {"missing": errors.missing_share or 0.0, "bulging": errors.bulge_share or 0.0}
    word = max(shares, key=lambda name: shares[name])
    rest = f",\n{100 * shares[word]:.0f} % {word}" if shares[word] >= _NOTABLE_SHARE else ""
    return Failure(region, error_mm, f"{region}: {error_mm:.0f} mm{rest}")


def worst_subjects(records: Iterable[Record], most: int) -> tuple[str, ...]:
    """At most so many subjects, that with the worst region of any method's record first."""
    worst: dict[str, float] = {}
    for record in records:
        failure = worst_region(record)
        if failure:
            worst[record.subject] = max(worst.get(record.subject, 0.0), failure.error_mm)
    return tuple(sorted(worst, key=lambda subject: (-worst[subject], subject))[:most])


def failure_grid(rows: Sequence[FailureRow], path: Path, scale: ErrorScale) -> None:
    """Write the figure: photo, scan, and each method's mesh in the colours of its errors.

    A row is seen from where its failures are, by one camera; the worst region's true place is
    outlined on the scan and on the mesh of the method whose worst it is.

    Args:
        rows: One per subject; all with the same methods in the same order.
        path: PNG, PDF or SVG, by its extension.
        scale: Colours of the errors, for the whole figure.

    Raises:
        HarnessError: no rows, or not the same methods for all.
        DataError: a photo that is not usable, or errors that do not fit their mesh.
    """
    titles = [[panel.title for panel in row.panels] for row in rows]
    if not titles or any(names != titles[0] for names in titles):
        raise HarnessError("a grid needs subjects with the same methods", got=str(titles))
    casters = [Raycaster(row.truth) for row in rows]
    views = [_telling_view(row, caster) for row, caster in zip(rows, casters, strict=True)]
    frames = panel_windows(
        [
            (_together(row), row.capture.cameras[view])
            for row, view in zip(rows, views, strict=True)
        ],
        _PANEL_INCH,
    )
    figure, axes = canvas((len(rows), 2 + len(titles[0])), frames[0].window, _PANEL_INCH)
    for axis, title in zip(axes[0], ["Photo", "Ground truth", *titles[0]], strict=True):
        axis.set_title(textwrap.fill(title, _TITLE_LENGTH), fontsize=9)
    for row, caster, view, frame, line in zip(rows, casters, views, frames, axes, strict=True):
        line[0].set_ylabel(f"{row.capture.subject}, view {view}", fontsize=9)
        show(line[0], frame.of_image(photo(row.capture, view)))
        camera = frame.of_camera(row.capture.cameras[view], _LEAST_HEIGHT)
        _draw_row(row, caster, camera, line, scale)
    colour_bar(figure, axes, scale)
    save(figure, path)


def _draw_row(
    row: FailureRow, truth: Raycaster, camera: Camera, line: Any, scale: ErrorScale
) -> None:
    labels = _labels_seen(row, truth, camera)
    show(line[1], on_white(shaded(truth, camera)))
    for axis, panel in zip(line[2:], row.panels, strict=True):
        if panel.found is None:
            show(axis, np.ones((*labels.shape, 3)))
            axis.set_xlabel("no reconstruction", fontsize=8)
            continue
        found = panel.found
        show(axis, on_white(heat(Raycaster(found.mesh), camera, found.errors_mm, scale)))
        axis.set_xlabel(found.failure.text, fontsize=8)
        place = labels == found.failure.region
        if place.any():
            for outlined in (line[1], axis):
                outlined.contour(place, levels=[0.5], colors=_OUTLINE, linewidths=0.8)


def _telling_view(row: FailureRow, truth: Raycaster) -> int:
    """The view that shows most of the methods' worst regions; the first of equal ones."""
    regions = [panel.found.failure.region for panel in row.panels if panel.found]
    seen = []
    for camera in row.capture.cameras:
        glance = camera.resized(
            max(1, round(camera.width * _GLANCE_HEIGHT / camera.height)), _GLANCE_HEIGHT
        )
        labels = _labels_seen(row, truth, glance)
        seen.append(sum(int((labels == region).sum()) for region in regions))
    return int(np.argmax(seen))


def _labels_seen(row: FailureRow, truth: Raycaster, camera: Camera) -> NDArray[np.str_]:
    """(H, W) label of the face that each pixel's ray meets; empty beside the scan."""
    face = truth.cast(camera).face
    return np.where(face >= 0, row.face_regions[face], "")


def _together(row: FailureRow) -> Mesh:
    """The scan with the vertices of all its reconstructions, so that no bulge is cut off."""
    meshes = [panel.found.mesh.vertices for panel in row.panels if panel.found]
    return Mesh(np.concatenate([row.truth.vertices, *meshes]), row.truth.faces)

"""The subjects of a page: their photos and surfaces are written, and what was written is described.

One subject after the other, so that a page of many fits into memory.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from harness.core.cameras.rigs import camera_yaw_deg
from harness.core.records import Record
from harness.core.units import UNITS_RULE, Unit
from harness.geometry.images import load_rgba
from harness.pipeline.inputs.scan_set import ScanSet
from harness.pipeline.inputs.sources import Source
from harness.pipeline.progress import Progress
from harness.pipeline.report.error_cache import TrueSurface, measured_mesh
from harness.pipeline.run.record_inputs import require_photos
from harness.pipeline.run.store import RunStore
from reports.page.coarse_mesh import coarse_mesh
from reports.page.compact_mesh import CompactMesh, ScalarColumn
from reports.page.folder import PageFolder
from reports.page.model import TRUTH, PageScalar, PageSubject, PageSurface, PageView
from reports.page.photos import photo_camera

#: Distances are kept to 0.05 mm, angles to a degree: finer than any colour.
_DISTANCE_STEP_MM, _ANGLE_STEP_DEG = 0.05, 1.0
_LIMITS_MM = (5.0, 10.0, 20.0, 50.0, 100.0)
_LIMIT_PERCENTILE = 98.0
_LIMIT_DEG, _GREATEST_DEG = 60.0, 180.0
#: Numbers of a record that stand beside its surface.
_VALUES = ("chamfer", "normal_error")
_TASK = "surfaces of the page"


@dataclass(slots=True)
class SubjectWriter:
    """Writes the subjects of a page.

    Attributes:
        store: The run.
        records: Whose surfaces are shown, by method in order.
        scans: The true surfaces; its subjects are those of the page.
        photos: Where photos are; None for meshes that were made elsewhere.
        opening: Methods that are shown at first: errors of the first decide the colours' range.
        progress: Hears of every surface.
    """

    store: RunStore
    records: tuple[Record, ...]
    scans: ScanSet
    photos: Source | None
    opening: tuple[str, ...]
    progress: Progress
    _high_mm: list[float] = field(default_factory=list[float])

    def write_all(self, folder: PageFolder) -> tuple[PageSubject, ...]:
        """Write every subject, and say what was written."""
        by_subject = {subject: self._records_of(subject) for subject in self.scans.subjects}
        surfaces = sum(len(records) + 1 for records in by_subject.values())
        self.progress.expect(_TASK, surfaces)
        return tuple(self._write(folder, *item) for item in by_subject.items())

    def scalars(self) -> tuple[PageScalar, ...]:
        """What surfaces are coloured by, with limits that suit what was written."""
        unit, degree = Unit.millimetre.value, Unit.degree.value
        if self.scans.dataset.scale == UNITS_RULE:
            unit = "thousandths of a scan unit"
        # Of a middle subject: one bad surface would leave the others without colours.
        high = float(np.median(self._high_mm)) if self._high_mm else 0.0
        limit = next((limit for limit in _LIMITS_MM if high <= limit), _LIMITS_MM[-1])
        return (
            PageScalar("distance", "Distance to the truth", unit, limit, _LIMITS_MM[-1]),
            PageScalar("normal_error", "Normal error", degree, _LIMIT_DEG, _GREATEST_DEG),
        )

    def _records_of(self, subject: str) -> list[Record]:
        """Those that have a surface."""
        return [
            record for record in self.records if record.subject == subject and record.status == "ok"
        ]

    def _write(self, folder: PageFolder, subject: str, records: Sequence[Record]) -> PageSubject:
        scan, mesh = self.scans.load(subject)
        truth = TrueSurface(scan, mesh)
        surfaces = [self._write_surface(folder, record, truth) for record in records]
        coarse = coarse_mesh(mesh)
        folder.add_surface(subject, TRUTH, CompactMesh.of(mesh.geometry()), coarse)
        self.progress.done(_TASK)
        faces, has_coarse = len(mesh.faces), coarse is not None
        surfaces.append(PageSurface(TRUTH, "Truth", faces, has_coarse=has_coarse))
        classes = self.scans.dataset.classes.get(subject)
        return PageSubject(
            id=subject,
            description=f"{classes.clothing}, {classes.pose}" if classes else "",
            views=self._write_photos(folder, subject, records),
            surfaces=tuple(surfaces),
        )

    def _write_surface(self, folder: PageFolder, record: Record, truth: TrueSurface) -> PageSurface:
        found = measured_mesh(self.store, record, truth)
        columns = (
            ScalarColumn("distance", found.errors.distance_mm, _DISTANCE_STEP_MM),
            ScalarColumn("normal_error", found.errors.normal_deg, _ANGLE_STEP_DEG),
        )
        if record.method_name in self.opening[:1]:
            high = float(np.percentile(found.errors.distance_mm, _LIMIT_PERCENTILE))
            self._high_mm.append(high)
        name, coarse = record.method_name, coarse_mesh(found.mesh, columns)
        folder.add_surface(record.subject, name, CompactMesh.of(found.mesh, columns), coarse)
        self.progress.done(_TASK)
        values = {name: record.metrics[name].value for name in _VALUES if name in record.metrics}
        faces, has_coarse = len(found.mesh.faces), coarse is not None
        return PageSurface(name, record.method.title, faces, values, has_coarse)

    def _write_photos(
        self, folder: PageFolder, subject: str, records: Sequence[Record]
    ) -> tuple[PageView, ...]:
        if self.photos is None:
            return ()
        capture = self.photos.capture(subject)
        for record in records:
            require_photos(record, capture)
        cameras = [photo_camera(camera) for camera in capture.cameras]
        pictures = [load_rgba(capture.image_path(view)) for view in range(len(cameras))]
        folder.add_photos(subject, pictures, cameras)
        return tuple(
            PageView(round((camera_yaw_deg(camera) - capture.front_yaw_deg) % 360, 3), camera)
            for camera in cameras
        )

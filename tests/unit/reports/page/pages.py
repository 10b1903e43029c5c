"""A small page with known content: flat squares of one error each, and photos of one colour."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from harness.core.mesh import Mesh
from harness.core.records import Record
from harness.core.rigs import RingRig
from harness.run.store import RunStore
from reports.page.folder import page_folder
from reports.page.meshes import CompactMesh, ScalarColumn
from reports.page.model import (
    TRUTH,
    Fact,
    PageMethod,
    PageModel,
    PageScalar,
    PageSubject,
    PageSurface,
    PageView,
)
from reports.tables.geometry import geometry_table
from reports.tables.paired import paired_table

RUN = Path(__file__).parents[3] / "golden" / "run"
RECORDS: list[Record] = RunStore(RUN).records()
#: Every vertex of a method's square is this far from the truth, mm; colours end at 20 mm.
ERRORS_MM = {"hull8": 0.0, "mexecon": 10.0, "vggt": 40.0}
LIMIT_MM = 20.0
#: Colour of all photos, and how many squares a side has.
PHOTO = (180, 40, 60, 255)
CELLS = {"hull8": 4, "mexecon": 5, "vggt": 6, TRUTH: 3}
#: Whose surfaces each subject has.
SHOWN = {"a01": tuple(CELLS), "a02": ("hull8", "vggt", TRUTH)}
VIEWS = RingRig(views=4, radius_m=3.0, lens_mm=50.0, sensor_mm=36.0)


def square(cells: int, side_m: float = 1.6) -> Mesh:
    """A square of 2 x cells x cells triangles that faces +Z."""
    x, y = np.meshgrid(np.linspace(-1, 1, cells + 1), np.linspace(-1, 1, cells + 1))
    points = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1) * side_m / 2
    index = np.arange(x.size).reshape(x.shape)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    faces = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)]).reshape(-1, 3)
    return Mesh(points, faces)


def compact(method: str, cells: int = 0) -> CompactMesh:
    mesh = square(cells or CELLS[method])
    if method == TRUTH:
        return CompactMesh.of(mesh)
    count = len(mesh.vertices)
    columns = (
        ScalarColumn("distance", np.full(count, ERRORS_MM[method]), 0.05),
        ScalarColumn("normal_error", np.zeros(count), 1.0),
    )
    return CompactMesh.of(mesh, columns)


def write_page(
    directory: Path, *, photos: bool = True, coarse: Mapping[str, int] | None = None
) -> Path:
    """The page of the golden records, with surfaces of two subjects; its ``index.html``.

    Args:
        directory: Where it goes.
        photos: Whether subjects have photos.
        coarse: Methods whose surfaces have a coarse form, with the squares that a side of it has.
    """
    coarse = coarse or {}
    cameras = VIEWS.cameras(90, 160)
    rgba = np.broadcast_to(np.array(PHOTO, dtype=np.uint8), (160, 90, 4)).copy()
    methods = {record.method_name: record.method for record in RECORDS}
    with page_folder(directory) as folder:
        subjects = []
        for subject, methods_shown in SHOWN.items():
            for method in methods_shown:
                rough = compact(method, coarse[method]) if method in coarse else None
                folder.add_surface(subject, method, compact(method), rough)
            if photos:
                folder.add_photos(subject, [rgba] * len(cameras), cameras)
            surfaces = [
                PageSurface(
                    name, name.title().strip("/"), 2 * CELLS[name] ** 2, has_coarse=name in coarse
                )
                for name in methods_shown
            ]
            views = [PageView(90.0 * view, camera) for view, camera in enumerate(cameras)]
            subjects.append(
                PageSubject(
                    subject, "shirt, standing", tuple(views if photos else ()), tuple(surfaces)
                )
            )
        folder.finish(
            PageModel(
                title="golden <run>",
                lead="Squares & records.",
                facts=(Fact("Licence", "CC0-1.0"),),
                tables=(geometry_table(RECORDS), paired_table(RECORDS)),
                methods=tuple(PageMethod(info) for info in methods.values()),
                subjects=tuple(subjects),
                scalars=(
                    PageScalar("distance", "Distance", "mm", LIMIT_MM, 100.0),
                    PageScalar("normal_error", "Normal error", "deg", 60.0, 180.0),
                ),
                opening=("hull8", "vggt"),
                records=tuple(RECORDS),
            )
        )
    return directory / "index.html"

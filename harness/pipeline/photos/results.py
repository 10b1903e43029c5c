"""What a reconstruction of photos leaves for people: meshes with colours, the body, a sheet."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from harness.core.artifacts import Capture
from harness.core.files.atomic import atomic_directory, atomic_path, write_json
from harness.core.formats.coloured_mesh import ColouredMesh, save_coloured
from harness.core.formats.mesh_files import load_mesh, save_mesh
from harness.core.formats.typed_json import to_json
from harness.core.quality.photo_scores import PhotoScores
from harness.core.records import Record
from harness.geometry.colours import coloured
from harness.geometry.photo import open_photo
from harness.pipeline.run.result_files import (
    BODY_FILE,
    MESH_FILE,
    NORMALS_FILE,
    load_body_mesh,
    load_normals,
)
from harness.pipeline.run.store import RunStore
from harness.pipeline.scoring.photos import photo_quality
from reports.figures.photo_sheet import SheetInput, draw_photo_sheet


@dataclass(frozen=True, slots=True)
class WrittenResult:
    """A result as files.

    Attributes:
        folder: Holds them.
        silhouette_iou: Of each photo's mask and the mesh's, by the photo's number from the front.
        seen_share: Share of the mesh's vertices that a photo shows.
    """

    folder: Path
    silhouette_iou: tuple[float, ...]
    seen_share: float


def write_result(store: RunStore, record: Record, capture: Capture, folder: Path) -> WrittenResult:
    """Write a good record's result into a folder, which is replaced as a whole.

    The folder gets ``mesh.ply``, ``mesh.glb`` and ``mesh.obj`` with colours at the vertices,
    ``body.ply`` where the method fits a body, ``sheet.png``, and ``figures.json`` with figures of
    quality that need no scan.

    Args:
        store: Of the record.
        record: A good one.
        capture: All its photos, counted from the front.
        folder: To be made.

    Raises:
        DataError: a result that is gone or changed, or the disk refuses.
    """
    mesh = load_mesh(store.result(record, MESH_FILE))
    photos = [open_photo(capture, view) for view in range(len(capture.cameras))]
    painted = coloured(mesh, photos)
    maps = ()
    if NORMALS_FILE in record.files:
        maps = load_normals(store.result(record, NORMALS_FILE))
    quality = photo_quality(mesh, capture, maps)
    iou = tuple(view.silhouette_iou for view in quality.views)
    figures = _figures(record, capture, quality, painted)
    with atomic_directory(folder) as made:
        save_coloured(made / "mesh.ply", painted)
        save_coloured(made / "mesh.glb", painted)
        _write_coloured_obj(made / "mesh.obj", painted)
        if BODY_FILE in record.files:
            body = load_body_mesh(store.result(record, BODY_FILE), "fitted body")
            save_mesh(made / "body.ply", body)
        sheet = SheetInput(
            f"{record.method.title} of '{record.subject}'",
            photos,
            mesh,
            painted.colours,
            [f"IoU {value:.3f}" for value in iou],
        )
        draw_photo_sheet(sheet, made / "sheet.png")
        write_json(made / "figures.json", figures)
    return WrittenResult(folder, iou, painted.seen_share)


def _figures(
    record: Record, capture: Capture, quality: PhotoScores, painted: ColouredMesh
) -> dict[str, object]:
    mesh = painted.mesh
    extent = [float(side) for side in mesh.extent]
    imported = capture.provenance.get("imported", {})
    return {
        "method": record.method_name,
        "capture": capture.subject,
        "photos": [view.get("photo", "") for view in imported.get("views", [])],
        "masks": sorted({str(view.get("mask", "")) for view in imported.get("views", [])}),
        "world": imported.get("world", {}).get("notes", []),
        "warnings": list(capture.warnings),
        "quality": to_json(quality),
        "vertices_seen_share": painted.seen_share,
        "mesh": {"vertices": len(mesh.vertices), "faces": len(mesh.faces), "extent_m": extent},
        "stages": [{"name": stage.name, "wall_s": stage.wall_s} for stage in record.stages],
        "details": dict(record.details),
    }


def _write_coloured_obj(path: Path, painted: ColouredMesh) -> None:
    """An OBJ with each vertex' colour after its place, 0 to 1 in sRGB, as MeshLab and Blender do.

    The format itself has no colours; a program that does not know them reads the places.
    """
    rows = np.hstack([painted.mesh.vertices, painted.colours / 255.0]).tolist()
    lines = ["v {:.6f} {:.6f} {:.6f} {:.4f} {:.4f} {:.4f}".format(*row) for row in rows]
    lines += ["f {} {} {}".format(*face) for face in (painted.mesh.faces + 1).tolist()]
    with atomic_path(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="ascii")

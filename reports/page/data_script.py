"""The page's data as scripts, since a page opened from disk may load scripts and nothing else."""

import base64
import json
from collections.abc import Mapping, Sequence
from urllib.parse import quote

from harness.core.camera import Camera
from harness.core.records import Record
from reports.page.meshes import CompactMesh
from reports.page.model import TRUTH, BoardModel, PageModel, PageSubject
from reports.tables.table import Table


def surface_path(subject: str, method: str) -> str:
    """Where a surface lies, relative to the page. A method may be called ``truth``, too."""
    folder = "truths" if method == TRUTH else f"surfaces/{method}"
    return f"{folder}/{subject}.js"


def coarse_path(subject: str, method: str) -> str:
    """Where the coarse form of a surface lies, relative to the page."""
    return f"coarse/{surface_path(subject, method)}"


def photos_path(subject: str) -> str:
    """Where all photos of a subject lie, relative to the page."""
    return f"photos/{subject}.js"


def thumbnail_path(subject: str) -> str:
    """Where a small frontal photo lies, relative to the page."""
    return f"photos/{subject}.webp"


def record_path(record: Record) -> str:
    """Where a record lies, relative to the page."""
    return f"records/{record.method_name}/{record.subject}.json"


def surface_script(subject: str, method: str, mesh: CompactMesh) -> str:
    """The script that gives the page one surface."""
    return _mesh_script([subject, method], mesh)


def coarse_script(subject: str, method: str, mesh: CompactMesh) -> str:
    """The script that gives the page the coarse form of a surface."""
    return _mesh_script([subject, method, "coarse"], mesh)


def _mesh_script(key: list[str], mesh: CompactMesh) -> str:
    header = {
        "vertices": mesh.vertices,
        "faces": mesh.faces,
        "low": list(mesh.low),
        "step": mesh.step_m,
        "scalars": [{"id": scalar.id, "step": scalar.step} for scalar in mesh.scalars],
    }
    # The payload is base64: nothing in it ends a string.
    return f'HarnessPage.receive({_json(key)}, {_json(header)}, "{mesh.payload}");\n'


def photos_script(subject: str, pictures: Sequence[bytes]) -> str:
    """The script that gives the page a subject's photos.

    They are inside it, because a browser does not let pictures of other files near a canvas.
    """
    texts = [
        f"data:image/webp;base64,{base64.b64encode(data).decode('ascii')}" for data in pictures
    ]
    return f"HarnessPage.receive({_json([subject, 'photos'])}, {_json(texts)});\n"


def data_script(model: PageModel) -> str:
    """The script that tells the page what there is."""
    document = {
        "title": model.title,
        "truth": TRUTH,
        "opening": list(model.opening),
        "scalars": [
            {
                "id": scalar.id,
                "title": scalar.title,
                "unit": scalar.unit,
                "limit": scalar.limit,
                "greatest": scalar.greatest,
            }
            for scalar in model.scalars
        ],
        "subjects": [_subject(subject) for subject in model.subjects],
        **_results(model.tables, model.records),
    }
    return f"HarnessPage.data = {_json(document)};\n"


def board_script(model: BoardModel) -> str:
    """The script that tells a leaderboard what stands behind its numbers."""
    return f"HarnessPage.data = {_json(_results(model.tables, model.records))};\n"


def _results(tables: Sequence[Table], records: Sequence[Record]) -> dict[str, object]:
    return {
        "tables": {table.name: _table(table) for table in tables},
        "records": _records(records),
    }


def _subject(subject: PageSubject) -> dict[str, object]:
    return {
        "id": subject.id,
        "description": subject.description,
        "photos": quote(photos_path(subject.id)) if subject.views else "",
        "thumbnail": quote(thumbnail_path(subject.id)) if subject.views else "",
        "views": [{"yaw": view.yaw_deg, **_camera(view.camera)} for view in subject.views],
        "surfaces": [
            {
                "method": surface.method,
                "title": surface.title,
                "faces": surface.faces,
                "values": dict(surface.values),
                "file": quote(surface_path(subject.id, surface.method)),
                "coarse": quote(coarse_path(subject.id, surface.method))
                if surface.has_coarse
                else "",
            }
            for surface in subject.surfaces
        ],
    }


def _camera(camera: Camera) -> Mapping[str, object]:
    fx, fy, cx, cy = (float(camera.K[place]) for place in ((0, 0), (1, 1), (0, 2), (1, 2)))
    return {
        "intrinsics": [fx, fy, cx, cy],
        "worldToCamera": [float(value) for value in camera.world_to_camera.ravel()],
        "width": camera.width,
        "height": camera.height,
        "orthographic": camera.is_orthographic,
    }


def _table(table: Table) -> dict[str, object]:
    """What each number of a table is the mean of; rows in order, for a method may have several."""
    return {
        "columns": {
            column.id: {"title": column.title, "unit": column.unit, "digits": column.digits}
            for column in table.columns
        },
        "rows": [
            {
                column.id: dict(row.cells[column.id].by_subject)
                for column in table.columns
                if column.id in row.cells and row.cells[column.id].by_subject
            }
            for row in table.rows
        ],
    }


def _records(records: Sequence[Record]) -> dict[str, dict[str, object]]:
    found: dict[str, dict[str, object]] = {}
    for record in records:
        found.setdefault(record.method_name, {})[record.subject] = {
            "status": record.status,
            "file": quote(record_path(record)),
        }
    return found


def _json(value: object) -> str:
    return json.dumps(value, allow_nan=False, separators=(",", ":"))

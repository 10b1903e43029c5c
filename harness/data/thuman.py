"""THuman's folder layouts: where scan, texture and SMPL-X fit lie, and what is missing."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from harness.core.errors import DataError
from harness.core.files.reach import inside

#: Below the root: THuman 2.1 as its users quote it, THuman 2.0, and a copy one level down.
_SCAN_PLACES = ("model/{id}/{id}.obj", "{id}/{id}.obj", "*/model/{id}/{id}.obj", "*/{id}/{id}.obj")
_FIT_PLACES = (
    "smplx/{id}/smplx_param.pkl",
    "fits/{id}/smplx_param.pkl",
    "{id}/smplx_param.pkl",
    "*/smplx/{id}/smplx_param.pkl",
    "*/{id}/smplx_param.pkl",
)


@dataclass(frozen=True, slots=True)
class SubjectFiles:
    """A subject's files, as found.

    Attributes:
        mesh: The OBJ.
        fit: ``smplx_param.pkl``, or None.
        body: ``body.npz`` with the true body of a generated avatar, or None.
        labels: ``labels.npz`` with per-face regions, or None.
    """

    mesh: Path
    fit: Path | None
    body: Path | None
    labels: Path | None


def _first(root: Path, places: tuple[str, ...], subject: str) -> Path | None:
    for place in places:
        pattern = place.format(id=subject)
        matches = sorted(root.glob(pattern)) if "*" in pattern else [root / pattern]
        for match in matches:
            if match.is_file():
                return match
    return None


def find_subject(root: Path, subject: str) -> SubjectFiles:
    """The files of one subject below a dataset's root, in any known layout.

    Raises:
        DataError: no scan, and the message lists what was searched; or a link out of the root.
    """
    mesh = _first(root, _SCAN_PLACES, subject)
    if mesh is None:
        searched = ", ".join(place.format(id=subject) for place in _SCAN_PLACES)
        raise DataError(
            f"no scan of subject '{subject}' below {root}",
            expected=searched,
            hint="'harness data check DATASET' shows the whole expected tree",
        )
    inside(root, mesh, root)
    beside = {name: mesh.with_name(f"{name}.npz") for name in ("body", "labels")}
    return SubjectFiles(
        mesh=mesh,
        fit=_first(root, _FIT_PLACES, subject),
        body=beside["body"] if beside["body"].is_file() else None,
        labels=beside["labels"] if beside["labels"].is_file() else None,
    )

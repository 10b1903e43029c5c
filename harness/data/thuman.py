"""THuman's folder layouts: where scan, texture and SMPL-X fit lie, and what is missing."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from harness.core.errors import DataError
from harness.core.files.hashing import file_sha256
from harness.core.files.names import inside

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


@dataclass(frozen=True, slots=True)
class CheckedSurface:
    """What of a scan's surface says how well it serves as a truth.

    Attributes:
        subject: Its id.
        hidden: Share of its area that no ray from outside reaches.
        open_edges: Edges that have not two faces; none where it is watertight.
    """

    subject: str
    hidden: float
    open_edges: int


@dataclass(frozen=True, slots=True)
class FileCheck:
    """One expected file: ``present``, ``missing``, ``corrupt`` or ``unreadable``.

    That of a user's scan has its surface, too.
    """

    path: str
    state: str
    note: str = ""
    surface: CheckedSurface | None = None


def name_below(root: Path, path: Path) -> str:
    """A file's path below a folder, or its whole path if it lies elsewhere."""
    return str(path.relative_to(root)) if path.is_relative_to(root) else str(path)


def check_file(path: Path, root: Path, sha256: Mapping[str, str], note: str = "") -> FileCheck:
    """A file's state, compared with its checksum where there is one.

    Args:
        path: The file.
        root: The dataset's folder.
        sha256: Expected checksums by path below the root.
        note: What to say of a file that is there and has no checksum.
    """
    name = name_below(root, path)
    if not path.is_file():
        return FileCheck(name, "missing")
    if path.stat().st_size == 0:
        return FileCheck(name, "corrupt", "empty file")
    expected = sha256.get(name)
    if expected is None:
        return FileCheck(name, "present", note)
    found = file_sha256(path)
    if found != expected:
        return FileCheck(name, "corrupt", f"sha256 {found[:12]}…, expected {expected[:12]}…")
    return FileCheck(name, "present", "sha256 agrees")


_FIT = "smplx_param.pkl"
_BODY = "mesh_smplx.obj"
#: Below a root, and below a folder of fits beside it.
_BELOW = ("{id}", "*/{id}", "*/*/{id}")
#: What the name of a folder of fits holds, in small letters.
_OF_FITS = ("smpl", "fit")
_NEWER = "_new"


@dataclass(frozen=True, slots=True)
class ThumanFiles:
    """A subject's files, as found.

    Attributes:
        mesh: The scan, an OBJ.
        fit: ``smplx_param.pkl``, or None.
        warnings: What a reader of the numbers should know about them.
    """

    mesh: Path
    fit: Path | None
    warnings: tuple[str, ...] = ()


def find_thuman(root: Path, subject: str) -> ThumanFiles:
    """The files of one subject; its fit is looked for below the root, and else beside it.

    Raises:
        DataError: no scan; the message says so if there are bodies of fits in its place.
    """
    try:
        mesh = find_subject(root, subject).mesh
    except DataError as error:
        bodies = [path for place in _BELOW for path in root.glob(f"{place}/{_BODY}".format(id="*"))]
        if bodies:
            raise DataError(
                f"{root} holds fits and no scans: {_BODY} is the body of a fit",
                expected=f"{subject}/{subject}.obj",
                got=str(bodies[0].relative_to(root)),
                hint="Set the root to the folder of the scans; fits are found beside it",
            ) from error
        raise
    fit = _fit(root, subject, mesh)
    return ThumanFiles(mesh, fit, _doubts(fit))


def _fit(root: Path, subject: str, mesh: Path) -> Path | None:
    found = _below(root, subject)
    for folder in _above(root):
        if not found and folder.is_dir():
            siblings = sorted(path for path in folder.iterdir() if path.is_dir() and path != root)
            named = [each for each in siblings if any(w in each.name.lower() for w in _OF_FITS)]
            found = [path for sibling in named for path in _below(sibling, subject)]
    return min(found, key=lambda path: _rank(mesh, path)) if found else None


def _below(folder: Path, subject: str) -> list[Path]:
    return [path for place in _BELOW for path in folder.glob(f"{place.format(id=subject)}/{_FIT}")]


def _above(root: Path) -> tuple[Path, ...]:
    """The folders in which a folder of fits may lie beside the scans'."""
    # Version 2.1's archive has its scans in 'model'.
    return (root.parent, root.parent.parent) if root.name == "model" else (root.parent,)


def _rank(mesh: Path, fit: Path) -> tuple[bool, bool, str]:
    """Fits of the scan's own version first, the newer ones before the older ones."""
    ours, theirs = _version(mesh), _version(fit)
    return bool(ours and theirs and ours != theirs), not _is_newer(fit), str(fit)


def _is_newer(fit: Path) -> bool:
    return any(folder.name.lower().endswith(_NEWER) for folder in fit.parents)


def _version(path: Path) -> str:
    """The version that the nearest folder names which names one, such as ``21``."""
    for folder in path.parents:
        found = re.search(r"thuman[ _-]?(2)[._]?([01])", folder.name, re.IGNORECASE)
        if found:
            return found[1] + found[2]
    return ""


def _doubts(fit: Path | None) -> tuple[str, ...]:
    if fit is None or _is_newer(fit) or _version(fit) != "21":
        return ()
    if any("paras" in folder.name.lower() for folder in fit.parents):
        return (
            "the fit may be of the first release of THuman 2.1, which was misaligned: "
            "get the archive whose name ends in 'Paras_new'",
        )
    return ()


def check_thuman(
    root: Path, subject: str, *, needs_fit: bool, sha256: Mapping[str, str]
) -> list[FileCheck]:
    """What of a subject is there, by file, compared with checksums where the manifest has them."""
    try:
        files = find_thuman(root, subject)
    except DataError:
        names = [f"model/{subject}/{name}" for name in _scan_names(subject)]
        names += [f"smplx/{subject}/{_FIT}"] if needs_fit else []
        return [FileCheck(name, "missing") for name in names]
    paths = [files.mesh.with_name(name) for name in _scan_names(files.mesh.stem)]
    if needs_fit:
        paths.append(files.fit or root / "smplx" / subject / _FIT)
    doubts = "; ".join(files.warnings)
    return [check_file(path, root, sha256, doubts if path.name == _FIT else "") for path in paths]


def _scan_names(stem: str) -> tuple[str, str, str]:
    return f"{stem}.obj", "material0.mtl", "material0.jpeg"

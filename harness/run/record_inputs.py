"""Everything that a record's numbers depend on, as one readable structure; its hash is the key.

Both the run that plans a cell and the worker that carries it out build it, from what lies on disk
at that moment, with ``evaluated`` or, for meshes made elsewhere, ``scored_elsewhere``.

Code counts by import closure (``harness.core.process.source_digest``): the method's module; the
scan's reader; ``harness.run.cell``, which reconstructs and scores. How bodies and normal
maps are scored, and how the scan's normals are handed out, counts only for methods whose code can
use it: a method without the name ``Body`` anywhere in its code cannot hand out a body.
"""

import os
import platform
import subprocess
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from functools import cache
from pathlib import Path

import harness
from harness.core.artifacts import Capture, Scan
from harness.core.errors import DataError
from harness.core.files.hashing import content_hash
from harness.core.process.source_digest import SourceDigest, SourceTree, installed_version
from harness.core.protocols import MethodInfo, Privilege
from harness.core.records import Environment, Record
from harness.core.settings import MetricProtocol

_KEYS_OWN = SourceTree.__module__
_CELL = "harness.run.cell"
_MESH_SCORING = "harness.run.mesh_scores"
_MESH_READING = "harness.files.mesh_files"
_BODY_SCORING = "harness.run.body_scores"
_NORMAL_SCORING = "harness.run.normal_scores"
_ORACLE = "harness.run.oracle_normals"
_SURFACING = "methods.points.surfacing"
#: What a method may return that these steps make a surface.
_UNMESHED = ("DepthMaps", "PointCloud", "Gaussians")


@dataclass(frozen=True, slots=True)
class Inputs:
    """What a record was made from.

    Attributes:
        method: ``MethodInfo.identity()``.
        code: Digest by module of the method, of what reads the scan, and of what scores.
        packages: Version by name of each package that these modules import.
        photos: The capture's key; empty where the mesh was made elsewhere.
        truth: ``Scan.truth_identity()``; empty for imported photos, which have no scan.
        protocol: ``MetricProtocol.to_dict()``.
        seed: Root seed of the run.
        mesh: sha256 of a mesh that was made elsewhere; else empty.
    """

    method: Mapping[str, object]
    code: Mapping[str, str]
    packages: Mapping[str, str]
    photos: str
    truth: Mapping[str, object]
    protocol: Mapping[str, object]
    seed: int
    mesh: str = ""

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values, as records hold them."""
        return asdict(self)

    @property
    def key(self) -> str:
        """Content id."""
        return content_hash(self.to_dict())

    @property
    def counts_body_scoring(self) -> bool:
        """Whether the key covers the code that scores bodies."""
        return _BODY_SCORING in self.code

    @property
    def counts_surfacing(self) -> bool:
        """Whether the key covers the code that makes points a surface."""
        return _SURFACING in self.code

    @property
    def counts_normal_scoring(self) -> bool:
        """Whether the key covers the code that scores normal maps."""
        return _NORMAL_SCORING in self.code


def evaluated(
    method: MethodInfo,
    code: SourceDigest,
    capture: Capture,
    scan: Scan | None,
    protocol: MetricProtocol,
    seed: int,
) -> Inputs:
    """What a method's record on a subject is made from.

    Args:
        method: With the settings that it runs with.
        code: That of the method now, as ``method_code`` reads it.
        capture: The photos as they lie on disk.
        scan: The subject's scan as it lies on disk; None where there is none.
        protocol: How results are scored.
        seed: Root seed of the run.
    """
    code |= _reader(scan)
    return Inputs(
        method=method.identity(),
        code=code.modules,
        packages=code.packages,
        photos=capture.key,
        truth=scan.truth_identity() if scan else {},
        protocol=protocol.to_dict(),
        seed=seed,
    )


def scored_elsewhere(
    method: MethodInfo,
    mesh_sha256: str,
    scan: Scan,
    protocol: MetricProtocol,
    *,
    is_points: bool = False,
) -> Inputs:
    """What the record of a mesh, or of points, that were made elsewhere is made from now."""
    reading = _SURFACING if is_points else _MESH_READING
    scoring = SourceTree.installed().digest([_MESH_SCORING, reading], [_KEYS_OWN])
    code = scoring | _reader(scan)
    return Inputs(
        method=method.identity(),
        code=code.modules,
        packages=code.packages,
        photos="",
        truth=scan.truth_identity(),
        protocol=protocol.to_dict(),
        seed=protocol.seed,
        mesh=mesh_sha256,
    )


def _reader(scan: Scan | None) -> SourceDigest:
    if scan is None:
        return SourceDigest({}, {})
    return SourceDigest(scan.reader.get("code", {}), scan.reader.get("packages", {}))


def method_code(module: str, privileges: tuple[Privilege, ...]) -> SourceDigest:
    """The code that makes and scores the results of a method.

    Args:
        module: In which the catalogue has it.
        privileges: What the method is given beyond pixels.

    Raises:
        HarnessError: its source code is missing.
    """
    tree = SourceTree.installed(module)
    own = tree.digest([module], [_KEYS_OWN])
    unused = [_KEYS_OWN]
    if not own.uses("Body"):
        unused.append(_BODY_SCORING)
    if not own.uses("NormalMaps"):
        unused.append(_NORMAL_SCORING)
    if Privilege.ORACLE_NORMALS not in privileges:
        unused.append(_ORACLE)
    steps = [_SURFACING] if any(map(own.uses, _UNMESHED)) else []
    return own | tree.digest([_CELL, *steps], unused)


def require_photos(record: Record, capture: Capture) -> None:
    """Nothing, if these are the photos that a record's method saw, with whichever cameras.

    Raises:
        DataError: others were made since.
    """
    key = record.capture.key
    if key and record.recipe == capture.recipe and key != capture.key:
        raise _made_anew(record, "photos")


def require_scan(record: Record, scan: Scan) -> None:
    """Nothing, if this is the scan that a record was measured against, under the same rules.

    Raises:
        DataError: it is another one since.
    """
    before, now = record.inputs.get("truth"), scan.identity()
    if not isinstance(before, Mapping) or not before:
        return
    # Body and labels may differ: nothing is measured against them here.
    files = before.get("sha256", {})
    then = {**before, "sha256": {name: files.get(name) for name in scan.sha256}}
    if any(then.get(name) != value for name, value in now.items()):
        raise _made_anew(record, "scan")


def _made_anew(record: Record, what: str) -> DataError:
    cell = f"{record.method_name} on {record.subject}"
    return DataError(
        f"the {what} of {record.subject} changed since {cell} was evaluated",
        hint="Evaluate again: 'harness eval' with the same options makes what is not current",
    )


SEALED_LOG = "docs/lab/sealed.md"
"""Where a checkout logs looks at sealed data; a new line in it changes no number."""

_PACKAGES = ("numpy", "scipy", "open3d", "scikit-image", "torch", "bpy", "anny", "mediapipe",
             "onnxruntime")  # fmt: skip


def utc_now() -> str:
    """The present moment, ISO 8601, UTC, whole seconds."""
    return datetime.now(UTC).isoformat(timespec="seconds")


@cache
def environment() -> Environment:
    """Host, interpreter, package versions, and a checkout's commit and dirty flag."""
    made_from = _commit()
    return Environment(
        harness=harness.__version__,
        python=platform.python_version(),
        system=platform.platform(),
        machine=platform.machine(),
        cpus=os.cpu_count(),
        packages={name: installed_version(name) or None for name in _PACKAGES},
        commit=made_from.sha,
        dirty=made_from.dirty,
    )


def checkout() -> Path | None:
    """The source checkout that this program runs from, or None if it was installed."""
    folder = Path(__file__).resolve().parents[3]
    return folder if (folder / ".git").exists() else None


@dataclass(frozen=True, slots=True)
class _Commit:
    """A checkout's commit and whether it has changes that are in no commit; None where unknown."""

    sha: str | None = None
    dirty: bool | None = None


def _commit() -> _Commit:
    folder = checkout()
    if folder is None:
        return _Commit()
    try:
        commit = _git(folder, "rev-parse", "HEAD")
        changed = _git(folder, "status", "--porcelain", "--", ".", f":(exclude){SEALED_LOG}")
        return _Commit(commit, bool(changed))
    except (OSError, subprocess.SubprocessError):
        return _Commit()


def _git(folder: Path, *arguments: str) -> str:
    command = ["git", "-C", str(folder), *arguments]
    return subprocess.run(
        command, capture_output=True, text=True, check=True, timeout=10
    ).stdout.strip()

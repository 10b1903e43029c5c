"""``harness doctor``: what is usable here, and how to install the rest."""

import ctypes
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import typer

from harness.cli.display import print_json
from harness.cli.options import Json, ManifestPath, WorkspacePath
from harness.cli.verb_list import verb_group
from harness.core.errors import HarnessError, MissingPart
from harness.core.missing import how_to_install, is_extra
from harness.core.process.blender import find_blender
from harness.core.process.source_digest import installed_version
from harness.data.manifest import Manifest, load_manifest
from harness.run.inventory import check_tree
from harness.run.method_choice import catalogued_methods
from harness.run.workspace import Workspace
from methods.catalog import METHODS
from methods.normals import installed
from methods.parts.kind import KINDS, part_kind
from renderers.protocol import RENDERERS

_MOUNTS = Path("/proc/self/mounts")
_OCTAL = re.compile(r"\\([0-7]{3})")
#: Kinds of network file systems, and options with which their locks stay on one machine.
_NETWORK = {
    "nfs": ("nolock", "local_lock=flock", "local_lock=all"),
    "nfs4": ("nolock", "local_lock=flock", "local_lock=all"),
    "lustre": ("localflock", "noflock"),
    "cifs": ("nobrl",),
    "smb3": ("nobrl",),
}
#: Kinds whose locks are this machine's whatever their options say.
_ALWAYS_LOCAL = ("fuse.sshfs",)


@dataclass(frozen=True, slots=True)
class Mount:
    """A file system that is in use.

    Attributes:
        place: The folder that it is mounted on.
        kind: Such as ``nfs4``.
        options: How it is mounted.
    """

    place: Path
    kind: str
    options: tuple[str, ...]


def mount_of(folder: Path, mounts: Path = _MOUNTS) -> Mount | None:
    """The file system that a folder is on, or will be; None where the system does not say."""
    try:
        lines = mounts.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return None
    found: Mount | None = None
    for words in map(str.split, lines):
        if len(words) < 4:
            continue
        # Blanks in a path are written as octal numbers.
        place = Path(_OCTAL.sub(lambda found: chr(int(found[1], 8)), words[1]))
        is_longer = found is None or len(place.parts) >= len(found.place.parts)
        if folder.resolve().is_relative_to(place) and is_longer:
            found = Mount(place, words[2], tuple(words[3].split(",")))
    return found


def host_local_locks(mount: Mount) -> str:
    """Why locks on a file system do not reach other machines; empty where they should.

    A file system of this machine's own disks gives an empty text, too: no other machine sees it.
    """
    if mount.kind in _ALWAYS_LOCAL:
        return f"{mount.kind} keeps locks on each machine"
    wrong = [option for option in _NETWORK.get(mount.kind, ()) if option in mount.options]
    return f"{mount.kind} with {', '.join(wrong)} keeps locks on each machine" if wrong else ""


#: Debian package of each shared library that a wheel expects the system to have.
_DEBIAN_PACKAGES = {
    "libusb-1.0.so.0": "libusb-1.0-0",
    "libGL.so.1": "libgl1",
    "libEGL.so.1": "libegl1",
    "libgomp.so.1": "libgomp1",
    "libX11.so.6": "libx11-6",
    "libXrender.so.1": "libxrender1",
    "libXi.so.6": "libxi6",
    "libXfixes.so.3": "libxfixes3",
    "libxkbcommon.so.0": "libxkbcommon0",
    "libSM.so.6": "libsm6",
    "libICE.so.6": "libice6",
}
#: Package to import in a child process, the distribution that installs it, what it is for.
_MODULES = (
    ("numpy", "numpy", "arrays"),
    ("scipy", "scipy", "nearest neighbours, distance transforms"),
    ("skimage", "scikit-image", "marching cubes"),
    ("open3d", "open3d-cpu", "ray casting, exact closest points"),
    ("pandas", "pandas", "tables"),
    ("matplotlib", "matplotlib", "figures"),
    ("torch", "torch", "bodies"),
    ("anny", "anny", "bodies"),
    ("mediapipe", "mediapipe", "2-D landmarks"),
    ("onnxruntime", "onnxruntime", "normal networks"),
    ("warp", "warp-lang", "photo-consistency"),
)
_IMPORT_TIMEOUT_S = 120
_LOW_DISK_GIB = 5


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was looked at.

    Attributes:
        kind: ``system``, ``package``, ``device``, ``network``, ``part``, ``dataset``,
            ``method`` or ``renderer``.
        name: What it is.
        usable: Whether it can be used.
        needed: Whether the out-of-the-box pipeline needs it.
        note: Version or reason.
        next_step: What to run or get when it is not usable.
    """

    kind: str
    name: str
    usable: bool
    needed: bool
    note: str
    next_step: str = ""


def examine(manifest: Manifest, workspace: Workspace) -> Iterator[Finding]:
    """Everything that matters, one finding at a time, cheapest first."""
    yield _python()
    if sys.platform == "linux":
        yield _system_libraries(tuple(_DEBIAN_PACKAGES))
    yield _disk(workspace)
    yield _locks(workspace)
    yield from (_module(*entry) for entry in _MODULES)
    yield _blender()
    yield from _devices()
    yield _open_network()
    yield from (_part(name) for name in KINDS)
    yield from _catalogued()
    yield from (_dataset(manifest, workspace, name) for name in manifest.datasets)


def _python() -> Finding:
    version = ".".join(map(str, sys.version_info[:3]))
    return Finding(
        "system", "python", sys.version_info[:2] >= (3, 11), True, version,
        "Make the environment with python3.11 or a newer one",
    )  # fmt: skip


def _system_libraries(libraries: Sequence[str]) -> Finding:
    """All that are missing at once: an import error names one at a time."""
    missing: list[str] = []
    for library in libraries:
        try:
            ctypes.CDLL(library)
        except OSError:
            missing.append(library)
    note = f"missing: {', '.join(missing)}" if missing else f"all {len(libraries)} found"
    packages = " ".join(_DEBIAN_PACKAGES.get(library, library) for library in missing)
    step = f"sudo apt-get install -y {packages}"
    return Finding("system", "libraries", not missing, True, note, step)


def _disk(workspace: Workspace) -> Finding:
    place = next(path for path in (workspace.root, *workspace.root.parents) if path.exists())
    free_gib = shutil.disk_usage(place).free / 2**30
    return Finding(
        "system", "disk", free_gib > _LOW_DISK_GIB and os.access(place, os.W_OK), True,
        f"{free_gib:.0f} GiB free in {workspace.root}",
        "Free some space, or name another folder with --workspace",
    )  # fmt: skip


def _locks(workspace: Workspace) -> Finding:
    """Whether locks in the workspace reach other machines that see it; one machine needs none."""
    mount = mount_of(workspace.root)
    if mount is None:
        return Finding("system", "locks", True, False, "the system does not list its mounts")
    wrong = host_local_locks(mount)
    return Finding(
        "system", "locks", not wrong, False,
        wrong or f"{mount.kind} on {mount.place} has none of the options that cut them off",
        "Several machines may do the same work twice: mount it with locks",
    )  # fmt: skip


def _module(module: str, distribution: str, purpose: str) -> Finding:
    """Imported in a child process: a broken library may take its process with it."""
    needed = not is_extra(module)
    try:
        process = subprocess.run(
            [sys.executable, "-c", f"import {module}"],
            capture_output=True, text=True, timeout=_IMPORT_TIMEOUT_S, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return Finding("package", module, False, needed, "import did not end", "Try again")
    if process.returncode == 0:
        version = installed_version(distribution.removesuffix("-cpu"))
        return Finding("package", module, True, needed, f"{version}, {purpose}")
    reason = (process.stderr.strip().splitlines() or [f"exit status {process.returncode}"])[-1]
    step = how_to_install(module) or f"pip install -c constraints.txt {distribution}"
    if "cannot open shared object file" in reason:
        step = "Install the system libraries named above"
    return Finding("package", module, False, needed, f"{purpose}: {reason}", step)


def _blender() -> Finding:
    try:
        found = find_blender()
    except MissingPart as error:
        note = f"{error.what} (got {error.got})" if error.got else error.what
        return Finding("renderer", "Blender", False, False, note, error.hint)
    return Finding("renderer", "Blender", True, False, f"{found.version}, {found.place}")


def _devices() -> Iterator[Finding]:
    cpus = os.cpu_count() or 1
    yield Finding("device", "cpu", True, True, f"{cpus} cores")
    smi = shutil.which("nvidia-smi")
    names = ""
    if smi:
        process = subprocess.run(
            [smi, "--query-gpu=name,memory.total", "--format=csv,noheader"],
            capture_output=True, text=True, timeout=30, check=False,
        )  # fmt: skip
        names = "; ".join(process.stdout.split("\n")).strip("; ") if not process.returncode else ""
    yield Finding(
        "device", "gpu", bool(names), False, names or "none found; everything runs on the CPU",
        "" if names else "Nothing to do: a GPU only makes it faster",
    )  # fmt: skip


def _open_network() -> Finding:
    try:
        needed = METHODS.resolve("econ").settings.normals == "open"
    except HarnessError:
        needed = False  # econ's own finding says why it cannot be loaded
    try:
        found = installed.shipped()
    except HarnessError as error:
        return Finding("network", installed.OPEN_NETWORK, False, needed, error.what, error.hint)
    note = f"{found.bytes / 2**20:.1f} MiB, {found.licence}, trained on {found.training_set}"
    return Finding("network", found.name, True, needed, f"{note}, sha256 {found.sha256[:12]}")


def _part(name: str) -> Finding:
    """What was imported of a kind; nothing that ships needs it."""
    try:
        kind = part_kind(name)
        parts = [part for part in kind.installed() if part.place == "imported"]
    except HarnessError as error:
        return _unusable("part", name, error)
    if not parts:
        about = kind.about
        return Finding(
            "part", name, False, False, f"{about.purpose}; {about.licence}",
            f"{about.source}; then run: {about.command}",
        )  # fmt: skip
    note = ", ".join(f"{part.title} (sha256 {part.sha256[:12]})" for part in parts)
    named = {part.name for part in parts}
    left = [file for file in kind.about.files if file.rpartition(".")[0] not in named]
    if len(kind.about.files) > 1 and left:
        note += f"; not imported: {', '.join(left)}"
    return Finding("part", name, True, False, note)


def _catalogued() -> Iterator[Finding]:
    for name in RENDERERS:
        try:
            RENDERERS.resolve(name)
            yield Finding("renderer", name, True, True, "")
        except HarnessError as error:
            yield _unusable("renderer", name, error)
    catalogued = catalogued_methods()
    for method in catalogued.usable:
        info = method.info
        parts = ", ".join(part.name for part in info.parts)
        note = f"{info.title} ({parts})" if parts else info.title
        if method.name in catalogued.missing:
            yield _unusable("method", method.name, catalogued.missing[method.name])
        else:
            yield Finding("method", method.name, True, True, note)
    for name, error in catalogued.failures.items():
        yield _unusable("method", name, error)


def _unusable(kind: str, name: str, error: HarnessError) -> Finding:
    return Finding(kind, name, False, False, error.what, error.hint)


def _dataset(manifest: Manifest, workspace: Workspace, name: str) -> Finding:
    dataset = manifest.datasets[name]
    try:
        manifest.root(name, workspace.root)
    except MissingPart as error:
        return Finding("dataset", name, False, False, error.what, error.hint)
    tree = check_tree(manifest, workspace, name, ())
    note = f"{dataset.title}, {len(dataset.subjects)} subjects"
    if tree.complete:
        return Finding("dataset", name, True, False, note)
    return Finding(
        "dataset", name, False, False, f"{note}: {tree.summary}", _dataset_step(name, dataset.kind)
    )


def _dataset_step(name: str, kind: str) -> str:
    if kind == "generated":
        return f"harness data make {name} (eval and quickstart do it when they need it)"
    return f"harness data check {name}"


app = verb_group("doctor")


@app.command()
def doctor(
    workspace: WorkspacePath = None,
    manifest: ManifestPath = None,
    as_json: Json = False,
) -> None:
    """Check what is installed, and show how to install the rest.

    The exit code is 1 when something is missing without which 'harness quickstart' cannot run.
    """
    findings: list[Finding] = []
    for finding in examine(load_manifest(manifest), Workspace.default(workspace)):
        findings.append(finding)
        if not as_json:
            mark = "ok" if finding.usable else "MISSING" if finding.needed else "-"
            print(f"{mark:8} {finding.kind:9} {finding.name:18} {finding.note}")
            if not finding.usable and finding.next_step:
                print(f"{'':33} -> {finding.next_step}")
    if as_json:
        print_json(findings)
    if any(finding.needed and not finding.usable for finding in findings):
        raise typer.Exit(1)

"""What the bench can do without, and the command that installs it: the one home of such advice."""

from __future__ import annotations

from pathlib import Path

from harness.core.errors import MissingPart

_PROJECT = "mexecon-harness"
_CHECKOUT = Path(__file__).resolve().parents[2]
#: Packages that lie beside the bench, by the module that is imported.
_BESIDE = {
    "clothed_avatars": "clothed-avatars",
    "normal_training": "normal-training",
    "open_normals": "open-normals",
}


def how_to_install(module: str) -> str:
    """The exact command that installs a module's distribution; empty for an unknown module.

    In a checkout of the bench its own packages are installed from there.
    """
    top = module.partition(".")[0]
    if name := _BESIDE.get(top):
        folder = _CHECKOUT / "packages" / name
        return f"pip install -e {folder}" if folder.is_dir() else f"pip install {name}"
    return ""


def not_installed(module: str, purpose: str) -> MissingPart:
    """That a module which is needed for a purpose is not installed, and how to install it."""
    return MissingPart(
        f"{purpose} needs {module.partition('.')[0]}, which is not installed",
        hint=f"Run: {how_to_install(module)}",
    )

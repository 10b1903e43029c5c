"""What the bench can do without, and the command that installs it: the one home of such advice.

The bench itself needs what scores and reports need. Methods, rendering and executors of many
machines are extras of its distribution; other parts of the project are packages beside it.
"""

import contextlib
import sys
from collections.abc import Callable, Generator, Iterable
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

from harness.core.errors import MissingPart

_PROJECT = "mexecon-harness"
_CHECKOUT = Path(__file__).resolve().parents[2]
#: Modules that methods beyond the hulls need.
METHOD_EXTRAS = ("anny", "mediapipe", "onnx", "onnxruntime", "torch", "warp")
#: Extra that brings a module, by the module that is imported.
_EXTRAS = {
    **dict.fromkeys(METHOD_EXTRAS, "methods"),
    "bpy": "render",
    "ray": "ray",
    "submitit": "slurm",
    "h5py": "hdf5",
}
#: The newest Python for which some of them exist.
_NEWEST = {"bpy": (3, 11), "mediapipe": (3, 12)}
#: Packages that lie beside the bench, by the module that is imported.
_BESIDE = {
    "clothed_avatars": "clothed-avatars",
    "normal_training": "normal-training",
    "open_normals": "open-normals",
}
#: What no extra brings, since few people need it.
_SINGLE = {"smplx": "smplx==0.1.28"}


def how_to_install(module: str) -> str:
    """The exact command that installs a module's distribution; empty for an unknown module.

    In a checkout of the bench it is installed from there.
    """
    top = module.partition(".")[0]
    in_checkout = (_CHECKOUT / "packages").is_dir()
    if name := _BESIDE.get(top):
        where = f"-e {_CHECKOUT}/packages/{name}" if in_checkout else name
        return f"pip install {where}"
    if extra := _EXTRAS.get(top):
        if sys.version_info[:2] > (newest := _NEWEST.get(top, sys.version_info[:2])):
            older = ".".join(map(str, newest))
            return f"in an environment of Python {older}, pip install '{_PROJECT}[{extra}]'"
        if not in_checkout:
            return f"pip install '{_PROJECT}[{extra}]'"
        return f"pip install -c {_CHECKOUT}/constraints.txt -e '{_CHECKOUT}[{extra}]'"
    return f"pip install {_SINGLE[top]}" if top in _SINGLE else ""


def not_installed(module: str, purpose: str, otherwise: str = "") -> MissingPart:
    """That a module is not installed, and how to install it.

    Args:
        module: What could not be imported.
        purpose: What needs it, as the beginning of a sentence: ``making avatars``.
        otherwise: What to do instead, for the hint.
    """
    return MissingPart(
        f"{purpose} needs {module.partition('.')[0]}, which is not installed",
        hint="; ".join(filter(None, [f"Run: {how_to_install(module)}", otherwise])),
    )


def _itself(function: Callable[..., Any]) -> Callable[..., Any]:
    return function


@contextlib.contextmanager
def compiler_left_out() -> Generator[None]:
    """RoMa imported in here does not load torch's compiler, which takes a second or two.

    RoMa asks it only to leave two functions alone.

    Raises:
        ImportError: torch is not installed.
    """
    compiler = "torch._dynamo"
    import_module("torch")
    if compiler in sys.modules or "roma" in sys.modules:
        yield
        return
    sys.modules[compiler] = stand_in = ModuleType(compiler)
    stand_in.__dict__["disable"] = _itself
    try:
        yield
    finally:
        del sys.modules[compiler]


def explained(error: ImportError, purpose: str = "this") -> MissingPart | None:
    """What a failed import means to a user; None for a module that is nobody's extra."""
    module = error.name or ""
    known = isinstance(error, ModuleNotFoundError) and how_to_install(module)
    return not_installed(module, purpose) if known else None


def is_extra(module: str) -> bool:
    """Whether an extra brings a top-level module, so that the bench works without it."""
    return module in _EXTRAS


def absent_extras(modules: Iterable[str]) -> list[str]:
    """Those of some top-level modules that an extra brings and that are not installed."""
    return sorted(name for name in modules if name in _EXTRAS and find_spec(name) is None)

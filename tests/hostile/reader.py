"""Reads files one after the other in a process that may take one GiB more than it has.

Usage: ``reader.py KIND FILE...``; prints one JSON line a file: what came of it, the error's text
and the most bytes that Python and numpy held at once. A file that ends the process ends the output.
"""

from __future__ import annotations

import json
import resource
import sys
import tracemalloc
from collections.abc import Callable
from pathlib import Path

from harness.core.errors import DataError

ROOM_BYTES = 2**30


def _reader(kind: str) -> Callable[[Path], object]:
    # Imported here: what a reader needs is there before the limit is set.
    if kind == "fit":
        from harness.core.files.pickles import read_array_pickle

        return read_array_pickle
    if kind == "checkpoint":
        from methods.parts.checkpoint_tensors import Checkpoint

        def read_all(path: Path) -> object:
            checkpoint = Checkpoint(path)
            return checkpoint.read(checkpoint.tensors())

        return read_all
    if kind == "smplx":
        import smplx  # noqa: F401

        from methods.body.models.smplx_file import load_model

        return load_model
    if kind == "manifest":
        from harness.data.manifest import load_manifest

        return load_manifest
    if kind == "picture":
        from PIL import Image

        from harness.geometry.images import load_rgb, load_rgba

        Image.init()
        return lambda path: load_rgba(path) if path.suffix == ".png" else load_rgb(path)
    from harness.files.mesh_files import load_mesh

    return load_mesh


def _limit_memory() -> None:
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    most = pages * resource.getpagesize() + ROOM_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (most, most))


def main() -> None:
    read = _reader(sys.argv[1])
    _limit_memory()
    tracemalloc.start()
    for name in sys.argv[2:]:
        tracemalloc.reset_peak()
        before = tracemalloc.get_traced_memory()[0]
        try:
            read(Path(name))
            outcome, message = "read", ""
        except DataError as error:
            outcome, message = "DataError", str(error)
        except Exception as error:  # noqa: BLE001 - it is what the test is about
            outcome, message = type(error).__name__, str(error)
        peak = tracemalloc.get_traced_memory()[1] - before
        print(
            json.dumps({"file": name, "outcome": outcome, "message": message, "peak": peak}),
            flush=True,
        )


if __name__ == "__main__":
    main()

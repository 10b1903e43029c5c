"""A model file of SMPL-X becomes one that holds the checked arrays and nothing else."""

from __future__ import annotations

from pathlib import Path

from harness.core.array_files.npz import write_npz
from harness.core.errors import HarnessError
from methods.body.models.smplx_file import checked_model
from methods.body.models.smplx_part import MODEL, NAMES
from methods.parts.kind import ImportOptions
from methods.parts.store import Examined


def examine(file: Path, options: ImportOptions) -> Examined:
    """The model in a file; see ``methods.parts.store.Examine``.

    Raises:
        HarnessError: neither the file's name nor the options say which model it is.
    """
    arrays = checked_model(file)
    name = options.name or file.stem
    if not options.name and name not in NAMES:
        raise HarnessError(
            f"the name of {file} does not say which SMPL-X model it is",
            expected=" or ".join(NAMES),
            hint="Give it with --name",
        )
    shapes = arrays["shapedirs"].shape[2]

    def write(folder: Path) -> None:
        write_npz(folder / MODEL, arrays, compressed=False)

    return Examined(name, f"SMPL-X {name} ({shapes} shape and expression directions)", write)

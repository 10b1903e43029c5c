"""Captures of another workspace become subjects of a dataset of photos."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

from harness.core.artifacts import Capture, image_name
from harness.core.errors import DataError
from harness.core.files.atomic import atomic_directory, write_json
from harness.pipeline.adding.request import AddRequest
from harness.pipeline.inputs.imported import IMPORTED, imported_state

#: The same cameras for other programs; written with every capture.
_CAMERAS = "transforms.json"


def copied_capture(source: Path, request: AddRequest, subject: str) -> str:
    """Copy a capture to where those of a dataset lie, unless it is there; what it is, in words.

    Raises:
        DataError: it is damaged, or other photos are there and are not to be replaced.
    """
    capture = Capture.load(source)
    if damage := capture.damage():
        raise DataError(f"{source} cannot be used: {damage}")
    directory = request.workspace.capture(request.name, subject, IMPORTED)
    note = f"{len(capture.cameras)} photos, as recipe '{capture.recipe}'"
    if imported_state(directory)[0] == "cached" and Capture.load(directory).key == capture.key:
        return note
    if directory.exists() and not request.replace:
        raise DataError(f"{directory} holds other photos", hint="Add --replace to replace them")
    own = replace(capture, dataset=request.name, subject=subject, recipe=IMPORTED)
    with atomic_directory(directory) as folder:
        for name in [*map(image_name, range(len(capture.cameras))), _CAMERAS]:
            if (source / name).is_file():
                (folder / name).parent.mkdir(exist_ok=True)
                shutil.copyfile(source / name, folder / name)
        write_json(folder / "capture.json", own.to_dict())
    return note

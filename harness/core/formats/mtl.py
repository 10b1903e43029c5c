"""The texture image that an OBJ's material files name."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from harness.core.errors import DataError

_MOST_BYTES = 2**20
#: Options such as "-s 1 1 1" or "-clamp on" may come before the file name, which is the rest.
_DIFFUSE_MAP = re.compile(
    r"^\s*map_kd\s+(?:-\w+\s+(?:(?:on|off|[-+.\d][-+.\deE]*)\s+)+)*(.*\S)",
    re.IGNORECASE | re.MULTILINE,
)


def texture_image(mesh_path: Path, material_files: Sequence[str]) -> Path:
    """The image of the only textured material of an OBJ file.

    Args:
        mesh_path: The OBJ file, whose folder holds the others.
        material_files: The names in its ``mtllib`` records.

    Raises:
        DataError: a material file that is not there, no image or several, an image that is not
            there.
    """
    images: set[str] = set()
    for name in material_files:
        material_path = mesh_path.parent / name
        if not material_path.is_file():
            raise DataError(
                f"{mesh_path} names a material file that is not there", expected=str(material_path)
            )
        if material_path.stat().st_size > _MOST_BYTES:
            raise DataError(
                f"{material_path} is no material file",
                expected=f"at most {_MOST_BYTES} bytes",
                got=str(material_path.stat().st_size),
            )
        text = material_path.read_text(encoding="utf-8", errors="replace")
        images.update(_DIFFUSE_MAP.findall(text))
    if len(images) != 1:
        raise DataError(
            f"{mesh_path} cannot be textured",
            expected="one map_Kd image in its material files",
            got=", ".join(sorted(images)) or "none",
        )
    image = mesh_path.parent / images.pop()
    if not image.is_file():
        raise DataError(
            f"the texture of {mesh_path} is missing",
            expected=str(image),
            hint="Copy the image next to the mesh, as it is in the dataset's archive",
        )
    return image

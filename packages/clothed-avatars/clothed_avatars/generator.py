"""The avatars as the bench finds them: the entry point ``avatars`` of ``harness.datasets``."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from clothed_avatars.build import AVATARS_VERSION, make_avatar
from clothed_avatars.recipe import is_for_training, recipe_for
from clothed_avatars.sheet import avatar_sheet
from harness.core.files.atomic import read_json


class Avatars:
    """See ``harness.data.generators.Generator``."""

    version = AVATARS_VERSION
    #: The bench's own manifest describes the avatars' datasets.
    dataset: Mapping[str, object] = {}

    def make(self, subject: str, directory: Path, scan_noise_mm: float) -> None:
        """Write a subject's mesh, texture, true body, labels, licence and record."""
        make_avatar(recipe_for(subject), directory, scan_noise_mm)

    def is_current(self, subject: str, directory: Path, scan_noise_mm: float) -> bool:
        """Whether a folder holds a subject made by this version from the recipe that its id has."""
        mark = directory / "avatar.json"
        made = read_json(mark) if mark.is_file() else {}
        same = (made.get("version"), made.get("scan_noise_mm", 0.0)) == (
            AVATARS_VERSION,
            scan_noise_mm,
        )
        return same and made.get("recipe") == json.loads(json.dumps(recipe_for(subject).as_dict()))

    def sheet(self, subject: str, directory: Path) -> np.ndarray:
        """Eight views, bare geometry, and the body under the clothes."""
        return avatar_sheet(directory, subject)

    def is_for_training(self, subject: str) -> bool:
        """Whether networks may be trained on a subject."""
        return is_for_training(subject)


AVATARS = Avatars()

"""What every test shares."""

from __future__ import annotations

import os
from pathlib import Path

# Before any test imports torch or Open3D: many small computations, a few cores, several workers.
os.environ.setdefault("OMP_NUM_THREADS", "1")

import hypothesis
import pytest

# Derandomised, so that a build that was green stays green until the code changes.
hypothesis.settings.register_profile("house", deadline=None, derandomize=True, max_examples=50)
hypothesis.settings.load_profile("house")


@pytest.fixture(scope="session")
def published_camera_file() -> Path:
    """The cameras of the authors' public example, where a copy lies above the checkout."""
    name = "shared/data/cameras/0021_camera_parameters.json"
    found = [folder / name for folder in Path(__file__).parents if (folder / name).is_file()]
    if not found:
        pytest.skip("the published camera file is not here")
    return found[0]

"""What every test shares."""

from __future__ import annotations

import os
import signal
from pathlib import Path

# Before any test imports torch or Open3D: many small computations, a few cores, several workers.
os.environ.setdefault("OMP_NUM_THREADS", "1")

# A job in the background of a script starts with SIGINT ignored, and tests send it to themselves.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

import hypothesis
import numpy as np
import pytest

# Derandomised, so that a build that was green stays green until the code changes.
hypothesis.settings.register_profile("house", deadline=None, derandomize=True, max_examples=50)
hypothesis.settings.load_profile("house")


@pytest.fixture(scope="session")
def photograph():
    """``photograph(mesh, camera, colours)``: a figure in soft light from the upper left, RGBA."""

    def photo(mesh, camera, colours):
        from harness.geometry.raycast import Raycaster

        caster = Raycaster(mesh)
        fine = camera.resized(2 * camera.width, 2 * camera.height)
        hits = caster.cast(fine)
        normals = caster.normals_at(hits, fine, "camera")
        light = 0.5 + 0.5 * np.clip(normals @ np.array([-0.4, 0.5, 0.76]), 0, 1)
        colour = hits.interpolate(colours, mesh.faces) * light[..., None]
        image = np.dstack([colour, hits.mask])
        small = image.reshape(camera.height, 2, camera.width, 2, 4).mean(axis=(1, 3))
        alpha = small[..., 3:]
        small[..., :3] /= np.where(alpha > 0, alpha, 1)
        return np.round(255 * small).astype(np.uint8)

    return photo


@pytest.fixture(scope="session")
def published_camera_file() -> Path:
    """The cameras of the authors' public example, where a copy lies above the checkout."""
    name = "shared/data/cameras/0021_camera_parameters.json"
    found = [folder / name for folder in Path(__file__).parents if (folder / name).is_file()]
    if not found:
        pytest.skip("the published camera file is not here")
    return found[0]

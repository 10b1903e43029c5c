"""What every test shares."""

from __future__ import annotations

import os

# Before any test imports torch or Open3D: many small computations, a few cores, several workers.
os.environ.setdefault("OMP_NUM_THREADS", "1")

import hypothesis

# Derandomised, so that a build that was green stays green until the code changes.
hypothesis.settings.register_profile("house", deadline=None, derandomize=True, max_examples=50)
hypothesis.settings.load_profile("house")

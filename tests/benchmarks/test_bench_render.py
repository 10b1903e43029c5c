"""Making a capture against what Blender alone takes for the same scene."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from harness.core.artifacts import Scan
from harness.core.errors import MissingPart
from harness.core.mesh import Mesh
from harness.core.process.blender import find_blender
from harness.core.process.threads import silent
from harness.core.process.workers import run_worker
from harness.core.rigs import RingRig
from harness.core.settings import RenderRecipe
from harness.geometry.images import save_png
from renderers.blender.scene import RenderJob, describe, vertices_in_blender
from renderers.capture import capture
from renderers.protocol import texture_of
from tests.benchmarks.test_bench_score import bumpy_body

pytestmark = pytest.mark.nightly

#: The ratio on idle cores, and room for what else a machine does.
MOST_TIMES = 1.25


def textured_body(folder: Path) -> Mesh:
    """A person-sized egg of half a million faces, as scans have, in speckled cloth."""
    texture = folder / "texture.png"
    colours = np.random.default_rng(0).integers(40, 220, (512, 512, 3), dtype=np.uint8)
    save_png(texture, colours)
    egg = bumpy_body(0.0)
    uv = np.stack([egg.vertices[:, 0] + 0.5, egg.vertices[:, 1] / 2 + 0.5], axis=1)
    return Mesh(egg.vertices, egg.faces, uv, egg.faces, texture, source="egg")


def test_a_capture_takes_hardly_longer_than_its_rendering(benchmark, in_turns, tmp_path):
    """At most 1.25 times as long.

    Measured in turns on two cores that other work kept busy: 1.10 times (70 s against 64 s with
    four views): pictures are written once more without times, and the cameras are proven.
    """
    try:
        blender = find_blender()
    except MissingPart:
        pytest.skip("Blender is not on this machine")
    mesh = textured_body(tmp_path)
    recipe = RenderRecipe("bench", RingRig(views=2), 1080, 1920, samples=16)
    files = {"egg.obj": "0" * 64}
    scan = Scan("toy", "egg", tmp_path / "egg.obj", "metres", "+z", np.eye(4), files)

    def alone() -> None:
        """One process of Blender that renders the scene, and nothing else."""
        folder = tmp_path / "alone"
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        arrays = folder / "mesh.npz"
        corners = mesh.uv[mesh.face_uv].astype(np.float32)
        vertices = vertices_in_blender(mesh)
        np.savez(arrays, vertices=vertices, faces=mesh.faces, corner_uv=corners)
        job = RenderJob(describe(mesh, recipe), arrays, texture_of(mesh), folder)
        run_worker(blender.worker("renderers.blender.worker"), job, progress=silent)

    def ours() -> None:
        capture(scan, mesh, recipe, tmp_path / "ours")

    turns = in_turns({"alone": alone, "ours": ours}, rounds=2)
    benchmark.extra_info["times"] = turns.ratio("ours", "alone")
    benchmark.extra_info["alone_s"] = turns.least_s("alone")
    benchmark.pedantic(ours, rounds=1)
    assert turns.ratio("ours", "alone") < MOST_TIMES, turns.seconds

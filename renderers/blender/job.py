"""Starts the process in which Blender runs."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from harness.core.mesh import Mesh
from harness.core.process.blender import find_blender
from harness.core.process.threads import StepReport
from harness.core.process.workers import run_worker
from harness.core.settings import RenderRecipe
from harness.geometry.images import load_rgba, save_png
from renderers.blender.scene import RenderJob, describe, vertices_in_blender
from renderers.protocol import RenderOutcome, texture_of

_WORKER = "renderers.blender.worker"


class BlenderRenderer:
    """Path-traces with Blender's Cycles, on a GPU where there is one."""

    def render(
        self, mesh: Mesh, recipe: RenderRecipe, directory: Path, progress: StepReport
    ) -> RenderOutcome:
        """See ``Renderer.render``."""
        blender = find_blender()
        texture = texture_of(mesh)
        assert mesh.uv is not None
        assert mesh.face_uv is not None
        scene = describe(mesh, recipe)
        with tempfile.TemporaryDirectory(prefix="harness-render-") as folder:
            # Arrays instead of the scan's file, so that the checked mesh is the rendered one.
            arrays = Path(folder, "mesh.npz")
            np.savez(
                arrays,
                vertices=vertices_in_blender(mesh),
                faces=mesh.faces,
                corner_uv=mesh.uv[mesh.face_uv].astype(np.float32),
            )
            answer = run_worker(
                blender.worker(_WORKER),
                RenderJob(scene, arrays, texture.resolve(), Path(folder)),
                progress=progress,
            )
            for view in scene.views:
                # Decoded and written again: Blender stores its render times in its files,
                # so that files of equal pictures would differ.
                size = (scene.width, scene.height)
                save_png(directory / view.file, load_rgba(Path(folder, view.file), size))
        return RenderOutcome(device=str(answer["device"]))

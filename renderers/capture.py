"""A scan becomes a capture: rendered, proved, and put in place as a whole."""

from __future__ import annotations

import time
from pathlib import Path

from harness.core.artifacts import Capture, Scan, image_name
from harness.core.files import atomic_directory, write_json
from harness.core.frames import write_transforms_json
from harness.core.hashing import content_hash, file_sha256
from harness.core.mesh import Mesh
from harness.core.settings import RenderRecipe
from renderers.catalog import RENDERERS
from renderers.proof import ViewProof, cut_warnings, prove, require_proof
from renderers.protocol import Progress, Renderer, RenderOutcome, silent, texture_of

__all__ = ["capture", "capture_key"]


def capture_key(scan: Scan, recipe: RenderRecipe) -> str:
    """Content id of everything that makes the pictures: scan, recipe, renderer and its version.

    Raises:
        HarnessError: the recipe names an unknown renderer.
        MissingPart: the renderer is not installed.
    """
    renderer: Renderer = RENDERERS.resolve(recipe.renderer)()
    return content_hash(
        {"scan": scan.identity(), "recipe": recipe.to_dict(), "renderer": renderer.version}
    )


def capture(
    scan: Scan,
    mesh: Mesh,
    recipe: RenderRecipe,
    directory: Path,
    progress: Progress = silent,
) -> Capture:
    """Photograph a scan into ``directory``, which is replaced as a whole when all went well.

    Args:
        scan: What is photographed.
        mesh: Its surface in world metres, with texture.
        recipe: How.
        directory: Receives ``capture.json``, ``transforms.json`` and ``rgb/``.
        progress: Told after every view.

    Raises:
        DataError: no texture, an image that cannot be read, or a disk that refuses.
        MethodError: the renderer died, or its pictures fail their proof.
        MissingPart: the renderer is not installed.
    """
    texture_of(mesh)
    key = capture_key(scan, recipe)
    renderer: Renderer = RENDERERS.resolve(recipe.renderer)()
    cameras = recipe.cameras()
    images = [image_name(view) for view in range(len(cameras))]
    with atomic_directory(directory) as folder:
        started = time.perf_counter()
        outcome = renderer.render(mesh, recipe, folder, progress)
        rendered = time.perf_counter()
        proofs = prove(mesh, cameras, folder)
        require_proof(proofs, recipe.minimum_mask_iou, f"'{scan.subject}'")
        timings = {"render_s": rendered - started, "proof_s": time.perf_counter() - rendered}
        result = Capture(
            dataset=scan.dataset,
            subject=scan.subject,
            recipe=recipe.name,
            key=key,
            directory=directory,
            cameras=cameras,
            front_yaw_deg=scan.front_yaw_deg,
            warnings=(*scan.warnings, *cut_warnings(proofs), *outcome.warnings),
            provenance=_provenance(scan, recipe, renderer, outcome, proofs)
            | {"timings": timings, "images": {name: file_sha256(folder / name) for name in images}},
        )
        write_transforms_json(folder / "transforms.json", cameras, images)
        write_json(folder / "capture.json", result.to_dict())
    return result


def _provenance(
    scan: Scan,
    recipe: RenderRecipe,
    renderer: Renderer,
    outcome: RenderOutcome,
    proofs: tuple[ViewProof, ...],
) -> dict[str, object]:
    return {
        "recipe": recipe.to_dict(),
        "recipe_sha": recipe.sha,
        "scan": scan.identity(),
        "scan_to_world": scan.scan_to_world.tolist(),
        "renderer": {
            "name": recipe.renderer,
            "version": renderer.version,
            "device": outcome.device,
        },
        "proof": [proof.to_dict() for proof in proofs],
    }

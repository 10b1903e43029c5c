"""A scan becomes a capture: rendered, checked, and put in place as a whole."""

from __future__ import annotations

import shutil
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from harness.core.artifacts import Capture, Scan, image_name
from harness.core.cameras.camera import Camera
from harness.core.cameras.frames import write_transforms_json
from harness.core.errors import MissingPart
from harness.core.files.atomic import atomic_directory, write_json
from harness.core.files.hashing import content_hash, derive_seed, file_sha256
from harness.core.mesh import Mesh
from harness.core.process.blender import find_blender
from harness.core.process.source_digest import SourceTree
from harness.core.process.steps import StepReport, silent
from harness.core.settings import RenderRecipe
from renderers.catalog import RENDERERS
from renderers.photography import calibrated, reprojection_px, take_photos
from renderers.proof import ViewProof, cut_warnings, prove, require_proof
from renderers.protocol import Renderer, RenderOutcome, texture_of

_NOT_THE_PICTURES = ("renderers.proof", SourceTree.__module__)


@dataclass(frozen=True, slots=True)
class CaptureInputs:
    """Everything that pictures depend on; ``key`` is the content id of all of it.

    Attributes:
        scan: ``Scan.identity()``.
        recipe: ``RenderRecipe.to_dict()``.
        code: Digests of the modules that read the scan and render it, by module.
        packages: Versions of the packages that these modules import, by name.
        device: ``CPU`` or a GPU's interface, such as ``OPTIX``.
    """

    scan: Mapping[str, object]
    recipe: Mapping[str, object]
    code: Mapping[str, str]
    packages: Mapping[str, str]
    device: str

    @classmethod
    def of(cls, scan: Scan, recipe: RenderRecipe, device: str) -> CaptureInputs:
        """The inputs of pictures that would be made now.

        Args:
            scan: The subject's scan.
            recipe: Cameras, light and quality.
            device: The computing device, as ``RenderOutcome.device_kind``.

        Raises:
            HarnessError: the recipe names an unknown renderer.
        """
        code = scan.reader.get("code", {})
        packages = scan.reader.get("packages", {})
        module = RENDERERS.module(recipe.renderer)
        # The check reads pictures and changes none of them.
        rendering = SourceTree.installed(module).digest([__name__, module], _NOT_THE_PICTURES)
        if "bpy" in rendering.packages:
            packages = {**packages, "bpy": _blender_version()}
        return cls(
            scan=scan.identity(),
            recipe=recipe.to_dict(),
            code=dict(sorted({**code, **rendering.modules}.items())),
            packages=dict(sorted({**rendering.packages, **packages}.items())),
            device=device,
        )

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values, as ``capture.json`` holds them."""
        return asdict(self)

    @property
    def key(self) -> str:
        """Content id."""
        return content_hash(self.to_dict())


def _blender_version() -> str:
    """Of the Blender that would be used; empty where there is none."""
    try:
        return find_blender().version
    except MissingPart:
        return ""


def capture(
    scan: Scan,
    mesh: Mesh,
    recipe: RenderRecipe,
    directory: Path,
    progress: StepReport = silent,
    exact: Capture | None = None,
) -> Capture:
    """Photograph a scan into ``directory``, which is replaced as a whole on success.

    Args:
        scan: The subject's scan.
        mesh: Its surface in world metres, with texture.
        recipe: Cameras, light and quality.
        directory: Receives ``capture.json``, ``transforms.json`` and ``rgb/``.
        progress: Called after every view.
        exact: Current photos of this scan whose recipe ``is_exact_of`` this one, to be copied.

    Raises:
        HarnessError: no texture, files that cannot be used, a renderer that is missing or died.
    """
    texture_of(mesh)
    planned = CaptureInputs.of(scan, recipe, device="")  # of the code before the work
    cameras = recipe.cameras()
    images = [image_name(view) for view in range(len(cameras))]
    with atomic_directory(directory) as folder:
        started = time.perf_counter()
        if exact is None:
            renderer: Renderer = RENDERERS.resolve(recipe.renderer)()
            outcome = renderer.render(mesh, recipe, folder, progress)
        else:
            outcome = _copied(exact, folder, progress)
        if recipe.photo is not None and recipe.photo.changes_pictures:
            seed = derive_seed(recipe.seed, scan.subject)
            take_photos(folder, len(cameras), recipe.photo, seed)
        rendered = time.perf_counter()
        proofs = prove(mesh, cameras, folder)
        require_proof(proofs, recipe.minimum_mask_iou, f"'{scan.subject}'")
        given = _given_cameras(scan, mesh, recipe)
        inputs = replace(planned, device=outcome.device_kind)
        timings = {"render_s": rendered - started, "proof_s": time.perf_counter() - rendered}
        result = Capture(
            dataset=scan.dataset,
            subject=scan.subject,
            recipe=recipe.name,
            key=inputs.key,
            directory=directory,
            cameras=given,
            front_yaw_deg=scan.front_yaw_deg,
            warnings=tuple(
                dict.fromkeys((*scan.warnings, *cut_warnings(proofs), *outcome.warnings))
            ),
            provenance=_provenance(scan, inputs, outcome, proofs)
            | _calibration(mesh, cameras, given)
            | ({} if exact is None else {"pictures_of": exact.recipe})
            | {"timings": timings, "images": {name: file_sha256(folder / name) for name in images}},
        )
        write_transforms_json(folder / "transforms.json", given, images)
        write_json(folder / "capture.json", result.to_dict())
    return result


def _copied(exact: Capture, folder: Path, progress: StepReport) -> RenderOutcome:
    """Copies the pictures of other photos; what their renderer reported, with all warnings."""
    for view in range(len(exact.cameras)):
        target = folder / image_name(view)
        target.parent.mkdir(exist_ok=True)
        shutil.copyfile(exact.image_path(view), target)
        progress(view + 1, len(exact.cameras))
    return RenderOutcome(str(exact.provenance["device"]), exact.warnings)


def _given_cameras(scan: Scan, mesh: Mesh, recipe: RenderRecipe) -> tuple[Camera, ...]:
    """The cameras that methods are given: exact, or as the recipe's calibration finds them."""
    if recipe.photo is None:
        return recipe.cameras()
    seed = derive_seed(recipe.seed, scan.subject)
    return calibrated(recipe.cameras(), mesh.bounds, recipe.photo.calibration_px, seed)


def _calibration(
    mesh: Mesh, exact: tuple[Camera, ...], given: tuple[Camera, ...]
) -> dict[str, object]:
    """The exact cameras, which the proof is of, and how far off the given ones are, if any is."""
    pairs = list(zip(exact, given, strict=True))
    if all(a.to_dict() == b.to_dict() for a, b in pairs):
        return {}
    return {
        "exact_cameras": [camera.to_dict() for camera in exact],
        "calibration_px": [reprojection_px(a, b, mesh.bounds) for a, b in pairs],
    }


def _provenance(
    scan: Scan, inputs: CaptureInputs, outcome: RenderOutcome, proofs: tuple[ViewProof, ...]
) -> dict[str, object]:
    return {
        "inputs": inputs.to_dict(),
        "scan_to_world": scan.scan_to_world.tolist(),
        "device": outcome.device,
        "proof": [proof.to_dict() for proof in proofs],
    }

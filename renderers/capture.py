"""A scan becomes a capture: rendered, checked, and put in place as a whole."""

from __future__ import annotations

import io
import math
import shutil
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from harness.core.arrays import Bytes, Floats, Mask
from harness.core.artifacts import Capture, Scan, image_name
from harness.core.camera import Camera
from harness.core.camera_frames import write_transforms_json
from harness.core.errors import MissingPart
from harness.core.files.atomic import atomic_directory, write_json
from harness.core.files.hashing import content_hash, derive_seed, file_sha256
from harness.core.mesh import Mesh
from harness.core.process.blender import find_blender
from harness.core.process.source_digest import SourceTree
from harness.core.process.threads import StepReport, silent
from harness.core.rigs import PhotoFaults, RingRig
from harness.core.settings import RenderRecipe
from harness.core.truth import true_body
from harness.core.units import MM_PER_METRE
from harness.geometry.images import linear_from_srgb, load_rgba, save_png, srgb_from_linear
from renderers.proof import ViewProof, cut_warnings, prove, require_proof
from renderers.protocol import RENDERERS, Renderer, RenderOutcome, texture_of

#: Read noise over the noise at middle grey.
_READ_SHARE = 0.3
_MIDDLE_GREY = 128.0 / 255.0
#: The box is probed at so many points along each side.
_PROBES = 5


def take_photos(directory: Path, views: int, faults: PhotoFaults, seed: int) -> None:
    """Replace the exact pictures below a folder by what a camera would have taken.

    Args:
        directory: Holds ``rgb/00.png`` and so on.
        views: Number of pictures.
        faults: What makes real photos worse, such as blur and noise.
        seed: Equal seeds give equal pictures.
    """
    for view in range(views):
        path = directory / image_name(view)
        save_png(path, photographed(load_rgba(path), faults, derive_seed(seed, "photo", view)))


def photographed(rgba: Bytes, faults: PhotoFaults, seed: int) -> Bytes:
    """(H, W, 4) uint8: exposure and blur in linear light, then noise, eight bits and JPEG.

    Colour is blurred within the subject alone, because beside it there is none; alpha stays.
    """
    rng = np.random.default_rng(seed)
    alpha = rgba[..., 3:] / 255.0
    light = linear_from_srgb(rgba[..., :3] / 255.0)
    light = light * 2.0 ** (faults.exposure_stops * rng.standard_normal())
    light = _blurred(light, alpha, faults.blur_px)
    light = light + rng.standard_normal(light.shape) * _noise_deviation(light, faults.noise)
    colour = np.round(255.0 * srgb_from_linear(np.clip(light, 0.0, 1.0))).astype(np.uint8)
    if faults.jpeg_quality:
        colour = _compressed(colour, alpha > 0, faults.jpeg_quality)
    return np.concatenate([np.where(alpha > 0, colour, 0).astype(np.uint8), rgba[..., 3:]], axis=2)


def _blurred(light: Floats, alpha: Floats, blur_px: float) -> Floats:
    if not blur_px:
        return light
    from scipy.ndimage import gaussian_filter

    weight = gaussian_filter(alpha[..., 0], blur_px)[..., None]
    sums = gaussian_filter(light * alpha, (blur_px, blur_px, 0.0))
    return np.where(alpha > 0, sums / np.maximum(weight, 1e-6), light)


def _noise_deviation(light: Floats, noise: float) -> Floats:
    """The deviation in linear light, so that it is ``noise`` levels of sRGB at middle grey."""
    step = 1.0 / 255.0
    middle = float(linear_from_srgb(_MIDDLE_GREY))
    slope = (float(linear_from_srgb(_MIDDLE_GREY + step)) - middle) / step
    at_middle = slope * noise / 255.0
    shot = np.maximum(light, 0.0) / middle
    return at_middle * np.sqrt(_READ_SHARE**2 + (1.0 - _READ_SHARE**2) * shot)


def _compressed(colour: Bytes, shown: Mask, quality: int) -> Bytes:
    """The picture after JPEG, with the subject's mean colour beside it so that no edge rings."""
    from PIL import Image

    beside = colour[shown[..., 0]].mean(axis=0) if shown.any() else np.zeros(3)
    filled = np.where(shown, colour, beside.astype(np.uint8))
    stream = io.BytesIO()
    Image.fromarray(filled).save(stream, format="JPEG", quality=quality, subsampling=0)
    stream.seek(0)
    return np.asarray(Image.open(stream).convert("RGB"))


def calibrated(
    cameras: Sequence[Camera], bounds: Floats, error_px: float, seed: int
) -> tuple[Camera, ...]:
    """The cameras as a calibration finds them: each turned and moved a little.

    Args:
        cameras: The exact ones.
        bounds: (2, 3) corners of the subject's box, world metres.
        error_px: Root mean square re-projection error over the box that each camera then has.
        seed: Equal seeds give equal cameras.
    """
    if not error_px:
        return tuple(cameras)
    return tuple(
        _off(camera, bounds, error_px, derive_seed(seed, "calibration", view))
        for view, camera in enumerate(cameras)
    )


def _off(camera: Camera, bounds: Floats, error_px: float, seed: int) -> Camera:
    """Turned about three axes and moved along them by random shares, scaled to the error."""
    rng = np.random.default_rng(seed)
    distance_m = float(np.linalg.norm(camera.position - bounds.mean(axis=0)))
    # A turn moves all points alike, whatever their distance; a move of the same size in pixels
    # lets near points go further than far ones.
    turn, move = rng.standard_normal(3), rng.standard_normal(3) * distance_m
    scale = error_px / camera.K[0, 0]
    for _ in range(5):
        moved = _moved(camera, scale * turn, scale * move)
        scale *= error_px / reprojection_px(camera, moved, bounds)
    return _moved(camera, scale * turn, scale * move)


def _moved(camera: Camera, turn_rad: Floats, move_m: Floats) -> Camera:
    from scipy.spatial.transform import Rotation

    step = np.eye(4)
    step[:3, :3] = Rotation.from_rotvec(turn_rad).as_matrix()
    step[:3, 3] = move_m
    return replace(camera, world_to_camera=step @ camera.world_to_camera)


def reprojection_px(exact: Camera, given: Camera, bounds: Floats) -> float:
    """Root mean square distance in pixels between where two cameras see the points of a box."""
    axes = [np.linspace(bounds[0, axis], bounds[1, axis], _PROBES) for axis in range(3)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    apart = exact.project(points)[0] - given.project(points)[0]
    return float(np.sqrt((apart**2).sum(axis=1).mean()))


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
            scan=scan.identity() if recipe.rig.about == "box" else scan.truth_identity(),
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
    recipe, told = _placed(recipe, scan, mesh)
    cameras = recipe.cameras()
    images = [image_name(view) for view in range(len(cameras))]
    with atomic_directory(directory) as folder:
        started = time.perf_counter()
        bodies = swayed(mesh, recipe, derive_seed(recipe.seed, scan.subject))
        outcome = _pictures(bodies, recipe, folder, progress, exact)
        if recipe.photo is not None and recipe.photo.changes_pictures:
            take_photos(folder, len(cameras), recipe.photo, derive_seed(recipe.seed, scan.subject))
        rendered = time.perf_counter()
        proofs = _proven(bodies, cameras, folder)
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
                dict.fromkeys((*scan.warnings, *told, *cut_warnings(proofs), *outcome.warnings))
            ),
            provenance=_provenance(scan, inputs, outcome, proofs)
            | _calibration(mesh, cameras, given)
            | ({} if exact is None else {"pictures_of": exact.recipe})
            | {"timings": timings, "images": {name: file_sha256(folder / name) for name in images}},
        )
        write_transforms_json(folder / "transforms.json", given, images)
        write_json(folder / "capture.json", result.to_dict())
    return result


def _placed(recipe: RenderRecipe, scan: Scan, mesh: Mesh) -> tuple[RenderRecipe, tuple[str, ...]]:
    """The recipe with its ring about this subject, and what to know of it."""
    body = None if recipe.rig.about == "box" else true_body(scan)
    rig = recipe.rig.placed(mesh.bounds, None if body is None else body.joints[0])
    told = ()
    if recipe.rig.about != "box" and body is None:
        told = (
            "the scan has no true body: photos are about the middle of its box, not its pelvis",
        )
    return replace(recipe, rig=rig), told


def swayed(mesh: Mesh, recipe: RenderRecipe, seed: int) -> list[Mesh]:
    """The mesh as it stands in each photo; itself where nobody sways.

    The feet stay, the head moves by ``sway_mm`` in the root mean square, and the middle by half of
    it besides.
    """
    views = recipe.rig.views
    if recipe.photo is None or not recipe.photo.sway_mm:
        return [mesh] * views
    rng = np.random.default_rng(derive_seed(seed, "sway"))
    low, high = mesh.bounds[:, 1]
    height = (mesh.vertices[:, 1:2] - low) / (high - low)
    size_m = recipe.photo.sway_mm / MM_PER_METRE / math.sqrt(2)
    bodies: list[Mesh] = []
    for _ in range(views):
        lean, bend = size_m * rng.standard_normal((2, 2))
        moved = mesh.vertices.copy()
        moved[:, [0, 2]] += height * lean + np.sin(math.pi * height) * bend / 2
        bodies.append(replace(mesh, vertices=moved))
    return bodies


@dataclass(frozen=True, slots=True)
class _OneCamera(RingRig):
    """A rig of one camera, wherever it stands."""

    camera: Camera | None = None

    def cameras(self, width: int, height: int) -> tuple[Camera, ...]:  # noqa: ARG002
        assert self.camera is not None
        return (self.camera,)


def _pictures(
    bodies: Sequence[Mesh],
    recipe: RenderRecipe,
    folder: Path,
    progress: StepReport,
    exact: Capture | None,
) -> RenderOutcome:
    """The pictures of a body that stands still or moves, rendered or copied."""
    if exact is not None:
        return _copied(exact, folder, progress)
    if any(body is not bodies[0] for body in bodies):
        return _one_by_one(bodies, recipe, folder, progress)
    renderer: Renderer = RENDERERS.resolve(recipe.renderer)()
    return renderer.render(bodies[0], recipe, folder, progress)


def _proven(
    bodies: Sequence[Mesh], cameras: Sequence[Camera], folder: Path
) -> tuple[ViewProof, ...]:
    if all(body is bodies[0] for body in bodies):
        return prove(bodies[0], cameras, folder)
    pairs = enumerate(zip(bodies, cameras, strict=True))
    return tuple(proof for view, (body, camera) in pairs
                 for proof in prove(body, [camera], folder, view))  # fmt: skip


def _one_by_one(
    bodies: Sequence[Mesh], recipe: RenderRecipe, folder: Path, progress: StepReport
) -> RenderOutcome:
    """Each photo of the body as it stands then."""
    renderer: Renderer = RENDERERS.resolve(recipe.renderer)()
    outcomes: list[RenderOutcome] = []
    for view, (body, camera) in enumerate(zip(bodies, recipe.cameras(), strict=True)):
        alone = folder / "alone"
        alone.mkdir()
        one = replace(recipe, rig=_OneCamera(1, camera=camera), seed=derive_seed(recipe.seed, view))
        outcomes.append(renderer.render(body, one, alone, silent))
        (folder / image_name(view)).parent.mkdir(exist_ok=True)
        (alone / image_name(0)).rename(folder / image_name(view))
        shutil.rmtree(alone)
        progress(view + 1, len(bodies))
    warnings = dict.fromkeys(warning for each in outcomes for warning in each.warnings)
    return RenderOutcome(outcomes[0].device, tuple(warnings))


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


#: Side of the square key light, metres.
KEY_SIDE_M = 1.6
#: Its position relative to the camera: right, down, forward, as shares of the camera's distance.
_KEY_OFFSET = (-0.55, -0.65, 0.15)


def key_light_position(camera: Camera) -> Floats:
    """(3,) world metres of the key light's centre; it is aimed at the world's origin."""
    distance = float(np.linalg.norm(camera.position))
    return camera.position + distance * np.array(_KEY_OFFSET) @ camera.rotation


def square_light_radiance(strength: float, distance_m: float, side_m: float = KEY_SIDE_M) -> float:
    """Radiance of a square light that makes a facing white surface radiate ``strength``.

    ``strength`` over the form factor from a small surface to a centred, parallel square:
    F = 4/pi * s * atan(s), with s = sin of the half side's angle (Howell, configuration C-3).
    """
    s = math.sin(math.atan2(side_m / 2, distance_m))
    return strength / (4 / math.pi * s * math.atan(s))

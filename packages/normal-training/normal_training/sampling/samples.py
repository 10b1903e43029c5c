"""What a normal estimator is trained on: photos, bodies and clothed normals of one subject.

Photos are ray-cast from the textured scan under drawn cameras and light; the bodies are the true
one with errors such as a fit has; the targets are the scan's normals on its near and far side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats, Mask
from harness.core.artifacts import Scan
from harness.core.camera import Camera
from harness.core.files.hashing import content_hash, derive_seed
from harness.core.files.npz import write_npz
from harness.core.mesh import Mesh
from harness.core.process.threads import StepReport
from harness.core.truth import true_parameters
from harness.geometry.images import load_rgb, packed_normals, srgb_from_linear
from harness.geometry.occlusion import vertex_openness
from harness.geometry.photo import Picture, linear_texture
from harness.geometry.raycast import Raycaster
from harness.geometry.window import rounded_up
from methods.body.models.anny_body import AnnyBody
from methods.normals.onnx_estimator import MULTIPLE
from normal_training.learning.settings import LARGER
from normal_training.learning.variations.light import (
    LAMPS,
    Gloss,
    Lamp,
    Light,
    drawn_gloss,
    drawn_lamp,
    drawn_light,
    packed_lights,
    photographed,
)
from normal_training.sampling.fabric_prints import printed
from normal_training.sampling.perturbation import FitErrors, as_fitted
from normal_training.sampling.shading import Shading, averaged, shaded
from normal_training.sampling.viewpoint import PhotoSize, drawn_camera
from renderers.protocol import texture_of

SAMPLES_VERSION = 3
"""Changes whenever any output does."""

#: Rays along each side of a pixel of the photo.
_SUPERSAMPLE = 2
_OPENNESS_RAYS = 32
#: Textures of a subject: its own for half of the photos, and printed ones.
_PRINTED_SHARE, _PRINTED = 0.5, 3


@dataclass(frozen=True, slots=True)
class SampleSettings:
    """Which samples are made of a subject.

    Attributes:
        views: Number of samples, each of them one photo.
        side_px: Side of the square that the subject fills, as methods crop it.
        width_px, height_px: Size of the window within the square that is kept.
        seed: Seed of cameras, light and body errors.
    """

    views: int = 32
    side_px: int = 512
    width_px: int = 320
    height_px: int = 480
    seed: int = 0

    @property
    def file_bytes(self) -> int:
        """Size of the arrays of one subject's samples, each of 24 bytes per pixel."""
        return 24 * self.views * self.width_px * self.height_px

    def of_detail(self) -> SampleSettings:
        """The same scenes as the second network sees them: larger."""
        return self.seen_at(rounded_up(round(LARGER * self.side_px), MULTIPLE))

    def seen_at(self, side_px: int) -> SampleSettings:
        """The same scenes with another side of the square."""
        width, height = (
            rounded_up(round(side_px / self.side_px * px), MULTIPLE)
            for px in (self.width_px, self.height_px)
        )
        return replace(self, side_px=side_px, width_px=width, height_px=height)


def samples_key(scan: Scan, settings: SampleSettings) -> str:
    """Content id of everything that a subject's samples are made from."""
    return content_hash(
        {
            "version": SAMPLES_VERSION,
            "scan": scan.identity(),
            "body": None if scan.body_path is None else scan.truth_sha256.get(scan.body_path.name),
            "settings": asdict(settings),
            "errors": asdict(FitErrors()),
        }
    )


def make_samples(
    scan: Scan, mesh: Mesh, settings: SampleSettings, path: Path, progress: StepReport
) -> None:
    """Write a subject's samples as one ``.npz``.

    ``rgb`` (N, H, W, 3) uint8, black outside the subject; ``mask`` (N, H, W) bool; and int8 unit
    normals (N, H, W, 3) in steps of 1/127, map frame, 0 where there are none: ``front`` and
    ``back`` of the scan, ``body_front`` and ``body_back``. What puts a photo into another light is
    uint8, too: ``albedo`` (N, H, W, 3) in sRGB, ``lights`` (N, H, W, 4) of sky, ground and two
    lamps (see ``packed_lights``), and ``coverage`` (N, H, W) in steps of 1/255.

    Raises:
        DataError: a scan without texture or without an Anny body beside it.
    """
    studio = Studio(scan, mesh, settings.seed)
    samples: dict[str, list[NDArray[np.generic]]] = {}
    for view in range(settings.views):
        seed = derive_seed(settings.seed, "normal-sample", scan.subject, view)
        for name, array in studio.sample(settings, seed).items():
            samples.setdefault(name, []).append(array)
        progress(view + 1, settings.views)
    arrays = {name: np.stack(rows) for name, rows in samples.items()}
    # Uncompressed: a network is trained on these again and again.
    write_npz(path, {"key": np.array(samples_key(scan, settings)), **arrays}, compressed=False)


@dataclass(frozen=True, slots=True, eq=False)
class PrintPair:
    """Two photos that differ in what is printed on the subject alone, and the maps of both.

    Attributes:
        camera: Of all maps.
        plain, printed: (H, W, 3) sRGB, black outside the mask.
        mask: (H, W) the subject's.
        front, back: (H, W, 3) unit normals of the scan, map frame, 0 where there are none.
        body_front, body_back: Those of the body with a fit's errors.
    """

    camera: Camera
    plain: Floats
    printed: Floats
    mask: Mask
    front: Floats
    back: Floats
    body_front: Floats
    body_back: Floats


class Studio:
    """One subject, ready to be photographed.

    Raises:
        DataError: a scan without texture or without an Anny body beside it.
    """

    def __init__(self, scan: Scan, mesh: Mesh, seed: int) -> None:
        plain = load_rgb(texture_of(mesh))
        draw = np.random.default_rng(derive_seed(seed, "prints", scan.subject))
        self._textures = [linear_texture(plain)]
        self._textures += [linear_texture(printed(plain, draw)) for _ in range(_PRINTED)]
        self._caster = Raycaster(mesh)
        self._openness = vertex_openness(
            self._caster, _OPENNESS_RAYS, derive_seed(seed, "openness", scan.subject)
        )[:, None]
        self._body = AnnyBody()
        self._truth = true_parameters(scan)
        self._turn, self._shift = scan.scan_to_world[:3, :3], scan.scan_to_world[:3, 3]

    def sample(self, settings: SampleSettings, seed: int) -> dict[str, NDArray[np.generic]]:
        """The arrays of one photo as ``make_samples`` writes them."""
        draw = np.random.default_rng(seed)
        camera = self._camera(settings, draw)
        light, gloss = drawn_light(camera, draw), drawn_gloss(draw)
        is_printed = draw.random() < _PRINTED_SHARE
        texture = self._textures[int(draw.integers(1, 1 + _PRINTED)) if is_printed else 0]
        # From a source of their own: photos stay as they are whatever else is stored with them.
        spare = np.random.default_rng(derive_seed(seed, "spare lamps"))
        lamps = [*light.lamps, *(drawn_lamp(camera, spare) for _ in range(LAMPS))]
        shading = self._shaded(camera, texture, lamps[: max(LAMPS, len(light.lamps))], gloss)
        photo = _developed(shading, camera, light, draw)
        body = self._fitted(seed)
        return {
            "rgb": np.round(255 * photo.rgb).astype(np.uint8),
            "mask": photo.mask,
            "front": packed_normals(self._caster.normals(camera, "near")),
            "back": packed_normals(self._caster.normals(camera, "far")),
            "body_front": packed_normals(body.normals(camera, "near")),
            "body_back": packed_normals(body.normals(camera, "far")),
            **_light_maps(shading),
        }

    def pair(self, settings: SampleSettings, seed: int) -> PrintPair:
        """One scene photographed twice: in the subject's own texture, and with prints on it."""
        draw = np.random.default_rng(seed)
        camera = self._camera(settings, draw)
        light, gloss = drawn_light(camera, draw), drawn_gloss(draw)
        textures = self._textures[0], self._textures[int(draw.integers(1, 1 + _PRINTED))]
        grain = derive_seed(seed, "grain")
        plain, printed = (
            self._photo(camera, texture, light, gloss, np.random.default_rng(grain))
            for texture in textures
        )
        body = self._fitted(seed)
        return PrintPair(
            camera=camera,
            plain=plain.rgb,
            printed=printed.rgb,
            mask=plain.mask,
            front=self._caster.normals(camera, "near"),
            back=self._caster.normals(camera, "far"),
            body_front=body.normals(camera, "near"),
            body_back=body.normals(camera, "far"),
        )

    def _camera(self, settings: SampleSettings, draw: np.random.Generator) -> Camera:
        size = PhotoSize(settings.side_px, settings.width_px, settings.height_px)
        return drawn_camera(self._caster.mesh.vertices, size, draw)

    def _fitted(self, seed: int) -> Raycaster:
        """The true body with a fit's errors."""
        fitted = as_fitted(self._body, self._truth, FitErrors(), derive_seed(seed, "body"))
        skin = Mesh(fitted @ self._turn.T + self._shift, self._body.faces, source="perturbed body")
        return Raycaster(skin)

    def _photo(
        self,
        camera: Camera,
        texture: Floats,
        light: Light,
        gloss: Gloss,
        draw: np.random.Generator,
    ) -> Picture:
        """What a camera sees in a light; black outside the mask, as working views are."""
        return _developed(self._shaded(camera, texture, light.lamps, gloss), camera, light, draw)

    def _shaded(
        self, camera: Camera, texture: Floats, lamps: Sequence[Lamp], gloss: Gloss
    ) -> Shading:
        n = _SUPERSAMPLE
        fine = camera.resized(camera.width * n, camera.height * n)
        return shaded(self._caster, self._openness, fine, texture, lamps, gloss)


def _developed(
    shading: Shading, camera: Camera, light: Light, draw: np.random.Generator
) -> Picture:
    straight, coverage = averaged(shading.radiance(light), shading.mask, _SUPERSAMPLE)
    mask = coverage >= 0.5
    picture = np.zeros_like(straight)
    # Displays blend in sRGB, and so do working pictures: over black, by coverage.
    picture[mask] = photographed(straight[mask], light, draw) * coverage[mask][:, None]
    return Picture(camera, picture, coverage)


def _light_maps(shading: Shading) -> dict[str, NDArray[np.generic]]:
    """What puts a photo into another light, as ``make_samples`` writes it."""
    lights = shading.lights[:, : 2 + LAMPS]
    values, coverage = averaged(
        np.concatenate([shading.albedo, lights], axis=1), shading.mask, _SUPERSAMPLE
    )
    return {
        "albedo": np.round(255 * srgb_from_linear(np.clip(values[..., :3], 0, 1))).astype(np.uint8),
        "lights": packed_lights(values[..., 3:]),
        "coverage": np.round(255 * coverage).astype(np.uint8),
    }

"""Exact pictures and cameras turned into what a camera and a calibration give, by seed."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from harness.core.arrays import Bytes, Floats, Mask
from harness.core.artifacts import image_name
from harness.core.cameras.camera import Camera
from harness.core.cameras.photography import PhotoFaults
from harness.core.files.hashing import derive_seed
from harness.geometry.images import linear_from_srgb, load_rgba, save_png, srgb_from_linear

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

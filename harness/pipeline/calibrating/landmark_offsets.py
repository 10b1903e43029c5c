"""Measures what ``methods/body/models/offsets.py`` holds, on generated people whose body is known.

``python -m harness.pipeline.calibrating.landmark_offsets t00001..t00036`` makes these training
avatars and their photos (by ray casting) in the workspace unless they are there, and prints the
table to put into that module, with the landmarks' spread. Never run it on subjects that are tested
on.

An offset is how far a landmark is detected from the true body's point, and to it how far a body
that is fitted with such offsets still is: silhouettes of clothes and priors pull as well.
"""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from harness.core.arrays import Floats
from harness.core.artifacts import Capture, Scan
from harness.core.cameras.camera import Camera
from harness.core.errors import DataError, HarnessError
from harness.core.process.steps import silent
from harness.core.protocols import Context
from harness.core.truth import true_parameters
from harness.core.units import MM_PER_METRE
from harness.data.manifest import load_manifest, subject_range
from harness.pipeline.inputs.sources import Source
from harness.pipeline.inputs.workspace import Workspace
from methods.body.fitting import fitted_parameters
from methods.body.models.anatomy import blend_landmarks
from methods.body.models.anny_body import AnnyBody
from methods.body.models.model import LandmarkTable, ParametricBody, Posed
from methods.body.photos.detection import MIRRORED, Detections, detect
from methods.body.photos.views import load_views
from methods.body_fit import jmbo8_plus

_DATASET, _SIZE = "avatars-train", (540, 960)
#: Distances at which a view's pixel, and a subject's deviation, count half.
_HALF_PX, _HALF_MM = 8.0, 20.0
_ROUNDS = 30
_MIRROR = np.array([-1.0, 1.0, 1.0])


def triangulated(cameras: Sequence[Camera], pixels: Floats, confidence: Floats) -> Floats:
    """(3,) world point that pixels (N, 2) of N cameras agree on; a few wrong ones do little."""
    projections = np.array([camera.K @ camera.world_to_camera[:3] for camera in cameras])
    point, weight = np.zeros(3), np.ones(len(cameras))
    for _ in range(_ROUNDS):
        # Divided by the depth, the residuals of these equations are pixels.
        rows = pixels[:, :, None] * projections[:, 2:] - projections[:, :2]
        rows *= np.sqrt(confidence * weight)[:, None, None]
        rows /= (projections[:, 2] @ np.append(point, 1.0))[:, None, None]
        rows = rows.reshape(-1, 4)
        point = np.linalg.lstsq(rows[:, :3], -rows[:, 3], rcond=None)[0]
        seen = projections @ np.append(point, 1.0)
        error_px = np.linalg.norm(seen[:, :2] / seen[:, 2:] - pixels, axis=1)
        weight = 1.0 / (1.0 + (error_px / _HALF_PX) ** 2)
    return point


def deviations_mm(
    cameras: Sequence[Camera], found: Detections, posed: Posed, table: LandmarkTable
) -> Floats:
    """(K, 3) from a true body's landmarks to the detected ones, in their carriers' rest axes."""
    blends = blend_landmarks(replace(table, offsets=np.zeros_like(table.offsets)), posed)
    turns = posed.turns[0, table.carriers].double().numpy()
    points = [
        triangulated(cameras, found.pixels[:, landmark], found.confidence[:, landmark])
        for landmark in table.landmarks
    ]
    away = np.array(points) - blends[0].double().numpy()
    return np.einsum("kji,kj->ki", turns, away) * MM_PER_METRE


def remaining_mm(fitted: Posed, truth: Posed, body: ParametricBody) -> Floats:
    """(K, 3) from a true body's landmarks to a fitted one's, in the true carriers' rest axes."""
    turns = truth.turns[0, body.landmarks.carriers].double().numpy()
    away = (body.landmark_points(fitted) - body.landmark_points(truth))[0].double().numpy()
    return np.einsum("kji,kj->ki", turns, away) * MM_PER_METRE


def symmetric_means(deviations: Floats, landmarks: Sequence[int]) -> tuple[Floats, Floats]:
    """Robust means (K, 3) of deviations (S, K, 3), mirrored left to right, and spreads (K,).

    The spread is the median distance from the mean, in the deviations' unit.
    """
    order = list(landmarks)
    other = [order.index(MIRRORED[landmark]) for landmark in order]
    both = np.concatenate([deviations, deviations[:, other] * _MIRROR])
    means = np.median(both, axis=0)
    for _ in range(_ROUNDS):
        away = np.linalg.norm(both - means, axis=2)
        weight = 1.0 / (1.0 + (away / _HALF_MM) ** 2)
        means = (weight[..., None] * both).sum(axis=0) / weight.sum(axis=0)[:, None]
    return means, np.median(np.linalg.norm(both - means, axis=2), axis=0)


def true_posed(body: AnnyBody, scan: Scan) -> Posed:
    """A generated subject's true body in the world frame.

    Raises:
        DataError: as ``true_parameters``, or the body was moved off the model, so that the model's
            surface, from which landmarks are blended, is not the true one.
    """
    import torch

    truth = true_parameters(scan)
    if truth.off_model_m:
        raise DataError(
            f"the body of {scan.subject} is none that the body model can give",
            expected="a body whose parameters give its surface",
            got=f"one {truth.off_model_m * MM_PER_METRE:.1f} mm off",
            hint="Use subjects of avatars-train",
        )
    posed = body.posed_as(truth.pose_parameters, truth.phenotype)
    shift = torch.tensor(scan.scan_to_world[:3, 3], dtype=torch.float32)
    return replace(posed, vertices=posed.vertices + shift, joints=posed.joints + shift)


def _main(subjects: str) -> None:
    chosen = subject_range(subjects) or tuple(subjects.split(","))
    source = Source.select(load_manifest(None), Workspace.default(), _DATASET, chosen, "paper8")
    width, height = _SIZE
    recipe = replace(
        source.render_recipe, name="offsets8", renderer="raycast", width=width, height=height
    )
    source = replace(source, recipe=recipe)
    body = AnnyBody()
    people: list[tuple[Capture, Posed]] = []
    detected: list[Floats] = []
    for subject in chosen:
        try:
            capture = source.ensure_capture(subject, silent)
        except HarnessError as error:
            # Some of the training recipes cannot be made; it is said which.
            sys.stderr.write(f"{subject} left out: {error}\n")
            continue
        views = range(len(capture.cameras))
        posed = true_posed(body, source.load(subject)[0])
        people.append((capture, posed))
        detected.append(
            deviations_mm(capture.cameras, detect(capture, views), posed, body.landmarks)
        )
    order = body.landmarks.landmarks.tolist()
    offsets, _ = symmetric_means(np.array(detected), order)
    body.landmarks = replace(body.landmarks, offsets=(offsets / MM_PER_METRE).astype(np.float32))
    remaining, spreads = symmetric_means(np.array(list(_after_fits(body, people))), order)
    for landmark, offset, spread in zip(order, offsets + remaining, spreads, strict=True):
        x, y, z = np.round(offset).astype(int)
        sys.stdout.write(f"    {landmark}: ({x}, {y}, {z}),  # {spread:.0f} mm\n")


def _after_fits(body: AnnyBody, people: Sequence[tuple[Capture, Posed]]) -> Iterator[Floats]:
    """What remains between each person and the body that is fitted to the photos."""
    import torch

    torch.set_num_threads(1)
    context = Context(seed=0, workdir=Path(), stage=lambda _: contextlib.nullcontext())
    for done, (capture, truth) in enumerate(people, start=1):
        sys.stderr.write(f"fitting {done} of {len(people)}: {capture.subject}\n")
        views = load_views(capture, range(len(capture.cameras)), jmbo8_plus.settings.subject_px)
        fit = fitted_parameters(body, views, jmbo8_plus.settings, context)
        with torch.no_grad():
            yield remaining_mm(body.posed(fit.parameters), truth, body)


if __name__ == "__main__":
    _main(sys.argv[1])

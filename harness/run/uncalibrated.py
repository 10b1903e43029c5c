"""Photos whose cameras were estimated or refined: of a data set's photos, scored honestly.

Estimated cameras are withheld and found again from the photos. A method works in the world that was
found with them, as it would with a user's photos; what it makes is brought to the scan by the
Sim(3) by which found cameras show what true ones do, never by its surface. Refined cameras stay in
the world of those that were given, and nothing is brought anywhere.
"""

import math
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from harness.core.artifacts import Body, Capture, Reconstruction, image_name
from harness.core.camera import Camera
from harness.core.camera_frames import require_perspective, write_transforms_json
from harness.core.errors import HarnessError, did_you_mean
from harness.core.files.atomic import atomic_directory, write_json
from harness.core.files.hashing import content_hash, file_sha256
from harness.core.files.names import CAMERAS, suffix_of
from harness.core.mesh import Mesh
from harness.core.process.registry import Registry
from harness.core.process.source_digest import SourceTree
from harness.core.process.threads import StepReport
from harness.core.protocols import MethodInfo, Privilege
from harness.core.records import MetricValue, Scores
from harness.core.typed_json import to_json
from harness.geometry.images import load_rgba
from harness.geometry.similarity import Similarity, similarity_of_pictures
from harness.geometry.surface import SurfaceIndex
from methods.cameras.values import EstimatedCameras, Focal, PhotoView
from metrics.cameras import camera_errors
from metrics.pair import aligned_by_cameras

#: Found when they are needed: they run on what comes with methods.
ESTIMATORS = Registry(
    "search for cameras",
    {
        "estimate": "methods.cameras.estimate:estimate_cameras",
        "refine": "methods.cameras.estimate:refine_cameras",
    },
)
#: Where a capture tells of its estimate, and of given cameras that were refined.
ESTIMATE, REFINED = "estimate", "refined"
#: Where it tells the true cameras, if its own are not.
_EXACT = "exact_cameras"
#: So many of the scan's vertices, about, are projected.
_POINTS = 2000


def camera_suffix(text: str) -> str:
    """What ``--cameras`` adds to names.

    Raises:
        HarnessError: it is none of the words it can be.
    """
    if text not in CAMERAS:
        hint = did_you_mean(text, CAMERAS)
        raise HarnessError(f"--cameras {text}", expected=" or ".join(CAMERAS), hint=hint)
    return CAMERAS[text]


def estimate_inputs(photos: Capture, suffix: str) -> dict[str, object]:
    """Everything that an estimate depends on; its hash is the key of the capture."""
    code = SourceTree.installed().digest(
        [__name__, ESTIMATORS.module("estimate")], [SourceTree.__module__]
    )
    return {
        "photos": photos.key,
        "cameras": suffix,
        **code.to_dict(),
    }


def estimated_capture(
    photos: Capture, mesh: Mesh, recipe: str, directory: Path, report: StepReport
) -> Capture:
    """A capture of the same photos with estimated or refined cameras, in place of ``directory``.

    Estimated ones are brought to the scan's world; ``own_world`` gives those that were found.

    Args:
        photos: With the true cameras, or with those that a calibration gave.
        mesh: The scan, whose height is told as a person's is: to a centimetre.
        recipe: Its recipe's name, which says how cameras are known.
        directory: Receives ``capture.json``, ``transforms.json`` and ``rgb/``.
        report: Called after every step, counted on from the photos.

    Raises:
        MethodError: no cameras can be trusted of these photos.
        DataError: a camera is orthographic.
        MissingPart: MediaPipe is not installed.
    """
    inputs = estimate_inputs(photos, suffix_of(recipe))
    is_refined = suffix_of(recipe) == CAMERAS["refined"]
    if is_refined:
        found = refined_cameras(_views(photos), photos.cameras, report)
        told: dict[str, Any] = found.to_dict()
    else:
        found, told = _estimated(photos, mesh, suffix_of(recipe), report)
    kept = [view for view, camera in enumerate(found.cameras) if camera is not None]
    own = [camera for camera in found.cameras if camera is not None]
    known = [_true_cameras(photos)[view] for view in kept]
    move = Similarity.of(np.eye(4)) if is_refined else similarity_of_pictures(own, known)
    x, _, z = move.rotation[:, 2]  # where the person faces
    images = [image_name(number) for number in range(len(kept))]
    with atomic_directory(directory) as folder:
        for view, name in zip(kept, images, strict=True):
            (folder / name).parent.mkdir(exist_ok=True)
            shutil.copyfile(photos.image_path(view), folder / name)
        told["own_cameras"] = [camera.to_dict() for camera in own]
        if not is_refined:
            told["own_to_world"] = move.matrix.tolist()
        hashes = {name: file_sha256(folder / name) for name in images}
        made = replace(
            photos,
            recipe=recipe,
            key=content_hash(inputs),
            directory=directory,
            cameras=tuple(move.camera(camera) for camera in own),
            front_yaw_deg=photos.front_yaw_deg if is_refined else math.degrees(math.atan2(x, z)),
            warnings=(*photos.warnings, *found.remarks),
            provenance={
                **photos.provenance,
                "inputs": inputs,
                "images": hashes,
                REFINED if is_refined else ESTIMATE: told,
                _EXACT: [camera.to_dict() for camera in known],
            },
        )
        write_transforms_json(folder / "transforms.json", made.cameras, images)
        write_json(folder / "capture.json", made.to_dict())
    return made


def refined_cameras(
    photos: Sequence[PhotoView], cameras: Sequence[Camera], report: StepReport
) -> EstimatedCameras:
    """Given cameras as outlines and photos correct them, in the world in which they were given.

    Raises:
        MethodError: photos and cameras contradict each other, or a camera is orthographic.
    """
    return ESTIMATORS.resolve("refine")(photos, cameras, report=report)


def _views(photos: Capture) -> list[PhotoView]:
    return [
        PhotoView(f"photo {view}", load_rgba(photos.image_path(view)))
        for view in range(len(photos.cameras))
    ]


def _estimated(
    photos: Capture, mesh: Mesh, suffix: str, report: StepReport
) -> tuple[EstimatedCameras, dict[str, object]]:
    """The cameras in a world of their own, and what a capture tells of them."""
    require_perspective(photos.cameras, "cannot be estimated from photos")
    views = _views(photos)
    focal, source = Focal.unknown(views), "found"
    if suffix == CAMERAS["estimated"]:
        focal = Focal(tuple(float(camera.K[0, 0]) for camera in photos.cameras))
        source = "given"
    return found_cameras(views, (focal, source), round(float(mesh.extent[1]), 2), report)


def found_cameras(
    photos: Sequence[PhotoView], focal: tuple[Focal, str], height_m: float, report: StepReport
) -> tuple[EstimatedCameras, dict[str, object]]:
    """The cameras in a world of their own, and what a capture tells of them.

    Args:
        photos: Of a person who stands still.
        focal: Their focal lengths, and where these are from: ``given``, ``file`` or ``found``.
        height_m: The person's, metres.
        report: Called after every step, counted on from the photos.

    Raises:
        MethodError: no cameras can be trusted of these photos.
        MissingPart: MediaPipe is not installed.
    """
    found: EstimatedCameras = ESTIMATORS.resolve("estimate")(
        photos, focal=focal[0], height_m=height_m, report=report
    )
    return found, {"focal": focal[1], "height_m": height_m, **found.to_dict()}


def _true_cameras(photos: Capture) -> tuple[Camera, ...]:
    """The exact ones, where methods are given what a calibration finds."""
    exact = photos.provenance.get(_EXACT)
    return tuple(map(Camera.from_dict, exact)) if exact else photos.cameras


def own_world(capture: Capture) -> Capture:
    """The capture as a method is given it: with the cameras as they were found, where they were."""
    if "own_to_world" not in _told(capture):
        return capture
    return replace(capture, cameras=found_and_true(capture)[0], front_yaw_deg=0.0)


def _told(capture: Capture) -> Mapping[str, Any]:
    """What a capture tells of its estimated or refined cameras; nothing of those given."""
    return capture.provenance.get(ESTIMATE) or capture.provenance.get(REFINED) or {}


def brought(
    result: Reconstruction, capture: Capture, truth: Mesh
) -> tuple[Reconstruction, dict[str, object]]:
    """What a method made of ``own_world``, brought to the scan by the Sim(3) of the cameras.

    With what a record says of it: nothing where cameras were given. A body's own parameters, which
    place it in the world that was found, stay.
    """
    if own_world(capture) is capture:
        return result, {}
    own, known = found_and_true(capture)
    aligned = aligned_by_cameras(result.mesh, SurfaceIndex(truth), own, known)
    move = Similarity.of(np.array(aligned.matrix))
    moved = replace(
        result,
        mesh=result.mesh.transformed(move.matrix),
        body=result.body and _moved_body(result.body, move),
        normals=tuple(replace(each, camera=move.camera(each.camera)) for each in result.normals),
    )
    return moved, {"brought_to_scan": to_json(aligned)}


def _moved_body(body: Body, move: Similarity) -> Body:
    marks = body.landmarks
    return replace(
        body,
        vertices=move.points(body.vertices),
        joints=move.points(body.joints),
        landmarks=marks and replace(marks, points=move.points(marks.points)),
    )


def with_cameras(
    scores: Scores,
    method: MethodInfo,
    result: Reconstruction,
    capture: Capture,
    truth: Mesh,
) -> Scores:
    """The scores with the errors of cameras that the capture, or else the method, estimated."""
    diagnostics = scores.diagnostics
    if "own_cameras" in _told(capture):
        found, known = found_and_true(capture)
        if own_world(capture) is not capture:
            diagnostics = diagnostics and replace(diagnostics, alignment="sim3-cameras")
    elif result.cameras and _are_estimated(method, capture):
        found, known = zip(*result.cameras, strict=True)
    else:
        return scores
    points = truth.vertices[:: max(1, len(truth.vertices) // _POINTS)]
    errors = camera_errors(found, known, points)
    if (sd_deg := _told(capture).get("turn_sd_deg")) is not None:
        errors["camera_rotation_sd"] = MetricValue(sd_deg, "deg", len(found), 0.0)
    return replace(scores, metrics={**scores.metrics, **errors}, diagnostics=diagnostics)


def _are_estimated(method: MethodInfo, capture: Capture) -> bool:
    """Whether a method's cameras are its own finding, and those beside them the true ones."""
    has_scan = Privilege.GROUND_TRUTH_MESH in method.privileges
    return not has_scan and _EXACT not in capture.provenance


def found_and_true(capture: Capture) -> tuple[tuple[Camera, ...], tuple[Camera, ...]]:
    """Cameras of the photos as they were found, in their own world, and the true ones."""
    return tuple(map(Camera.from_dict, _told(capture)["own_cameras"])), _true_cameras(capture)

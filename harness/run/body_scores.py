"""The numbers of a fitted body: against the photos' landmarks, the scan, and the true body.

Pictures of body and scan are ray-cast at the capture's own cameras; the landmarks are those that
the detector finds in the photos, the same for every method, whichever views the method itself used.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from harness.core.arrays import Floats
from harness.core.artifacts import Body, Capture
from harness.core.camera import Camera
from harness.core.mesh import Mesh
from harness.core.process.shared_work import Sharing, alone
from harness.core.records import BodyErrors, MetricValue
from harness.core.truth import TrueBody
from harness.core.units import Unit
from harness.geometry.raycast import Raycaster
from methods.body.photos.detection import detect
from methods.body.photos.views import frame_side_px
from metrics import body as measure

#: Longer side of the subject in the pictures that are compared, pixels.
_SUBJECT_PX = 512


@dataclass(frozen=True, slots=True)
class _ViewErrors:
    """The metrics of one view; NaN where the view does not tell."""

    silhouette_loss: float
    silhouette_iou: float
    normal_loss: float
    landmark_loss: float


def body_errors(
    body: Body, capture: Capture, scan: Mesh, truth: TrueBody | None, share: Sharing = alone
) -> BodyErrors:
    """Every metric that the body and the dataset allow.

    Args:
        body: Fitted to the photos, world metres.
        capture: The photos.
        scan: The subject's true surface, world metres.
        truth: The true body, where the dataset has it.
        share: Finds the landmarks, or hands out those that were found before.

    Raises:
        DataError: an image cannot be read.
        MissingPart: MediaPipe is not installed.
    """
    views = _view_errors(body, capture, scan, share)
    silhouette = _mean([view.silhouette_loss for view in views], Unit.none)
    normal = _mean([view.normal_loss for view in views], Unit.none)
    landmark = _mean([view.landmark_loss for view in views], Unit.none)
    total = None
    if silhouette and normal and landmark:
        loss = measure.total_loss(silhouette.value, normal.value, landmark.value)
        total = _value(loss, Unit.none, len(views))
    return replace(
        _against_truth(body, truth),
        silhouette_loss=silhouette,
        normal_loss=normal,
        landmark_loss=landmark,
        silhouette_iou=_mean([view.silhouette_iou for view in views], Unit.ratio),
        total_loss=total,
    )


def _value(value: float, unit: Unit, n: int) -> MetricValue:
    return MetricValue(value=value, unit=unit.value, n=n, standard_error=0.0)


def _mean(by_view: Sequence[float], unit: Unit) -> MetricValue | None:
    """The mean over the views that tell; None where none does."""
    values = np.array(by_view)
    values = values[np.isfinite(values)]
    return _value(float(values.mean()), unit, len(values)) if len(values) else None


def _view_errors(body: Body, capture: Capture, scan: Mesh, share: Sharing) -> list[_ViewErrors]:
    found = detect(capture, range(len(capture.cameras)), share)
    ours = Raycaster(Mesh(vertices=body.vertices, faces=body.faces, source="fitted body"))
    theirs = Raycaster(scan.geometry())
    views = []
    for index, camera in enumerate(capture.cameras):
        side = frame_side_px(theirs.mask(camera.resized(*_small(camera, 0.25))))
        scale = min(1.0, _SUBJECT_PX / (4.0 * side))
        view = camera.resized(*_small(camera, scale))
        truth_hits, body_hits = theirs.cast(view), ours.cast(view)
        side = frame_side_px(truth_hits.mask)
        views.append(
            _ViewErrors(
                silhouette_loss=measure.silhouette_loss(body_hits.mask, truth_hits.mask, side),
                silhouette_iou=measure.silhouette_iou(body_hits.mask, truth_hits.mask),
                normal_loss=measure.normal_loss(
                    ours.normals_at(body_hits, view, "camera"),
                    theirs.normals_at(truth_hits, view, "camera"),
                    side,
                ),
                landmark_loss=_landmark_loss(
                    body,
                    camera,
                    found.pixels[index],
                    found.confidence[index],
                    side * camera.height / view.height,
                ),
            )
        )
    return views


def _small(camera: Camera, scale: float) -> tuple[int, int]:
    return max(1, round(camera.width * scale)), max(1, round(camera.height * scale))


def _landmark_loss(
    body: Body, camera: Camera, detected_px: Floats, confidence: Floats, side_px: float
) -> float:
    if body.landmarks is None:
        return float("nan")
    index = body.landmarks.indices
    pixels, _ = camera.project(body.landmarks.points)
    return measure.landmark_loss(pixels, detected_px[index], confidence[index], side_px)


def _against_truth(body: Body, truth: TrueBody | None) -> BodyErrors:
    """Errors in mm, where truth and fit are the same model."""
    if truth is None:
        return BodyErrors()
    if not truth.joint_names and body.vertices.shape == truth.vertices.shape:
        # The surface of a fit of the same model, without its joints.
        vertices_mm = measure.vertex_error_mm(body.vertices, truth.vertices)
        mean_mm = float(vertices_mm.mean())
        return BodyErrors(vertex_error=_value(mean_mm, Unit.millimetre, len(vertices_mm)))
    if body.joint_names != truth.joint_names:
        return BodyErrors()
    main = body.main_joints
    joints_mm = measure.joint_error_mm(body.joints[main], truth.joints[main])
    vertices_mm = measure.vertex_error_mm(body.vertices, truth.vertices)
    off_mm = truth.off_model_mm
    return BodyErrors(
        off_model=_value(off_mm, Unit.millimetre, len(vertices_mm)) if off_mm else None,
        joint_error=_value(float(joints_mm.mean()), Unit.millimetre, len(joints_mm)),
        vertex_error=_value(float(vertices_mm.mean()), Unit.millimetre, len(vertices_mm)),
    )

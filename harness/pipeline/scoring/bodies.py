"""The numbers of a fitted body: against the photos' landmarks, the scan, and the true body.

Pictures of body and scan are ray-cast at the capture's own cameras; the landmarks are those that
the detector finds in the photos, the same for every method, whichever views the method itself used.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from harness.core.array_files.npz import read_array_npz
from harness.core.arrays import Floats
from harness.core.artifacts import OFF_MODEL, Body, Capture, Scan
from harness.core.cameras.camera import Camera
from harness.core.errors import DataError
from harness.core.mesh import Mesh
from harness.core.records import MetricValue
from harness.core.units import MM_PER_METRE, Unit
from harness.geometry.raycast import Raycaster
from metrics import body as measure

__all__ = ["TrueBody", "body_metrics"]


#: Longer side of the subject in the pictures that are compared, pixels.
_SUBJECT_PX = 512
_LOSSES = ("silhouette_loss", "normal_loss", "landmark_loss")


@dataclass(frozen=True, slots=True, eq=False)
class TrueBody:
    """A subject's true body in the world frame.

    Attributes:
        vertices: (V, 3) metres.
        joints: (J, 3) metres, by the names of ``joint_names``.
        off_model_mm: How far the vertices are (root mean square) from the surface that the body
            model gives for the subject's parameters; 0 where the body is one of the model's.
    """

    vertices: Floats
    joints: Floats
    joint_names: tuple[str, ...]
    off_model_mm: float = 0.0

    @classmethod
    def of(cls, scan: Scan) -> TrueBody | None:
        """The true body beside a scan, or None where the dataset has none.

        Raises:
            DataError: the file is not one that the avatars' generator writes.
        """
        if scan.body_path is None:
            return None
        try:
            wanted = ("vertices", "joints", "joint_names", OFF_MODEL)
            file = read_array_npz(scan.body_path, wanted)
            vertices, joints = file["vertices"], file["joints"]
            names = tuple(str(name) for name in file["joint_names"])
            off_m = float(file[OFF_MODEL]) if OFF_MODEL in file else 0.0
        except (DataError, KeyError, ValueError) as error:
            raise DataError(f"{scan.body_path} is no true body", got=repr(error)) from error
        turn, shift = scan.scan_to_world[:3, :3], scan.scan_to_world[:3, 3]
        return cls(
            vertices @ turn.T + shift,
            joints @ turn.T + shift,
            names,
            off_m * MM_PER_METRE,
        )


def body_metrics(
    body: Body, capture: Capture, scan: Mesh, truth: TrueBody | None
) -> dict[str, MetricValue]:
    """Every metric that the body and the dataset allow, by id.

    Raises:
        DataError: an image cannot be read.
        MissingPart: MediaPipe is not installed.
    """
    losses = _losses(body, capture, scan)
    names = [*_LOSSES, "silhouette_iou"]
    units = dict.fromkeys(_LOSSES, Unit.none.value) | {"silhouette_iou": Unit.ratio.value}
    metrics = {}
    for name in names:
        values = np.array([view[name] for view in losses])
        values = values[np.isfinite(values)]
        if len(values):
            metrics[name] = _value(float(values.mean()), units[name], len(values))
    if all(name in metrics for name in _LOSSES):
        total = measure.total_loss(
            metrics["silhouette_loss"].value,
            metrics["normal_loss"].value,
            metrics["landmark_loss"].value,
        )
        metrics["total_loss"] = _value(total, Unit.none.value, len(losses))
    return {**metrics, **_against_truth(body, truth)}


def _value(value: float, unit: str, n: int) -> MetricValue:
    return MetricValue(value=value, unit=unit, n=n, standard_error=0.0)


def _losses(body: Body, capture: Capture, scan: Mesh) -> list[dict[str, float]]:
    """The metrics of each view."""
    from methods.body.photos.detection import detect
    from methods.body.photos.views import frame_side_px

    found = detect(capture, range(len(capture.cameras)))
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
            {
                "silhouette_loss": measure.silhouette_loss(body_hits.mask, truth_hits.mask, side),
                "silhouette_iou": measure.silhouette_iou(body_hits.mask, truth_hits.mask),
                "normal_loss": measure.normal_loss(
                    ours.normals_at(body_hits, view, "camera"),
                    theirs.normals_at(truth_hits, view, "camera"),
                    side,
                ),
                "landmark_loss": _landmark_loss(
                    body,
                    camera,
                    (found.pixels[index], found.confidence[index]),
                    side * camera.height / view.height,
                ),
            }
        )
    return views


def _small(camera: Camera, scale: float) -> tuple[int, int]:
    return max(1, round(camera.width * scale)), max(1, round(camera.height * scale))


def _landmark_loss(
    body: Body, camera: Camera, detected: tuple[Floats, Floats], side_px: float
) -> float:
    if body.landmarks is None:
        return float("nan")
    pixels, _ = camera.project(body.landmarks.points)
    found, confidence = (values[body.landmarks.indices] for values in detected)
    return measure.landmark_loss(pixels, found, confidence, side_px)


def _against_truth(body: Body, truth: TrueBody | None) -> Mapping[str, MetricValue]:
    """Errors in mm, where truth and fit are the same model."""
    if truth is None or body.joint_names != truth.joint_names:
        return {}
    main = body.main_joints
    joints = measure.joint_error_mm(body.joints[main], truth.joints[main])
    vertices = measure.vertex_error_mm(body.vertices, truth.vertices)
    unit = Unit.millimetre.value
    off = {}
    if truth.off_model_mm:
        off["off_model"] = _value(truth.off_model_mm, unit, len(vertices))
    return off | {
        "joint_error": _value(float(joints.mean()), unit, len(joints)),
        "vertex_error": _value(float(vertices.mean()), unit, len(vertices)),
    }

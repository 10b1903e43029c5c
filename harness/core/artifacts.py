"""The values that stages pass on: Scan, Capture, Reconstruction.

Each is a plain frozen value with a form on disk, so that each stage can be run, resumed, replaced
or supplied from elsewhere on its own.

Before: ``data_manifest.yaml``. After: ``harness/data/scans.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats, Ints
from harness.core.camera import Camera
from harness.core.errors import DataError, MethodError
from harness.core.files.atomic import read_json
from harness.core.files.hashing import file_sha256
from harness.core.files.names import inside
from harness.core.mesh import Mesh
from harness.core.rigs import views_from_front

CAPTURE_SCHEMA = 1


@dataclass(frozen=True, slots=True)
class Scan:
    """A subject's true surface on disk, with all that turns it into metres in the world frame.

    Attributes:
        dataset: Name of the dataset in the manifest.
        subject: Id within the dataset.
        mesh_path: Textured mesh file in its own units.
        scale_rule: What turned units into metres, as written in the manifest.
        facing_rule: What turned the subject to +Z, as written in the manifest.
        scan_to_world: (4, 4) similarity from file coordinates to world metres: +Y up, facing +Z,
            bounding box centred at the origin. Under the scale rule ``units`` it is the identity:
            the world is the file's own, and its unit counts as a metre.
        sha256: Digest of every file that the scan is made from, by file name.
        warnings: What a reader of the numbers should know, such as an unusual height.
        body_path: Parameters and vertices of the true body, where the dataset has them.
        labels_path: Per-face region labels, where the dataset has them.
        front_yaw_deg: Where the subject faces in the world, from +Z towards +X; not 0 only under
            the scale rule ``units``, which turns nothing.
        truth_sha256: Digests of body and labels, by file name: scores depend on them, photos do
            not.
        reader: ``code`` and ``packages`` that turn the files into metres, as of ``SourceDigest``.
        hidden_rule: ``dropped`` if what no outside ray reaches was left out: the truth is the outer
            surface.
    """

    dataset: str
    subject: str
    mesh_path: Path
    scale_rule: str
    facing_rule: str
    scan_to_world: Floats
    sha256: Mapping[str, str]
    warnings: tuple[str, ...] = ()
    body_path: Path | None = None
    labels_path: Path | None = None
    front_yaw_deg: float = 0.0
    truth_sha256: Mapping[str, str] = field(default_factory=dict[str, str])
    reader: Mapping[str, Mapping[str, str]] = field(default_factory=dict[str, Mapping[str, str]])
    hidden_rule: str = "kept"

    def identity(self) -> dict[str, object]:
        """What makes two scans the same: content and rules, not where they lie."""
        hidden = {} if self.hidden_rule == "kept" else {"hidden_rule": self.hidden_rule}
        return {
            "dataset": self.dataset,
            "subject": self.subject,
            "scale_rule": self.scale_rule,
            "facing_rule": self.facing_rule,
            **hidden,
            "sha256": dict(self.sha256),
        }

    def truth_identity(self) -> dict[str, object]:
        """What makes two scans the same as a truth to score against: body and labels, too."""
        return {**self.identity(), "sha256": {**self.sha256, **self.truth_sha256}}


def image_name(view: int) -> str:
    """The image file of a view, relative to its capture's folder."""
    return f"rgb/{view:02d}.png"


@dataclass(frozen=True, slots=True)
class Capture:
    """Calibrated RGBA photos of one subject: all that a method may see.

    Attributes:
        dataset: Name of the dataset in the manifest.
        subject: Id within the dataset.
        recipe: Name of the render recipe.
        key: Content id of everything that made the images.
        directory: Folder with ``capture.json`` and ``rgb/``.
        cameras: One camera per view, in order.
        warnings: For instance views in which the frame cuts the subject.
        provenance: Recipe, scan identity, renderer, device, proof; as in ``capture.json``.
        front_yaw_deg: Where the subject faces, as in its ``Scan``.
        numbers: The recipe's number of each view where they are counted otherwise, as by
            ``from_front``; empty where views have their own numbers.
    """

    dataset: str
    subject: str
    recipe: str
    key: str
    directory: Path
    cameras: tuple[Camera, ...]
    warnings: tuple[str, ...] = ()
    provenance: Mapping[str, Any] = field(default_factory=dict[str, Any])
    front_yaw_deg: float = 0.0
    numbers: tuple[int, ...] = ()

    def image_path(self, view: int) -> Path:
        """The PNG of a view: 8-bit sRGB colour, alpha is coverage."""
        return self.directory / image_name(self.numbers[view] if self.numbers else view)

    def from_front(self) -> Capture:
        """The same photos counted from the front, as methods and figures see them.

        View 0 is frontal, the others follow by yaw towards the subject's left, whatever numbers the
        recipe's rig gives them; files keep their names.
        """
        order = views_from_front(self.cameras, self.front_yaw_deg)
        return replace(
            self,
            cameras=tuple(self.cameras[view] for view in order),
            numbers=tuple(self.numbers[view] for view in order) if self.numbers else order,
        )

    def damage(self) -> str:
        """Which picture is not what was rendered, in words; empty where all are."""
        pictures: Mapping[str, str] = self.provenance.get("images", {})
        if set(pictures) != {image_name(view) for view in range(len(self.cameras))}:
            return f"{self.directory} does not tell the hashes of its pictures"
        for name, sha256 in pictures.items():
            path = self.directory / name
            if not path.is_file() or file_sha256(path) != sha256:
                return f"{path} is damaged"
        return ""

    def to_dict(self) -> dict[str, object]:
        """The content of ``capture.json``, with cameras in the order of the recipe."""
        numbers = self.numbers or range(len(self.cameras))
        by_number = dict(zip(numbers, self.cameras, strict=True))
        return {
            "schema": CAPTURE_SCHEMA,
            "dataset": self.dataset,
            "subject": self.subject,
            "recipe": self.recipe,
            "key": self.key,
            "cameras": [by_number[number].to_dict() for number in sorted(by_number)],
            "front_yaw_deg": self.front_yaw_deg,
            "warnings": list(self.warnings),
            "provenance": dict(self.provenance),
        }

    @classmethod
    def load(cls, directory: Path) -> Capture:
        """The capture in a folder.

        Raises:
            DataError: no ``capture.json``, another schema, or an image that is not in it.
        """
        path = directory / "capture.json"
        document = read_json(path)
        if document.get("schema") != CAPTURE_SCHEMA:
            raise DataError(
                f"{path} is of another version",
                expected=f"schema {CAPTURE_SCHEMA}",
                got=str(document.get("schema")),
                hint="Delete the folder and render again",
            )
        try:
            capture = cls(
                dataset=str(document["dataset"]),
                subject=str(document["subject"]),
                recipe=str(document["recipe"]),
                key=str(document["key"]),
                directory=directory,
                cameras=tuple(Camera.from_dict(entry) for entry in document["cameras"]),
                warnings=tuple(document["warnings"]),
                provenance=dict(document["provenance"]),
                # Photos made before this was written down are of scans that face +Z.
                front_yaw_deg=float(document.get("front_yaw_deg", 0.0)),
            )
        except DataError as error:
            raise error.located(path) from error
        except (KeyError, TypeError, ValueError) as error:
            raise DataError(f"{path} is incomplete", got=repr(error)) from error
        for view in range(len(capture.cameras)):
            if not inside(path, capture.image_path(view), directory).is_file():
                raise DataError(
                    f"view {view} of {directory} is missing",
                    expected=str(capture.image_path(view)),
                    hint="Delete the folder and render again",
                )
        return capture


@dataclass(frozen=True, slots=True)
class StageCost:
    """What one stage of a method took.

    Attributes:
        name: Stage, such as ``carve`` or ``poisson``.
        wall_s: Wall-clock seconds.
        peak_rss_mib: Peak resident memory of the process tree, MiB.
        peak_gpu_mib: Peak GPU memory, MiB; None where no GPU was used.
    """

    name: str
    wall_s: float
    peak_rss_mib: float
    peak_gpu_mib: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class BodyLandmarks:
    """Where the landmarks that a detector marks in photos are on a body.

    Attributes:
        indices: (K,) the detector's numbers of the landmarks that the body model has.
        points: (K, 3) their places, world metres.
    """

    indices: Ints
    points: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """A fitted parametric body in the world frame.

    Attributes:
        model: Name of the body model.
        vertices: (V, 3) metres.
        joints: (J, 3) metres.
        faces: (F, 3) vertex indices.
        parameters: The model's own parameters, as arrays that its own software takes.
        joint_names: J names; empty where the model names none.
        main_joints: (M,) indices of the joints that errors are measured at.
        landmarks: The detector's landmarks on this body, where the model knows them.
    """

    model: str
    vertices: Floats
    joints: Floats
    faces: NDArray[np.int32]
    parameters: Mapping[str, NDArray[Any]] = field(default_factory=dict[str, NDArray[Any]])
    joint_names: tuple[str, ...] = ()
    main_joints: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    landmarks: BodyLandmarks | None = None

    def to_arrays(self) -> dict[str, Any]:
        """The content of ``body.npz``: the model's parameters are ``parameter_`` and their name."""
        arrays: dict[str, Any] = {
            "model": np.array(self.model),
            "vertices": self.vertices,
            "joints": self.joints,
            "faces": self.faces,
            **{f"parameter_{name}": value for name, value in self.parameters.items()},
        }
        if self.joint_names:
            arrays["parameter_joint_names"] = np.array(self.joint_names)
            arrays["parameter_main_joints"] = self.main_joints
        if self.landmarks is not None:
            arrays["parameter_landmark_index"] = self.landmarks.indices
            arrays["parameter_landmark_points"] = self.landmarks.points
        return arrays


@dataclass(frozen=True, slots=True, eq=False)
class NormalMaps:
    """The clothed normals that a method estimated in one view, to be compared with the scan's.

    Maps are (H, W, 3) unit normals inside the mask, 0 outside: x right, y up, z towards the viewer.
    The near side is what the photo shows, the far side the last surface along the same rays.

    Attributes:
        view: Index in the capture.
        camera: Whose pixels the maps have: a view's own, or a crop of it at another size.
        mask: (H, W) where the subject is.
        front, back: The estimate of the near and of the far side.
        body_front, body_back: The fitted body's own normals, the floor of an estimate.

    Raises:
        MethodError: a map that is not of the camera's size.
    """

    view: int
    camera: Camera
    mask: NDArray[np.bool_]
    front: Floats
    back: Floats
    body_front: Floats
    body_back: Floats

    def __post_init__(self) -> None:
        size = (self.camera.height, self.camera.width)
        for name in ("mask", "front", "back", "body_front", "body_back"):
            expected = size if name == "mask" else (*size, 3)
            got = getattr(self, name).shape
            if got != expected:
                raise MethodError(
                    f"the {name.replace('_', ' ')} map of view {self.view} does not fit its camera",
                    expected=f"shape {expected}",
                    got=f"shape {got}",
                )


@dataclass(frozen=True, slots=True)
class Reconstruction:
    """What a method made of a capture.

    Attributes:
        mesh: Clothed surface, metres, world frame.
        body: The fitted body, for methods that fit one.
        details: Whatever a reader of the record should know, as JSON values.
        normals: Maps of the views in which the method estimated normals; empty where it does not.
        cameras: Of a method that finds cameras itself, each with the one that it was given, both in
            pixels of the photo; those found may have a world of their own.
    """

    mesh: Mesh
    body: Body | None = None
    details: Mapping[str, object] = field(default_factory=dict[str, object])
    normals: tuple[NormalMaps, ...] = ()
    cameras: tuple[tuple[Camera, Camera], ...] = ()

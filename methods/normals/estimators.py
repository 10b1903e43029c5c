"""Who turns a photo into clothed normals: the body itself, the scan, or a network.

Each is a ``harness.core.protocols.NormalEstimator``: (rgb, mask, body front, body back) to clothed
front and back normals on the same pixels, x right, y up, z towards the viewer.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.core.camera import Camera
from harness.core.errors import HarnessError, MethodError, MissingPart
from harness.core.protocols import NormalEstimator, Part
from methods.normals.onnx_estimator import OnnxNormals

__all__ = ["BodyNormals", "NormalChoice", "OracleNormals"]

Floats = NDArray[np.float64]
#: ``oracle(camera, side="near" | "far")``: the scan's normals (H, W, 3), map frame.
Oracle = Callable[..., Floats]

_KINDS = ("body", "oracle", "onnx")
_PRIVILEGE = "oracle_normals"


class BodyNormals:
    """The body's own normals: the floor that an estimator has to beat."""

    def __call__(
        self,
        rgb: Floats,  # noqa: ARG002
        mask: Floats,  # noqa: ARG002
        body_front: Floats,
        body_back: Floats,
    ) -> tuple[Floats, Floats]:
        """The body's maps as they are; see ``NormalEstimator``."""
        return body_front, body_back


class OracleNormals:
    """The scan's normals, rendered by the pipeline: the ceiling, and a declared privilege."""

    def __init__(self, oracle: Oracle, camera: Camera) -> None:
        self._oracle = oracle
        self._camera = camera

    def __call__(
        self,
        rgb: Floats,  # noqa: ARG002
        mask: Floats,
        body_front: Floats,  # noqa: ARG002
        body_back: Floats,  # noqa: ARG002
    ) -> tuple[Floats, Floats]:
        """The scan's near and far side in the camera; see ``NormalEstimator``."""
        if mask.shape != (self._camera.height, self._camera.width):
            raise MethodError(
                "the picture is not that of the oracle's camera",
                expected=f"{self._camera.width} x {self._camera.height} pixels",
                got=f"{mask.shape[1]} x {mask.shape[0]}",
            )
        return self._oracle(self._camera), self._oracle(self._camera, side="far")


@dataclass(frozen=True, slots=True)
class NormalChoice:
    """Which estimator a method runs with, told before anything is loaded.

    Attributes:
        kind: ``body``, ``oracle`` or ``onnx``.
        model: The network's file, for ``onnx``.

    Raises:
        HarnessError: another kind; ``onnx`` without a file, or a file without ``onnx``.
    """

    kind: str
    model: str = ""

    def __post_init__(self) -> None:
        if self.kind not in _KINDS:
            raise HarnessError(
                f"setting 'normals' cannot be '{self.kind}'", expected=" or ".join(_KINDS)
            )
        if (self.kind == "onnx") != bool(self.model):
            raise HarnessError(
                "settings 'normals' and 'normals_model' do not go together",
                expected="a model file with normals=onnx, and only with it",
                got=f"normals={self.kind}, normals_model={self.model or 'nothing'}",
            )

    @property
    def privileges(self) -> tuple[str, ...]:
        """What the estimator is given beyond photos."""
        return (_PRIVILEGE,) if self.kind == "oracle" else ()

    @property
    def part(self) -> Part:
        """As records name it.

        Raises:
            MissingPart: the network's file, or onnxruntime, is not there.
        """
        if self.kind == "onnx":
            return _network(Path(self.model)).part
        name = {"body": "normals of the fitted body", "oracle": "normals of the scan"}[self.kind]
        return Part("normal estimator", name, "none needed")

    def estimator(self, camera: Camera, privileged: Mapping[str, Any]) -> NormalEstimator:
        """The estimator for the pictures of one camera.

        Args:
            camera: Of the working picture.
            privileged: ``Context.privileged``.

        Raises:
            MethodError: oracle normals were not lent.
            MissingPart: as ``part``.
        """
        if self.kind == "body":
            return BodyNormals()
        if self.kind == "onnx":
            return _network(Path(self.model))
        if _PRIVILEGE not in privileged:
            raise MethodError(
                "the normals of the scan were not handed in",
                expected=f"the privilege '{_PRIVILEGE}'",
                got=", ".join(privileged) or "no privilege",
                hint="The pipeline lends them: run 'harness eval'",
            )
        return OracleNormals(privileged[_PRIVILEGE], camera)


@functools.lru_cache(maxsize=1)
def _network(path: Path) -> OnnxNormals:
    if not path.is_file():
        raise MissingPart(f"no network at {path}", hint="Set normals_model to an ONNX file")
    return OnnxNormals(path)

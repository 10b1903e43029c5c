"""Any front/back normal network that was exported to ONNX.

The file has the inputs ``image`` (1, 3, H, W), sRGB in [-1, 1] and 0 outside the mask, and
``body_front``, ``body_back`` (1, 3, H, W), unit normals in the map frame; and the outputs ``front``
and ``back`` (1, 3, H, W) in the same frame, of any length. Its metadata says ``name`` and
``licence``, and optionally ``body_background``: the value that body maps have where there is no
body, 0 unless given (ECON's networks were trained with 0.00392).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.core.errors import DataError, MissingPart
from harness.core.hashing import file_sha256
from harness.core.protocols import Part

__all__ = ["OnnxNormals"]

Floats = NDArray[np.float64]

_INPUTS = ("image", "body_front", "body_back")
_OUTPUTS = ("front", "back")
#: Networks halve their pictures up to five times.
_MULTIPLE = 32


class OnnxNormals:
    """Runs the network with onnxruntime on the processor.

    Raises:
        MissingPart: onnxruntime is not installed.
        DataError: not an ONNX file, other inputs and outputs, or no name and licence in it.
    """

    def __init__(self, path: Path) -> None:
        self._session = _session(path)
        for what, found, wanted in (
            ("inputs", self._session.get_inputs(), _INPUTS),
            ("outputs", self._session.get_outputs(), _OUTPUTS),
        ):
            names = {node.name for node in found}
            if names != set(wanted):
                raise DataError(
                    f"{path} has other {what} than a normal estimator",
                    expected=", ".join(wanted),
                    got=", ".join(sorted(names)),
                )
        about = self._session.get_modelmeta().custom_metadata_map
        if not (about.get("name") and about.get("licence")):
            raise DataError(
                f"{path} does not say what it is",
                expected="metadata 'name' and 'licence'",
                got=", ".join(sorted(about)) or "no metadata",
            )
        self._background = float(about.get("body_background", "0"))
        self.part = Part("normal estimator", about["name"], about["licence"], file_sha256(path))

    def __call__(
        self, rgb: Floats, mask: Floats, body_front: Floats, body_back: Floats
    ) -> tuple[Floats, Floats]:
        """Clothed unit normals, 0 outside the mask; see ``NormalEstimator``."""
        inside = mask[..., None] >= 0.5
        arrays = [(2.0 * rgb - 1.0) * inside, self._body(body_front), self._body(body_back)]
        height, width = mask.shape
        feeds = {name: _batch(_padded(array)) for name, array in zip(_INPUTS, arrays, strict=True)}
        front, back = (
            np.moveaxis(answer[0].astype(np.float64), 0, -1)[:height, :width]
            for answer in self._session.run(list(_OUTPUTS), feeds)
        )
        return _unit(front) * inside, _unit(back) * inside

    def _body(self, normals: Floats) -> Floats:
        there = np.abs(normals).sum(axis=2, keepdims=True) > 0
        return np.where(there, normals, self._background)


def _session(path: Path) -> Any:
    try:
        import onnxruntime
    except ImportError as error:
        raise MissingPart(
            "networks are run by onnxruntime, which is not installed",
            hint="Run: pip install onnxruntime",
        ) from error
    try:
        return onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime has no public base of its errors
        raise DataError(f"{path} is not a network that can be run", got=str(error)) from error


def _padded(array: Floats) -> Floats:
    """(H, W, 3) enlarged to the right and below, by its edge, to a size that networks can halve."""
    height, width = array.shape[:2]
    return np.pad(array, ((0, -height % _MULTIPLE), (0, -width % _MULTIPLE), (0, 0)), mode="edge")


def _batch(array: Floats) -> NDArray[np.float32]:
    return np.moveaxis(array, -1, 0)[None].astype(np.float32)


def _unit(normals: Floats) -> Floats:
    length = np.linalg.norm(normals, axis=2, keepdims=True)
    return normals / np.where(length > 0, length, 1.0)

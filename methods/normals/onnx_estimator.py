"""Any front/back normal network that was exported to ONNX.

The file has the inputs ``image`` (1, 3, H, W), sRGB in [-1, 1] and 0 outside the mask, and
``body_front``, ``body_back`` (1, 3, H, W), unit normals in the map frame; if it wants, ``mask``
(1, 1, H, W), 1 on the subject and 0 elsewhere; and the outputs ``front`` and ``back``
(1, 3, H, W) in the same frame, of any length. H and W are multiples of 32. It may also have both
``front_error`` and ``back_error`` (1, 1, H, W), by how many radians it expects to be off. Its
metadata says:

* ``name`` and ``licence``;
* optionally ``training_set``: what it was trained on, with its version;
* optionally ``body_background``: the value that body maps have where there is no body, 0 unless
  given (ECON's networks were trained with 0.00392);
* optionally ``window``: ``mask`` if the network was trained on windows around the
  subject and has to run on such; without it, it gets the whole picture;
* optionally ``side_px``: the side of the square around the subject that it was trained on, where it
  has to have that; without it, it gets the method's own.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats, Mask
from harness.core.errors import DataError, MethodError
from harness.core.protocols import EstimatedNormals, Part
from harness.geometry.images import unit_normals
from harness.geometry.window import Window, rounded_up
from methods.parts.onnx_networks import network_sha256, open_session

#: Least number of pixels between the subject and the window's border.
MARGIN_PX = 16
#: Sides of what a network works on are multiples of this.
MULTIPLE = 32


def mask_window(mask: Mask) -> Window:
    """The window around a mask (H, W) that is true somewhere, ``MARGIN_PX`` free on every side.

    What rounding adds is shared between both sides; the right and lower get an odd pixel more.
    """
    box = Window.around(mask).grown(MARGIN_PX)
    sides = (rounded_up(side, MULTIPLE) for side in box.size)
    return box.about_its_middle(*sides, odd_pixel="last")


def whole_window(size: tuple[int, int]) -> Window:
    """The window of a whole picture (width, height), enlarged to the right and below."""
    width, height = (rounded_up(side, MULTIPLE) for side in size)
    return Window(0, 0, width, height)


_INPUTS = ("image", "body_front", "body_back")
_OPTIONAL_INPUTS = ("mask",)
_OUTPUTS = ("front", "back")
_OPTIONAL_OUTPUTS = ("front_error", "back_error")
#: Three times 32: a network that halves more often than five times fails on it.
_TRIAL_PX = 96
#: No network is asked for a larger picture.
_LARGEST_PX = 4096


class OnnxNormals:
    """Runs the network with onnxruntime on all cores of the processor.

    Attributes:
        part: The network, as records name it.
        training_set: What it was trained on, as it says itself; empty if it does not.
        side_px: Side of the square that it asks for, pixels; 0 if it takes any.

    Raises:
        MissingPart: onnxruntime is not installed.
        DataError: not an ONNX file, other inputs and outputs, or metadata that are not right.
    """

    def __init__(self, path: Path) -> None:
        # Before it is opened: what it names as its weights is then known to lie beside it.
        sha256 = network_sha256(path)
        self._session = open_session(path)
        self._inputs = tuple(node.name for node in self._session.get_inputs())
        outputs = [node.name for node in self._session.get_outputs()]
        _require(path, "inputs", set(self._inputs) - set(_OPTIONAL_INPUTS), _INPUTS)
        _require(path, "outputs", set(outputs) - set(_OPTIONAL_OUTPUTS), _OUTPUTS)
        about = self._session.get_modelmeta().custom_metadata_map
        if not (about.get("name") and about.get("licence")):
            raise DataError(
                f"{path} does not say what it is",
                expected="metadata 'name' and 'licence'",
                got=", ".join(sorted(about)) or "no metadata",
            )
        self._says_errors = set(outputs) >= set(_OPTIONAL_OUTPUTS)
        self._background = _background(path, about)
        self._around_mask = _around_mask(path, about)
        self.side_px = _side(path, about)
        self.training_set: str = about.get("training_set", "")
        self.part = Part("normal estimator", about["name"], about["licence"], sha256)

    def __call__(
        self, rgb: Floats, mask: Floats, body_front: Floats, body_back: Floats
    ) -> EstimatedNormals:
        """Clothed unit normals, 0 outside the mask; see ``NormalEstimator``.

        A pixel where the network answers with zero has no normal and stays 0.

        Raises:
            MethodError: the network cannot work on a picture of this size.
        """
        inside = mask >= 0.5
        if not inside.any():
            return EstimatedNormals(np.zeros_like(body_front), np.zeros_like(body_back))
        size = (mask.shape[1], mask.shape[0])
        window = mask_window(inside) if self._around_mask else whole_window(size)
        maps = {
            "image": window.cut((2.0 * rgb - 1.0) * inside[..., None]),
            "body_front": window.cut(self._body(body_front), self._background),
            "body_back": window.cut(self._body(body_back), self._background),
            "mask": window.cut(inside[..., None].astype(np.float64)),
        }
        answers = self._answers(maps, window)
        front, back = (
            unit_normals(window.put_back(answers[name], size)) * inside[..., None]
            for name in _OUTPUTS
        )
        if not self._says_errors:
            return EstimatedNormals(front, back)
        front_deg, back_deg = (
            np.where(inside, np.degrees(window.put_back(answers[name], size)[..., 0]), 0.0)
            for name in _OPTIONAL_OUTPUTS
        )
        return EstimatedNormals(front, back, front_deg, back_deg)

    def trial(self) -> None:
        """Let the network work on a small picture with a subject on it.

        Raises:
            DataError: it cannot, or answers with what is no map of normals.
        """
        height, width = self._fixed_size()
        mask = np.zeros((height, width))
        mask[height // 4 : -height // 4, width // 4 : -width // 4] = 1.0
        body = np.zeros((height, width, 3))
        body[mask > 0] = (0.0, 0.0, 1.0)
        try:
            answers = self(np.full((height, width, 3), 0.5), mask, body, -body)
        except MethodError as error:
            raise DataError(error.what, expected=error.expected, got=error.got) from error
        if not (np.isfinite(answers.front).all() and np.isfinite(answers.back).all()):
            raise DataError(f"{self.part.name} answers with numbers that are not finite")

    def _fixed_size(self) -> tuple[int, int]:
        """The only size that the network works on, or else a small one."""
        shape = self._session.get_inputs()[self._inputs.index("image")].shape
        sides = [side if isinstance(side, int) else _TRIAL_PX for side in shape[2:]]
        return (sides[0], sides[1]) if len(sides) == 2 else (_TRIAL_PX, _TRIAL_PX)

    def _body(self, normals: Floats) -> Floats:
        there = np.abs(normals).sum(axis=2, keepdims=True) > 0
        return np.where(there, normals, self._background)

    def _answers(self, maps: Mapping[str, Floats], window: Window) -> dict[str, Floats]:
        """All outputs (h, w, channels) on the window's pixels, by name."""
        feeds = {name: _batch(maps[name]) for name in self._inputs}
        names = (*_OUTPUTS, *(_OPTIONAL_OUTPUTS if self._says_errors else ()))
        try:
            found = self._session.run(list(names), feeds)
        except Exception as error:  # onnxruntime has no public base of its errors
            raise MethodError(
                f"{self.part.name} cannot work on {window.width} x {window.height} pixels",
                got=str(error),
            ) from error
        answers = dict(zip(names, found, strict=True))
        for name, answer in answers.items():
            channels = 3 if name in _OUTPUTS else 1
            shape = (1, channels, window.height, window.width)
            if answer.shape != shape:
                raise MethodError(
                    f"{self.part.name} made another picture of '{name}' than it was given",
                    expected=str(shape),
                    got=str(answer.shape),
                )
        return {
            name: np.moveaxis(answer[0].astype(np.float64), 0, -1)
            for name, answer in answers.items()
        }


def _require(path: Path, what: str, names: set[str], wanted: tuple[str, ...]) -> None:
    if names != set(wanted):
        raise DataError(
            f"{path} has other {what} than a normal estimator",
            expected=", ".join(wanted),
            got=", ".join(sorted(names)),
        )


def _background(path: Path, about: Mapping[str, str]) -> float:
    text = about.get("body_background", "0")
    try:
        return float(text)
    except ValueError as error:
        raise DataError(
            f"{path} has metadata that are not right", expected="a number", got=text
        ) from error


def _around_mask(path: Path, about: Mapping[str, str]) -> bool:
    window = about.get("window", "")
    if window not in ("", "mask"):
        raise DataError(
            f"{path} wants a window that is not known", expected="window 'mask' or none", got=window
        )
    return window == "mask"


def _side(path: Path, about: Mapping[str, str]) -> int:
    text = about.get("side_px", "0")
    if not text.isdecimal() or int(text) > _LARGEST_PX:
        raise DataError(
            f"{path} has metadata that are not right",
            expected=f"a side of the picture, up to {_LARGEST_PX} pixels",
            got=text,
        )
    return int(text)


def _batch(array: Floats) -> NDArray[np.float32]:
    return np.moveaxis(array, -1, 0)[None].astype(np.float32)

"""ECON's normal networks as they were published: a picture of 512 x 512 pixels for both sides.

Both see the front photo, in [-1, 1] and 0 outside the subject. Each sees the body's normals of its
own side in the frame of the maps, with a grey of 128 where there is no body; it answers with a
vector of any length in [-1, 1]. Source: Xiu et al., "ECON", CVPR 2023, and its public code.
"""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats
from harness.core.errors import MethodError
from harness.core.protocols import EstimatedNormals, Part
from harness.geometry.images import resampled, unit_normals
from methods.parts.converted import ECON_NORMALS, FILES
from methods.parts.onnx_networks import answers, open_session

#: The size that the networks were trained at; the subject fills 0.9 of it.
SIDE_PX = 512
#: 128 of 255 is not the middle between black and white.
BACKGROUND = 2.0 * 128 / 255 - 1.0


def econ_part() -> Part:
    """The imported networks, as records name them.

    Raises:
        MissingPart: they are not imported, or a file is gone.
        DataError: a file is another one.
    """
    return ECON_NORMALS.find().installed.part(ECON_NORMALS.about.role)


def econ_normals() -> EconNormals:
    """The imported networks, loaded once; errors are those of ``econ_part``."""
    stored = ECON_NORMALS.find()
    return _loaded(stored.installed.path, stored.installed.sha256)


class EconNormals:
    """Estimates clothed normals of both sides; see ``NormalEstimator``.

    Args:
        folder: Where the networks' files are.
    """

    def __init__(self, folder: Path) -> None:
        self._front, self._back = (open_session(folder / file, gpu=True) for file in FILES.values())

    def __call__(
        self, rgb: Floats, mask: Floats, body_front: Floats, body_back: Floats
    ) -> EstimatedNormals:
        """Clothed unit normals (H, W, 3) on the same pixels, 0 outside the mask.

        A picture of another size than 512 is resampled to that size, and the answer back.

        Raises:
            MethodError: a picture that is not square.
        """
        height, width = mask.shape
        if height != width:
            raise MethodError(
                "ECON's networks work on square pictures", got=f"{width} x {height} pixels"
            )
        inside = mask >= 0.5
        photo = (2.0 * _sized(rgb, SIDE_PX) - 1.0) * (_sized(mask, SIDE_PX) >= 0.5)[..., None]
        front, back = (
            unit_normals(_sized(_answer(session, photo, body), width)) * inside[..., None]
            for session, body in ((self._front, body_front), (self._back, body_back))
        )
        return EstimatedNormals(front, back)


@functools.lru_cache(maxsize=1)
def _loaded(folder: Path, _sha256: str) -> EconNormals:
    return EconNormals(folder)


def _answer(session: object, photo: Floats, body: Floats) -> Floats:
    """(512, 512, 3) unit normals of one side."""
    there = (np.linalg.norm(body, axis=2) > 0).astype(np.float64)
    rendered = unit_normals(_sized(body, SIDE_PX))
    shown = np.where((_sized(there, SIDE_PX) >= 0.5)[..., None], rendered, BACKGROUND)
    feeds = {"image": _batch(photo), "body": _batch(shown)}
    (normals,) = answers(session, "ECON's normal network", feeds)
    return unit_normals(np.moveaxis(normals[0].astype(np.float64), 0, -1))


def _sized(image: Floats, side: int) -> Floats:
    """A square picture with another side; the very same where it has it."""
    return image if len(image) == side else resampled(image, (side, side), "bilinear")


def _batch(image: Floats) -> NDArray[np.float32]:
    return np.moveaxis(image, -1, 0)[None].astype(np.float32)

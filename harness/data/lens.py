"""What a lens does to a picture beyond a pinhole, and how that is undone.

The models are those of OpenCV and COLMAP: polynomials of the distance to the axis, either of its
tangent (ordinary lenses) or of its angle (fisheyes), and a tangential part.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from harness.core.arrays import Floats, Mask
from harness.core.camera import Camera
from harness.core.errors import DataError

#: Distances to the axis at which the polynomial is looked at for where it folds back.
_STEPS = 2000


@dataclass(frozen=True, slots=True)
class Lens:
    """The distortion of a lens; all zero is a pinhole.

    A point at distance r from the axis (tangent of its angle) is seen at
    r (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6); with a fisheye, at
    t (1 + k1 t^2 + k2 t^4 + k3 t^6 + k4 t^8), where t is the angle itself.

    Attributes:
        k: The six radial numbers k1 to k6.
        p: The two tangential ones, p1 and p2.
        fisheye: Whether the polynomial is of the angle.
    """

    k: tuple[float, float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    p: tuple[float, float] = (0.0, 0.0)
    fisheye: bool = False

    def __post_init__(self) -> None:
        if not np.isfinite([*self.k, *self.p]).all():
            raise DataError("a lens is not of finite numbers", got=f"k {self.k}, p {self.p}")

    @classmethod
    def of(
        cls, radial: tuple[float, ...], tangential: tuple[float, ...] = (), *, fisheye: bool = False
    ) -> Lens:
        """The lens of the first few radial numbers, and two tangential ones or none."""
        k1, k2, k3, k4, k5, k6 = (*radial, *([0.0] * (6 - len(radial))))
        p1, p2 = tangential or (0.0, 0.0)
        return cls((k1, k2, k3, k4, k5, k6), (p1, p2), fisheye)

    @property
    def bends(self) -> bool:
        """Whether pictures differ from those of a pinhole."""
        return self.fisheye or any(self.k) or any(self.p)

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values."""
        return asdict(self)

    def distorted(self, points: Floats) -> Floats:
        """(N, 2) where the lens puts points (N, 2), both at depth 1 in camera axes."""
        x, y = points.T
        radius = np.hypot(x, y)
        share = self._share(radius)
        r2 = radius**2
        p1, p2 = self.p
        return np.stack(
            [
                x * share + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
                y * share + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
            ],
            axis=1,
        )

    def sees(self, points: Floats) -> Mask:
        """(N,) which points (N, 2) are nearer to the axis than where the polynomial folds back."""
        return np.hypot(*points.T) < self._fold(float(np.hypot(*points.T).max(initial=1.0)))

    def _share(self, radius: Floats) -> Floats:
        """(N,) by what a distance to the axis is multiplied."""
        k1, k2, k3, k4, k5, k6 = self.k
        if self.fisheye:
            angle = np.arctan(radius)
            a2 = angle**2
            bent = angle * (1 + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4))))
            return np.where(radius > 1e-9, bent / np.maximum(radius, 1e-9), 1.0)
        r2 = radius**2
        above = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        return above / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))

    def _fold(self, furthest: float) -> float:
        """The distance to the axis beyond which larger ones are seen nearer again."""
        radius = np.linspace(0.0, 1.05 * furthest, _STEPS)
        falls = np.diff(radius * self._share(radius)) <= 0
        return float(radius[int(np.argmax(falls))]) if falls.any() else float("inf")


def undistortion_map(camera: Camera, lens: Lens) -> tuple[Floats, Mask]:
    """Where each pixel of the pinhole's picture is found in the picture that the lens made.

    Args:
        camera: The pinhole, with the size of both pictures.
        lens: What bends the picture.

    Returns:
        (H, W, 2) pixel coordinates x, y, and (H, W) whether the lens shows that direction at all.
    """
    pixels = camera.pixel_centres().reshape(-1, 2)
    focal, middle = camera.K[[0, 1], [0, 1]], camera.K[:2, 2]
    points = (pixels - middle) / focal
    found = lens.distorted(points) * focal + middle
    shape = (camera.height, camera.width)
    return found.reshape(*shape, 2), lens.sees(points).reshape(shape)


@dataclass(frozen=True, slots=True, eq=False)
class ForeignView:
    """One photo's camera as its file has it.

    Attributes:
        image: The photo's name in the file; empty where the file names none.
        camera: The pinhole, in the file's own world axes and unit of length.
        lens: What the lens adds to it.
        mask: The mask's name in the file; empty where it names none.
    """

    image: str
    camera: Camera
    lens: Lens = field(default_factory=Lens)
    mask: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class ForeignCameras:
    """The cameras in a file of another program.

    Attributes:
        path: The file or folder.
        layout: What it is: ``nerfstudio``, ``COLMAP text``, ``COLMAP binary``, ``published`` or
            ``capture``.
        views: In the order of the file.
        in_world: Whether the file's world is ours: metres, +Y up. That is so for our own captures.
        front_yaw_deg: Where the subject faces, for a file of which the world is ours.
    """

    path: Path
    layout: str
    views: tuple[ForeignView, ...]
    in_world: bool = False
    front_yaw_deg: float = 0.0

    @property
    def is_named(self) -> bool:
        """Whether the file says which photo each camera took."""
        return all(view.image for view in self.views)

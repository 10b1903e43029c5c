"""``oracle8-points``: the scan's own depth in eight views, aligned, filtered and meshed as others'.

The ceiling of the family of points, and the self-test of what its methods share. Its surface is
held to the silhouettes: on avatars, bulges that no view's depth sees, such as under the soles, are
most of what plain Poisson reconstruction loses.

Before: ``renderers/blender/scene.py``. After: ``metrics/distance.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field

import numpy as np

from harness.core.arrays import Floats
from harness.core.artifacts import Capture
from harness.core.camera import Camera
from harness.core.errors import MethodError
from harness.core.files.hashing import derive_seed
from harness.core.protocols import Context, MethodInfo, Privilege
from harness.core.results import DepthMaps, PhotoFrame, ViewDepth
from harness.core.settings import check_range, configured, rooms_of
from harness.geometry.raycast import Raycaster
from harness.geometry.similarity import Similarity
from methods.points.filtering import MeshSettings, SurfaceRooms

#: The own world's unit in metres is between 1 / this and this.
_LARGEST_UNIT = 5.0


@dataclass(frozen=True, slots=True)
class DepthSettings:
    """The depth maps.

    Attributes:
        longest_px: Longest side of the depth maps, pixels; photos are never enlarged.
        noise: Standard deviation of the depth's error, as a share of the depth: 0.01 is 3 cm at
            3 m.
        noise_px: Over which length the error is smooth, pixels; 0 makes each pixel's its own.
    """

    longest_px: int = 960
    noise: float = 0.0
    noise_px: float = 0.0

    def __post_init__(self) -> None:
        for name, least, most in (
            ("longest_px", 16, 8192),
            ("noise", 0.0, 0.5),
            ("noise_px", 0.0, 500.0),
        ):
            check_range(name, getattr(self, name), least, most)


@dataclass(frozen=True, slots=True)
class OracleRooms(SurfaceRooms):
    """All settings, by room: the surface's, and the depth maps' own."""

    mesh: MeshSettings = field(default_factory=lambda: MeshSettings(silhouettes="held"))
    depth: DepthSettings = field(default_factory=DepthSettings)


@dataclass(frozen=True, slots=True)
class RenderedDepth:
    """Depth of the scan in the photos' own cameras, noisy where that is set.

    Attributes:
        views: Counted from the front.
        rooms: Settings.
    """

    views: tuple[int, ...] = tuple(range(8))
    rooms: OracleRooms = field(default_factory=OracleRooms)

    @property
    def info(self) -> MethodInfo:
        """What the method says of itself."""
        rooms = self.rooms
        noise = f" with {rooms.depth.noise:.1%} noise" if rooms.depth.noise else ""
        return MethodInfo(
            name="oracle8-points",
            title=f"Depth of the scan{noise}, {len(self.views)} views, {rooms.align.mode}",
            views=self.views,
            privileges=(
                Privilege.KNOWN_CAMERAS,
                Privilege.EXACT_MASKS,
                Privilege.GROUND_TRUTH_MESH,
            ),
            parameters={name: asdict(room) for name, room in rooms_of(rooms).items()},
        )

    def configured(self, parameters: Mapping[str, str]) -> RenderedDepth:
        """The method with other settings, given as text by ``room.setting``."""
        changed = OracleRooms(**configured(rooms_of(self.rooms), parameters))
        return RenderedDepth(self.views, changed)

    def reconstruct(self, capture: Capture, context: Context) -> DepthMaps:
        """The scan's depth, in a world of its own unless its cameras are to be the known ones.

        Raises:
            MethodError: the scan was not lent.
        """
        truth = context.privileged.get(Privilege.GROUND_TRUTH_MESH)
        if truth is None:
            raise MethodError(
                "the scan was not lent", expected="the privilege 'ground truth mesh'", got="nothing"
            )
        rng = np.random.default_rng(derive_seed(context.seed, "world"))
        keeps = self.rooms.align.mode == "native_posed"
        own = Similarity(1.0, np.eye(3), np.zeros(3)) if keeps else _somewhere(rng)
        caster = Raycaster(truth)
        views: list[ViewDepth] = []
        with context.stage("estimate"):
            for view in self.views:
                photo = capture.cameras[view]
                frame = self._frame(photo)
                camera = frame.camera(photo)
                noise = np.random.default_rng(derive_seed(context.seed, "noise", str(view)))
                depth = self._noisy(caster.depth(camera), noise)
                views.append(ViewDepth(frame, own.camera(camera), own.scale * depth))
        return DepthMaps(tuple(views), {"noise": self.rooms.depth.noise})

    def _frame(self, camera: Camera) -> PhotoFrame:
        share = min(1.0, self.rooms.depth.longest_px / max(camera.size))
        width, height = (max(1, round(share * side)) for side in camera.size)
        return PhotoFrame.whole(camera.size, (width, height))

    def _noisy(self, depth: Floats, rng: np.random.Generator) -> Floats:
        if self.rooms.depth.noise == 0:
            return depth
        errors = rng.standard_normal(depth.shape)
        if self.rooms.depth.noise_px > 0:
            from scipy.ndimage import gaussian_filter

            errors = np.asarray(gaussian_filter(errors, self.rooms.depth.noise_px, mode="wrap"))
            errors /= errors.std()
        return depth * (1.0 + self.rooms.depth.noise * errors)


def _somewhere(rng: np.random.Generator) -> Similarity:
    """From the world to one of its own: any turn, any place, and another unit."""
    turn, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    scale = float(np.exp(rng.uniform(-1, 1) * np.log(_LARGEST_UNIT)))
    return Similarity(scale, turn, rng.uniform(-1.0, 1.0, 3))


oracle8_points = RenderedDepth()

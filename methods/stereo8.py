"""``stereo8``: what eight calibrated photos show, without any normals.

A surface between the visual hull and a fitted body in its clothes is pulled to the points that
neighbouring photos agree on, and finished by a short search in full resolution. No network sees a
photo except the one that marks landmarks for the body.

Before: ``renderers/blender/scene.py``. After: ``metrics/distance.py``.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field

from harness.core.artifacts import Capture, Reconstruction
from harness.core.errors import HarnessError
from harness.core.mesh import Mesh
from harness.core.protocols import Context, MethodInfo
from harness.core.settings import check_choice, configured, rooms_of
from harness.files.mesh_files import save_mesh
from methods.body.settings import JMBO_PLUS, BodyFitResult, FitSettings
from methods.body_fit import BodyFit
from methods.nview.start import clothed, start_surface
from methods.nview.views import checked_views, outline_views
from methods.photo_pull.pulled import StereoTask, hands_of, pulled_to_photos, stereo_parameters
from methods.stereo.settings import KeepRules, MatchSettings, NarrowSettings, StereoSettings


@dataclass(frozen=True, slots=True)
class StartSettings:
    """What the surface starts from, and which steps follow.

    Attributes:
        voxel_m: Edge of the start surface's mesh, metres.
        margin_m: How far the hull may stand off the body in its clothes, metres.
        narrow: ``on``, or ``off`` to end after the points.
    """

    voxel_m: float = 0.006
    margin_m: float = 0.02
    narrow: str = "on"

    def __post_init__(self) -> None:
        check_choice("narrow", self.narrow, ("on", "off"))
        if not 0.002 <= self.voxel_m <= 0.05:
            raise HarnessError(
                f"setting 'voxel_m' cannot be '{self.voxel_m}'", expected="0.002 to 0.05 metres"
            )


@dataclass(frozen=True, slots=True)
class _Rooms:
    """All settings of the method, by room."""

    body: FitSettings = JMBO_PLUS
    start: StartSettings = field(default_factory=StartSettings)
    match: MatchSettings = field(default_factory=MatchSettings)
    keep: KeepRules = field(default_factory=KeepRules)
    narrow: NarrowSettings = field(default_factory=NarrowSettings)


@dataclass(frozen=True, slots=True, eq=False)
class StereoBegun:
    """What photo-consistency starts from.

    Attributes:
        views: Indices of the photos.
        fitted: The body.
        start: The surface between hull and body, world metres.
    """

    views: Sequence[int]
    fitted: BodyFitResult
    start: Mesh


class Stereo8:
    """Hull and body, pulled by what neighbouring photos agree on."""

    def __init__(self, rooms: _Rooms | None = None) -> None:
        self._rooms = rooms or _Rooms()
        views = tuple(range(8))
        self._fit = BodyFit("stereo8-body", "JMBO+, 8 views", views, self._rooms.body)

    @functools.cached_property
    def info(self) -> MethodInfo:
        """What the method says of itself."""
        rooms, fit = self._rooms, self._fit.info
        return MethodInfo(
            name="stereo8",
            title="Photo-consistency, 8 views",
            views=fit.views,
            parts=fit.parts,
            privileges=fit.privileges,
            parameters={
                "body": rooms.body.in_use(len(self._fit.views)),
                "start": asdict(rooms.start),
                **stereo_parameters(self.settings()),
            },
        )

    def configured(self, parameters: Mapping[str, str]) -> Stereo8:
        """The method with other settings, given as text by ``room.setting``."""
        return Stereo8(_Rooms(**configured(rooms_of(self._rooms), parameters)))

    def reconstruct(self, capture: Capture, context: Context) -> Reconstruction:
        """The clothed mesh and the body within it, world metres.

        Raises:
            MethodError: no person found, or silhouettes that contradict each other.
            MissingPart: the body model or MediaPipe is not installed.
        """
        begun = self.begun(capture, context)
        narrow = self._rooms.start.narrow == "on"
        hands = hands_of(begun.fitted)
        task = StereoTask(begun.views, hands, self.settings(), narrow, is_shared=True)
        pulled = pulled_to_photos(begun.start, capture, task, context)
        if context.keep:
            save_mesh(context.workdir / "start.ply", begun.start)
            save_mesh(context.workdir / "pulled.ply", pulled.before_narrow)
        details = {**begun.fitted.details(), **pulled.details()}
        return Reconstruction(mesh=pulled.mesh, body=begun.fitted.body, details=details)

    def begun(self, capture: Capture, context: Context) -> StereoBegun:
        """The body, and the surface around which photos are compared.

        Raises:
            MethodError: no person found, or silhouettes that contradict each other.
            MissingPart: the body model or MediaPipe is not installed.
        """
        indices = [view for view in self._fit.views if view < len(capture.cameras)]
        fitted = self._fit.fit(capture, context)
        with context.stage("start"):
            start = self._start(capture, indices, fitted.skin)
        return StereoBegun(indices, fitted, start)

    def settings(self) -> StereoSettings:
        """How photos are compared."""
        rooms = self._rooms
        return StereoSettings(match=rooms.match, keep=rooms.keep, narrow=rooms.narrow)

    def _start(self, capture: Capture, indices: Sequence[int], skin: Mesh) -> Mesh:
        views = checked_views(outline_views(capture, indices))
        own = self._rooms.start
        return start_surface(views, own.voxel_m, clothed(skin, views), own.margin_m)


stereo8 = Stereo8()

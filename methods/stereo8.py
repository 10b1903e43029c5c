"""``stereo8``: what eight calibrated photos show, without any normals.

A surface between the visual hull and a fitted body in its clothes is pulled to the points that
neighbouring photos agree on, and finished by a short search in full resolution. No network sees a
photo except the one that marks landmarks for the body.

Before: ``renderers/blender/scene.py``. After: ``metrics/distance.py``.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from typing import TYPE_CHECKING

import numpy as np

from harness.core.arrays import Floats
from harness.core.artifacts import Capture, Reconstruction
from harness.core.errors import HarnessError
from harness.core.formats.mesh_files import save_mesh
from harness.core.mesh import Mesh
from harness.core.protocols import Context, MethodInfo
from harness.core.settings import by_room, check_choice, overridden
from harness.geometry.photo import open_photo
from methods.body.result import BodyFitResult
from methods.body_fit import BodyFit
from methods.fit_settings import JMBO_PLUS, FitSettings
from methods.nview.lattices import remeshed
from methods.nview.start import clothed, start_surface
from methods.nview.views import FusionView, checked_views, fusion_view
from methods.stereo.settings import KeepRules, MatchSettings, NarrowSettings, StereoSettings

if TYPE_CHECKING:
    from methods.stereo.consistency import StereoPoints
    from methods.stereo.pull import RoundReport

__all__ = ["StartSettings", "Stereo8", "stereo8"]


@dataclass(frozen=True, slots=True)
class StartSettings:
    """What the surface starts from, and which steps follow.

    Attributes:
        voxel_m: Edge of the start surface's mesh, metres.
        margin_m: How far the hull may stand off the body in its clothes, metres.
        hands_m: Points so near to the fitted body's hands do not count, metres: fingers are thinner
            than a window, and points on them are off by 6 to 9 mm in one case of ten.
        narrow: ``on``, or ``off`` to end after the points.
    """

    voxel_m: float = 0.006
    margin_m: float = 0.02
    hands_m: float = 0.03
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
        own = {name: asdict(getattr(rooms, name)) for name in ("start", "match", "keep", "narrow")}
        rounds = {
            f"round_{number}": asdict(each)
            for number, each in enumerate(StereoSettings().pulls, start=1)
        }
        return MethodInfo(
            name="stereo8",
            title="Photo-consistency, 8 views",
            views=fit.views,
            parts=fit.parts,
            privileges=fit.privileges,
            parameters={"body": rooms.body.in_use(len(self._fit.views)), **own, "pulls": rounds},
        )

    def configured(self, parameters: Mapping[str, str]) -> Stereo8:
        """The method with other settings, given as text by ``room.setting``."""
        rooms = {each.name: getattr(self._rooms, each.name) for each in fields(_Rooms)}
        names = {name: [each.name for each in fields(room)] for name, room in rooms.items()}
        own = by_room(parameters, names)
        return Stereo8(_Rooms(**{name: overridden(rooms[name], own[name]) for name in rooms}))

    def reconstruct(self, capture: Capture, context: Context) -> Reconstruction:
        """The clothed mesh and the body within it, world metres.

        Raises:
            MethodError: no person found, or silhouettes that contradict each other.
            MissingPart: the body model or MediaPipe is not installed.
        """
        # Not at the top: Warp takes a second to start, and the method is listed without it.
        from methods.stereo.pull import pull
        from methods.stereo.surface import finished, stereo_points
        from methods.stereo.views import stereo_view

        settings = self._settings()
        indices = [view for view in self._fit.views if view < len(capture.cameras)]
        fitted = self._fit.fit(capture, context)
        with context.stage("start"):
            start = self._start(capture, indices, fitted.skin)
        with context.stage("points"):
            views = [
                stereo_view(capture.cameras[view], open_photo(capture, view).rgba)
                for view in indices
            ]
            points = stereo_points(views, start, settings)
            points = points.chosen(self._away_from_hands(points, fitted))
        with context.stage("pull"):
            pulled = pull(start, points, settings.pulls, remeshed)
        mesh, rounds = pulled.mesh, list(pulled.rounds)
        if self._rooms.start.narrow == "on":
            with context.stage("narrow"):
                finish = finished(mesh, views, settings)
                mesh = finish.mesh
                rounds += finish.rounds
        if context.keep:
            save_mesh(context.workdir / "start.ply", start)
            save_mesh(context.workdir / "pulled.ply", pulled.mesh)
        details = {**fitted.details(), **_details(points, rounds)}
        return Reconstruction(mesh=mesh, body=fitted.body, details=details)

    def _settings(self) -> StereoSettings:
        rooms = self._rooms
        return StereoSettings(match=rooms.match, keep=rooms.keep, narrow=rooms.narrow)

    def _start(self, capture: Capture, indices: Sequence[int], skin: Mesh) -> Mesh:
        views = checked_views([_outline(capture, view) for view in indices])
        own = self._rooms.start
        return start_surface(views, own.voxel_m, clothed(skin, views), own.margin_m)

    def _away_from_hands(self, points: StereoPoints, fitted: BodyFitResult) -> np.ndarray:
        """(N,) whether points are not on the fitted body's hands."""
        hands = fitted.body.vertices[fitted.regions["left_hand"] | fitted.regions["right_hand"]]
        return _distance_m(points.positions, hands) > self._rooms.start.hands_m


def _outline(capture: Capture, view: int) -> FusionView:
    camera = capture.cameras[view]
    return fusion_view(view, camera, open_photo(capture, view).coverage)


def _distance_m(points: Floats, others: Floats) -> Floats:
    """(N,) distance of points to the nearest of others."""
    from scipy.spatial import KDTree

    if len(points) == 0 or len(others) == 0:
        return np.full(len(points), np.inf)
    return np.asarray(KDTree(others).query(points)[0])


def _details(points: StereoPoints, rounds: Sequence[RoundReport]) -> dict[str, object]:
    """What a reader of the record should know."""
    return {
        "points": len(points),
        "rounds": [
            {
                "vertices_share": round(each.vertices, 3),
                "believed_share": round(each.believed, 3),
                "error_mm": round(1e3 * each.error_m, 3) if np.isfinite(each.error_m) else None,
                "moved_mm": round(1e3 * each.moved_m, 3),
            }
            for each in rounds
        ],
    }


stereo8 = Stereo8()

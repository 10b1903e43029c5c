"""``mexecon+``: one closed surface from the normals and outlines of all calibrated views.

The paper fits its body to all views and then makes its surface from two of them, and names fusion
of all as future work. This is ours: a body fitted as ``jmbo8+``, normals of both sides' network in
every view, and a surface that starts near the clothed body and is moved, round by round, to all
normal maps and all outlines at once. It ends where neighbouring photos agree that it is, as far as
they do.

Before: ``renderers/blender/scene.py``. After: ``metrics/distance.py``.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace

import numpy as np

from harness.core.arrays import Floats
from harness.core.artifacts import Body, Capture, NormalMaps, Reconstruction
from harness.core.camera_frames import OPENCV_TO_BLENDER_CAMERA
from harness.core.mesh import Mesh
from harness.core.process.threads import give_freed_memory_back
from harness.core.protocols import Context, MethodInfo, Privilege, even_places
from harness.core.settings import configured, rooms_of
from harness.files.mesh_files import save_mesh
from harness.geometry.images import save_png
from harness.geometry.raycast import Raycaster
from harness.geometry.solving import SOLVED
from methods.body.models.choice import forget_body_models
from methods.body.settings import JMBO_PLUS, FitSettings
from methods.body_fit import BodyFit
from methods.normals import ViewMaps, view_maps, working_view
from methods.normals.result_maps import result_maps
from methods.nview.fusion import Fused, finished_surface, fused_surface, settled
from methods.nview.settings import FusionSettings
from methods.nview.start import clothed, silhouette_fit, start_surface
from methods.nview.system import trust
from methods.nview.views import (
    MOST_VIEWS,
    FusionView,
    NormalTargets,
    checked_views,
    even_choice,
    outline_views,
)
from methods.photo_pull.pulled import (
    PulledSurface,
    StereoTask,
    hands_of,
    pulled_to_photos,
    stereo_parameters,
)
from methods.stages import Stages, contact_sheet
from methods.stereo.settings import (
    DentSettings,
    KeepRules,
    MatchSettings,
    NarrowSettings,
    StereoSettings,
    near_settings,
)


@dataclass(frozen=True, slots=True)
class FusedRooms:
    """All settings of the method, by room.

    Attributes:
        body: How the body is fitted.
        nview: How normals are estimated and the surface is made of them.
        match: How photos are matched around that surface, which is as often inside as outside.
        keep: Which points of it are kept.
        narrow: The search that finishes.
        dents: Which hollows of that surface photos are asked about.
    """

    body: FitSettings = JMBO_PLUS
    nview: FusionSettings = field(default_factory=FusionSettings)
    match: MatchSettings = field(default_factory=lambda: near_settings().match)
    keep: KeepRules = field(default_factory=KeepRules)
    narrow: NarrowSettings = field(default_factory=NarrowSettings)
    dents: DentSettings = field(default_factory=DentSettings)

    @property
    def stereo(self) -> StereoSettings:
        """Those of photo-consistency."""
        near = near_settings()
        return replace(near, match=self.match, keep=self.keep, narrow=self.narrow, dents=self.dents)


#: Where a silhouette loses more than this share between start and end, a limb came off: a forearm
#: is 2 to 4 % of a view. Fused surfaces of training subjects lose 0.3 to 0.8 %.
_LOST_LIMB = 0.02
#: Size of the pixels on which that is seen, in steps of the lattice, and of the record's, metres.
_LOST_PIXEL_STEPS, _SILHOUETTE_PIXEL_M = 0.56, 0.002


@dataclass(frozen=True, slots=True, eq=False)
class _Person:
    """What is known of the subject before its surface is.

    Attributes:
        shape: What the estimator is shown: the fitted body, or the visual hull.
        body: The fitted body, if one was.
        hands: (N, 3) vertices of the fitted body's hands, world metres.
        details: Details of the fit, for the record.
    """

    shape: Mesh
    body: Body | None
    hands: Floats
    details: Mapping[str, object]


class FusedMethod:
    """Fuses all views of a capture into one surface.

    Args:
        names: Its name on the command line and its title in tables.
        rooms: Its settings.
    """

    def __init__(self, names: tuple[str, str], rooms: FusedRooms | None = None) -> None:
        self._rooms = rooms or FusedRooms()
        self.settings = self._rooms.nview
        self._names = names
        views = tuple(range(MOST_VIEWS))
        self._fit = BodyFit(f"{names[0]}-body", "JMBO+, all views", views, self._rooms.body)

    @functools.cached_property
    def info(self) -> MethodInfo:
        """What the method says of itself.

        Raises:
            MissingPart, DataError: as ``NormalChoice.part``.
        """
        choice, fits = self.settings.normal_choice, self.settings.body == "on"
        own = {**asdict(self.settings), "normals_model": bool(self.settings.normals_model)}
        body = {"body": self._fit.settings.in_use(MOST_VIEWS)} if fits else {}
        privileges = (
            Privilege.KNOWN_CAMERAS,
            Privilege.EXACT_MASKS,
            *(self._fit.info.privileges if fits else ()),
            *(choice.privileges if choice else ()),
        )
        parts = (*(self._fit.info.parts if fits else ()), *((choice.part,) if choice else ()))
        return MethodInfo(
            name=self._names[0],
            title=self._names[1],
            view_count=self.settings.views or None,
            parts=tuple(dict.fromkeys(parts)),
            privileges=tuple(dict.fromkeys(privileges)),
            parameters={
                **body,
                "nview": own,
                **(stereo_parameters(self._rooms.stereo) if self.settings.photos == "on" else {}),
            },
            trained_on=tuple(
                dict.fromkeys(
                    [
                        *(self._fit.info.trained_on if fits else ()),
                        *(choice.trained_on if choice else ()),
                    ]
                )
            ),
        )

    def configured(self, parameters: Mapping[str, str]) -> FusedMethod:
        """The method with other settings, given as text by ``room.setting``.

        ``body=off`` is short for ``nview.body=off``.
        """
        texts = {
            "nview.body" if name == "body" else name: text for name, text in parameters.items()
        }
        return FusedMethod(self._names, FusedRooms(**configured(rooms_of(self._rooms), texts)))

    def require_installed(self) -> None:
        """Nothing, if the body model is there; errors as ``BodyFit.require_installed``."""
        if self.settings.body == "on":
            self._fit.require_installed()

    def reconstruct(self, capture: Capture, context: Context) -> Reconstruction:
        """The clothed mesh, closed and in one piece, and the body within it, world metres.

        Raises:
            MethodError: fewer than 3 views or than the settings ask for, no person found, outlines
                or normals that contradict each other.
            MissingPart: the body model, MediaPipe, or a network is not installed.
        """
        settings = self.settings
        total = len(capture.cameras)
        capture = even_choice(capture, settings.views)
        factorised = SOLVED.factorised
        with context.stage("outlines"):
            outlines = checked_views(outline_views(capture, range(len(capture.cameras))))
        person = self._person(capture, outlines, context)
        with context.stage("normals"):
            views, shown = self._with_normals(capture, outlines, person.shape, context)
        normals: tuple[NormalMaps, ...] = ()
        if person.body:
            # Others count all photos.
            places = even_places(len(capture.cameras), total)
            normals = tuple(replace(result_maps(m), view=places[m.view.index]) for m in shown)
        # What the network worked with would else be held beside the largest surfaces.
        give_freed_memory_back()
        start, fused = self._fused(views, person.shape, context)
        # The maps of normals have done their work, and memory is short from here on.
        views, shown = outlines, shown if context.keep else []
        give_freed_memory_back()
        mesh, details = fused.mesh, {**person.details, "fusion": fused.details()}
        if settings.photos == "on":
            pulled = self._pulled(fused.mesh, capture, person, context)
            with context.stage("finish"):
                mesh = finished_surface(settled(pulled.mesh, views, settings), views, settings)
            details["photos"] = pulled.details()
        details["factorised"] = SOLVED.factorised - factorised
        details["silhouettes"] = silhouette_fit(mesh, views, _SILHOUETTE_PIXEL_M).details()
        if context.keep:
            with context.stage("pictures"):
                _keep(context, shown, person.shape, (start, fused.mesh), mesh)
        return Reconstruction(
            mesh=mesh,
            body=person.body,
            normals=normals,
            details=details,
        )

    def _fused(
        self, views: Sequence[FusionView], shape: Mesh, context: Context
    ) -> tuple[Mesh, Fused]:
        """The surface to start from and the fused one: from the hull if a limb was lost."""
        settings = self.settings
        pixel_m = _LOST_PIXEL_STEPS * settings.voxel_m

        def fused_from(near: Mesh | None) -> tuple[Mesh, Fused, float]:
            with context.stage("start"):
                start = start_surface(views, settings.voxel_m, near, settings.margin_m)
                before = silhouette_fit(start, views, pixel_m)
            with context.stage("rounds"):
                fused = fused_surface(start, views, settings)
                lost = silhouette_fit(fused.mesh, views, pixel_m).lost_since(before)
            return start, fused, lost

        if not settings.starts_at_body:
            return fused_from(None)[:2]
        with context.stage("start"):
            near = clothed(shape, views)
        start, fused, lost = fused_from(near)
        if lost > _LOST_LIMB:
            other_start, other, other_lost = fused_from(None)
            if other_lost < lost:
                return other_start, replace(other, from_hull=True)
        return start, fused

    def _pulled(
        self, mesh: Mesh, capture: Capture, person: _Person, context: Context
    ) -> PulledSurface:
        indices = range(len(capture.cameras))
        task = StereoTask(indices, person.hands, self._rooms.stereo)
        return pulled_to_photos(mesh, capture, task, context)

    def _person(self, capture: Capture, views: Sequence[FusionView], context: Context) -> _Person:
        if self.settings.body == "on":
            fit = self._fit.fit(capture, context)
            # Memory is short when photos are matched, and the body is fitted once.
            forget_body_models()
            return _Person(fit.skin, fit.body, hands_of(fit), fit.details())
        with context.stage("hull"):
            hull = start_surface(views, self.settings.voxel_m, None, self.settings.margin_m)
        return _Person(hull, None, np.zeros((0, 3)), {})

    def _with_normals(
        self, capture: Capture, views: Sequence[FusionView], shape: Mesh, context: Context
    ) -> tuple[list[FusionView], list[ViewMaps]]:
        """The views with their normals, and the maps of the front and the back to be shown."""
        choice = self.settings.normal_choice
        if choice is None:
            return list(views), []
        caster = Raycaster(shape)
        given: list[FusionView] = []
        shown: list[ViewMaps] = []
        for view in views:
            resolution = self.settings.resolution
            picture = working_view(capture, view.index, resolution, choice.side_px)
            estimator = choice.estimator(picture.camera, context.privileged)
            maps = view_maps(picture, caster, estimator)
            given.append(view.with_targets(_targets(maps, self.settings.trusted_deg)))
            # Not of all: memory is not to grow with the number of views.
            if view.index in (0, len(views) // 2):
                shown.append(maps)
        return given, shown


def _targets(maps: ViewMaps, trusted_deg: float) -> NormalTargets:
    camera = maps.view.camera
    to_world = OPENCV_TO_BLENDER_CAMERA[:3, :3] @ camera.rotation
    normals = (maps.front @ to_world).astype(np.float32)
    weights = None
    if maps.front_error_deg is not None and trusted_deg > 0:
        weights = trust(maps.front_error_deg, maps.view.mask, trusted_deg).astype(np.float32)
    return NormalTargets(camera, normals, weights)


def _keep(
    context: Context,
    shown: Sequence[ViewMaps],
    shape: Mesh,
    between: tuple[Mesh, Mesh],
    mesh: Mesh,
) -> None:
    """Write the stages into the workdir; ``between`` are the start and the fused surface."""
    folder = context.workdir
    save_png(folder / "contact_sheet.png", contact_sheet(Stages(shown, between, shape, mesh)))
    for name, each in zip(("body", "start", "fused"), (shape, *between), strict=True):
        save_mesh(folder / f"{name}.ply", each)


mexecon_plus = FusedMethod(("mexecon+", "MExECON+, N views"))

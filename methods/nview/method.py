"""``mexecon+``: one closed surface from the normals and outlines of all calibrated views.

The paper fits its body to all views and then makes its surface from two of them, and names fusion
of all as future work. This is ours: a body fitted as ``jmbo8+``, normals of both sides' network in
every view, and a surface that starts near the clothed body and is moved, round by round, to all
normal maps and all outlines at once.

Before: ``renderers/blender/scene.py``. After: ``metrics/distance.py``.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields

import numpy as np

from harness.core.artifacts import Body, Capture, Reconstruction
from harness.core.cameras.frames import OPENCV_TO_BLENDER_CAMERA
from harness.core.formats.mesh_files import save_mesh
from harness.core.mesh import Mesh
from harness.core.privileges import Privilege
from harness.core.protocols import Context, MethodInfo
from harness.core.settings import by_room, overridden
from harness.geometry.images import save_png
from harness.geometry.photo import open_photo
from harness.geometry.raycast import Raycaster
from methods.body_fit import BodyFit
from methods.fit_settings import JMBO_PLUS, FitSettings
from methods.normals import ViewMaps, view_maps, working_view
from methods.normals.result_maps import result_maps
from methods.nview.fusion import Fused, fused_surface
from methods.nview.settings import FusionSettings
from methods.nview.start import clothed, start_surface
from methods.nview.views import (
    MOST_VIEWS,
    FusionView,
    NormalTargets,
    checked_views,
    fusion_view,
)
from methods.stages import Stages, contact_sheet

__all__ = ["FusedMethod", "mexecon_plus"]


@dataclass(frozen=True, slots=True, eq=False)
class _Person:
    """What is known of the subject before its surface is.

    Attributes:
        shape: What the estimator is shown: the fitted body, or the visual hull.
        body: The fitted body, if one was.
        details: Of the fit, for the record.
    """

    shape: Mesh
    body: Body | None
    details: Mapping[str, object]


class FusedMethod:
    """Fuses all views of a capture into one surface.

    Args:
        names: Its name on the command line and its title in tables.
        fit: How the body is fitted.
        settings: How normals are estimated and the surface is made.
    """

    def __init__(self, names: tuple[str, str], fit: FitSettings, settings: FusionSettings) -> None:
        self.settings = settings
        self._names = names
        self._fit = BodyFit(f"{names[0]}-body", "JMBO+, all views", tuple(range(MOST_VIEWS)), fit)

    @functools.cached_property
    def info(self) -> MethodInfo:
        """What the method says of itself.

        Raises:
            MissingPart, DataError: as ``NormalChoice.part``.
        """
        choice, fits = self.settings.normal_choice, self.settings.body == "on"
        own = {**asdict(self.settings), "normals_model": bool(self.settings.normals_model)}
        body = {"body": self._fit.settings.in_use(MOST_VIEWS)} if fits else {}
        learned = choice is not None and choice.kind == "open"
        privileges = (
            Privilege.KNOWN_CAMERAS,
            Privilege.EXACT_MASKS,
            *(self._fit.info.privileges if fits else ()),
            *((Privilege.GENERATOR_PRIOR,) if learned else ()),
            *(choice.privileges if choice else ()),
        )
        parts = (*(self._fit.info.parts if fits else ()), *((choice.part,) if choice else ()))
        return MethodInfo(
            name=self._names[0],
            title=self._names[1],
            parts=tuple(dict.fromkeys(parts)),
            privileges=tuple(dict.fromkeys(privileges)),
            parameters={**body, "nview": own},
        )

    def configured(self, parameters: Mapping[str, str]) -> FusedMethod:
        """The method with other settings, given as text by ``room.setting``.

        ``body=off`` is short for ``nview.body=off``.
        """
        texts = {
            "nview.body" if name == "body" else name: text for name, text in parameters.items()
        }
        rooms = {"body": FitSettings, "nview": FusionSettings}
        names = {room: [field.name for field in fields(kind)] for room, kind in rooms.items()}
        own = by_room(texts, names)
        return FusedMethod(
            self._names,
            overridden(self._fit.settings, own["body"]),
            overridden(self.settings, own["nview"]),
        )

    def reconstruct(self, capture: Capture, context: Context) -> Reconstruction:
        """The clothed mesh, closed and in one piece, and the body within it, world metres.

        Raises:
            MethodError: fewer than 3 views, no person found, outlines or normals that contradict
                each other.
            MissingPart: the body model, MediaPipe, or a network is not installed.
        """
        settings = self.settings
        with context.stage("outlines"):
            outlines = checked_views(_outline_views(capture))
        person = self._person(capture, outlines, context)
        with context.stage("normals"):
            views, shown = self._with_normals(capture, outlines, person.shape, context)
        with context.stage("start"):
            near = clothed(person.shape, views) if settings.starts_at_body else None
            start = start_surface(views, settings.voxel_m, near, settings.margin_m)
        with context.stage("rounds"):
            fused = fused_surface(start, views, settings)
        if context.keep:
            with context.stage("pictures"):
                _keep(context, shown, person.shape, start, fused.mesh)
        return Reconstruction(
            mesh=fused.mesh,
            body=person.body,
            normals=tuple(map(result_maps, shown)) if person.body else (),
            details={**person.details, **_details(fused)},
        )

    def _person(self, capture: Capture, views: Sequence[FusionView], context: Context) -> _Person:
        if self.settings.body == "on":
            fit = self._fit.fit(capture, context)
            return _Person(fit.skin, fit.body, fit.details())
        with context.stage("hull"):
            hull = start_surface(views, self.settings.voxel_m, None, self.settings.margin_m)
        return _Person(hull, None, {})

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
            picture = working_view(capture, view.index, self.settings.resolution)
            estimator = choice.estimator(picture.camera, context.privileged)
            maps = view_maps(picture, caster, estimator)
            given.append(view.with_targets(_targets(maps)))
            # Not of all: memory is not to grow with the number of views.
            if view.index in (0, len(views) // 2):
                shown.append(maps)
        return given, shown


def _outline_views(capture: Capture) -> list[FusionView]:
    return [
        fusion_view(
            index,
            camera,
            open_photo(capture, index).coverage,
        )
        for index, camera in enumerate(capture.cameras)
    ]


def _targets(maps: ViewMaps) -> NormalTargets:
    camera = maps.view.camera
    to_world = OPENCV_TO_BLENDER_CAMERA[:3, :3] @ camera.rotation
    return NormalTargets(camera, (maps.front @ to_world).astype(np.float32))


def _details(fused: Fused) -> dict[str, object]:
    """What a reader of the record should know of the fusion."""
    return {
        "rounds": len(fused.rounds),
        "angle_to_targets_deg": [round(report.angle_deg, 2) for report in fused.rounds],
        "moved_mm": [round(report.moved_mm, 3) for report in fused.rounds],
        "contradicted_share": [round(report.contradicted, 4) for report in fused.rounds],
        "believed_share": [round(report.believed, 3) for report in fused.rounds],
    }


def _keep(
    context: Context, shown: Sequence[ViewMaps], shape: Mesh, start: Mesh, mesh: Mesh
) -> None:
    """Write the stages into the workdir."""
    folder = context.workdir
    save_png(folder / "contact_sheet.png", contact_sheet(Stages(shown, [start], shape, mesh)))
    save_mesh(folder / "body.ply", shape)
    save_mesh(folder / "start.ply", start)


mexecon_plus = FusedMethod(("mexecon+", "MExECON+, N views"), JMBO_PLUS, FusionSettings())

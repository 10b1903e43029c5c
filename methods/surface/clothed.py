"""The way from views and a fitted body to a clothed mesh, which ``econ`` and ``mexecon`` share.

Fit the body, estimate normals, integrate them to sheets, complete the sheets, fuse. The methods
differ in which views the body is fitted to and which sheets are made of which view's normals.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from typing import cast

import numpy as np
from numpy.typing import NDArray

from harness.core.artifacts import Capture, NormalMaps, Reconstruction
from harness.core.errors import HarnessError
from harness.core.files import atomic_path
from harness.core.mesh import Mesh
from harness.core.mesh_files import save_mesh
from harness.core.protocols import Context, MethodInfo
from harness.core.settings import check_choice, overridden
from harness.geometry.images import load_mask, save_png
from harness.geometry.sides import SidedRaycaster
from methods.body_fit import BodyFit, FitSettings, body_model
from methods.normals import NormalChoice, ViewMaps, view_maps, working_view
from methods.normals.view_maps import filled_normals
from methods.surface.clothed_body import Outline, clothed_body
from methods.surface.completion import BodyCompletion
from methods.surface.front_back import (
    BodyPrior,
    FrontBackDepth,
    FrontBackParameters,
    integrate_front_back,
)
from methods.surface.fusion import FusionParameters, concatenated, fused
from methods.surface.hands import body_hands, without_hands
from methods.surface.pictures import Stages, contact_sheet

__all__ = ["ClothedMethod", "ClothedSettings", "SheetPlan", "integrated"]


@dataclass(frozen=True, slots=True)
class ClothedSettings:
    """Settings of the clothed reconstruction; those of the body fit are set beside them.

    Attributes:
        normals: ``body``, ``oracle`` (a privilege), ``open`` (the network that is shipped) or
            ``onnx``.
        normals_model: A network's file or the name of an imported one, for ``onnx``.
        resolution: Side of the working picture in pixels; ECON's is 512.
        prior_weight: How strongly integration holds on to the body's depth; 0 is the estimator's
            own: the published 1e-4, and 1e-3 for ``open``.
        clothes: How far that depth is from the body: ``uniform``, the published 2 cm, or
            ``silhouettes``, as far as those of all views show; one or two do not show the sides.
        hands: ``body`` puts the body's hands in, as ECON does; ``sheets`` leaves what is seen.
        poisson_depth: Depth of the fusion's octree; the published 10.
        faces: Decimate the mesh to about this many; 0 keeps all.
    """

    normals: str = "open"
    normals_model: str = ""
    resolution: int = 512
    prior_weight: float = 0.0
    clothes: str = "uniform"
    hands: str = "sheets"
    poisson_depth: int = 10
    faces: int = 0

    def __post_init__(self) -> None:
        check_choice("hands", self.hands, ("body", "sheets"))
        check_choice("clothes", self.clothes, ("uniform", "silhouettes"))
        if not 64 <= self.resolution <= 4096:
            raise HarnessError(
                f"setting 'resolution' cannot be '{self.resolution}'", expected="64 to 4096 pixels"
            )
        # Refuses settings that do not go together before anything runs.
        _ = self.normal_choice, self.fusion, self.integration

    @property
    def normal_choice(self) -> NormalChoice:
        """Which estimator runs."""
        return NormalChoice(self.normals, self.normals_model)

    @property
    def integration(self) -> FrontBackParameters:
        """How normals are integrated."""
        weight = self.prior_weight or self.normal_choice.prior_weight
        published = FrontBackParameters(prior_weight=weight)
        return published if self.clothes == "uniform" else replace(published, thickness=0.0)

    @property
    def fusion(self) -> FusionParameters:
        """How surfaces are fused."""
        return FusionParameters(self.poisson_depth, self.faces)


@dataclass(frozen=True, slots=True)
class SheetPlan:
    """What a method's sheets are made of.

    Attributes:
        views: The views whose normals are estimated, the front first.
        sheets: Makes the sheets of these views' maps and depths.
    """

    views: tuple[int, ...]
    sheets: Callable[[Sequence[tuple[ViewMaps, FrontBackDepth]]], list[Mesh]]


def integrated(maps: ViewMaps, parameters: FrontBackParameters) -> FrontBackDepth:
    """Both sheets' depth of one view, under its full perspective, metres."""
    prior, view = BodyPrior(maps.body_near_m, maps.body_far_m), maps.view
    normals = maps.front, maps.back
    return integrate_front_back(normals, view.mask, prior, view.camera.K, parameters)


class ClothedMethod:
    """A method of the ECON family.

    Args:
        names: Its name on the command line and its title in tables.
        fit: How the body is fitted, and to which views.
        plan: Which views' normals make which sheets.
        settings: Everything else.
    """

    def __init__(
        self, names: tuple[str, str], fit: BodyFit, plan: SheetPlan, settings: ClothedSettings
    ) -> None:
        self.settings = settings
        self._names, self._plan = names, plan
        uses_oracle = settings.normals == "oracle"
        self._fit = fit.configured({"normals": "oracle" if uses_oracle else "off"})

    @functools.cached_property
    def info(self) -> MethodInfo:
        """What the method says of itself.

        Told when it is asked for, so that a network that is not there does not keep the method from
        being configured to do without.

        Raises:
            MissingPart, DataError: as ``NormalChoice.part``.
        """
        return _info(self._names, self._fit, self.settings)

    def configured(self, parameters: Mapping[str, str]) -> ClothedMethod:
        """The method with other settings, given as text by field name."""
        own = {field.name for field in fields(ClothedSettings)}
        settings = overridden(
            self.settings, {name: text for name, text in parameters.items() if name in own}
        )
        fit = self._fit.configured(
            {name: text for name, text in parameters.items() if name not in own}
        )
        return ClothedMethod(self._names, fit, self._plan, settings)

    def reconstruct(self, capture: Capture, context: Context) -> Reconstruction:
        """The clothed mesh and the body within it, world metres.

        Raises:
            MethodError: no person found, no sheet, or a surface that does not close.
            MissingPart: the body model, MediaPipe, or a network is not installed.
        """
        fitted = self._fit.reconstruct(capture, context)
        body = fitted.body
        assert body is not None
        skin = Mesh(body.vertices, body.faces, source="fitted body")
        with context.stage("normals"):
            maps = self._maps(capture, skin, context)
        shape = skin
        if self.settings.clothes == "silhouettes":
            with context.stage("clothes"):
                used = cast("Sequence[int]", fitted.details["views_used"])
                shape = clothed_body(skin, [_outline(capture, view) for view in used])
                caster = SidedRaycaster(shape)
                maps = [each.held_to(caster) for each in maps]
        with context.stage("integration"):
            depths = [integrated(each, self.settings.integration) for each in maps]
            sheets = self._plan.sheets(list(zip(maps, depths, strict=True)))
        with context.stage("completion"):
            parts = self._parts(sheets, skin, shape)
        with context.stage("fusion"):
            mesh = fused(parts, self.settings.fusion)
        if context.keep:
            with context.stage("pictures"):
                _keep(context, Stages(maps, parts, skin, mesh))
        details = {
            "pixels_cut": [depth.pixels_cut for depth in depths],
            "integration_rounds": [len(depth.energies) for depth in depths],
            "part_faces": {part.source: len(part.faces) for part in parts},
        }
        return Reconstruction(
            mesh=mesh,
            body=body,
            normals=tuple(map(_handed_out, maps)),
            details={**fitted.details, **details},
        )

    def _maps(self, capture: Capture, skin: Mesh, context: Context) -> list[ViewMaps]:
        choice, caster = self.settings.normal_choice, SidedRaycaster(skin)
        maps = []
        for index in self._plan.views:
            view = working_view(capture, index, self.settings.resolution)
            estimator = choice.estimator(view.camera, context.privileged)
            maps.append(view_maps(view, caster, estimator))
        return maps

    def _parts(self, sheets: list[Mesh], skin: Mesh, shape: Mesh) -> list[Mesh]:
        """Sheets, completion and hands: what is fused."""
        regions = _regions(self._fit.settings)
        omitted = np.logical_or.reduce(list(regions.values()))
        hands = [body_hands(skin, regions["hands"])] if self.settings.hands == "body" else []
        if hands:
            sheets = without_hands(sheets, skin, regions["hands"])
        seen = concatenated([*sheets, *hands])
        completion = BodyCompletion()(seen, shape, omitted)
        return [*sheets, *([] if completion is None else [completion]), *hands]


def _outline(capture: Capture, view: int) -> Outline:
    camera = capture.cameras[view]
    return Outline(camera, load_mask(capture.image_path(view), camera.size) >= 0.5)


def _handed_out(maps: ViewMaps) -> NormalMaps:
    """A view's maps for others to measure; the body's reach as far as the estimate's."""
    mask = maps.view.mask
    return NormalMaps(
        view=maps.view.index,
        camera=maps.view.camera,
        mask=mask,
        front=maps.front,
        back=maps.back,
        body_front=filled_normals(maps.body_front, mask),
        body_back=filled_normals(maps.body_back, mask),
    )


def _info(names: tuple[str, str], fit: BodyFit, settings: ClothedSettings) -> MethodInfo:
    choice = settings.normal_choice
    own = {
        **asdict(settings),
        "normals_model": bool(settings.normals_model),
        "prior_weight": settings.integration.prior_weight,
    }
    return replace(
        fit.info,
        name=names[0],
        title=names[1],
        parts=(*fit.info.parts, choice.part),
        privileges=tuple(dict.fromkeys((*fit.info.privileges, *choice.privileges))),
        parameters={**fit.info.parameters, **own},
    )


def _regions(settings: FitSettings) -> Mapping[str, NDArray[np.bool_]]:
    """The masks ``hands``, ``face`` and ``eyeballs`` (V,) of the fitted body's model."""
    return body_model(settings).regions


def _keep(context: Context, stages: Stages) -> None:
    """Write the stages into the workdir: a contact sheet and every part."""
    folder = context.workdir
    save_png(folder / "contact_sheet.png", contact_sheet(stages))
    save_mesh(folder / "body.ply", stages.body)
    for part in stages.parts:
        save_mesh(folder / f"{part.source.replace(' ', '_')}.ply", part)
    for maps in stages.maps:
        with atomic_path(folder / f"maps_{maps.view.index:02d}.npz") as path:
            np.savez_compressed(
                path,
                mask=maps.view.mask,
                front=maps.front.astype(np.float32),
                back=maps.back.astype(np.float32),
                body_near_m=maps.body_near_m.astype(np.float32),
                body_far_m=maps.body_far_m.astype(np.float32),
            )

"""The way from views and a fitted body to a clothed mesh, which ``econ`` and ``mexecon`` share.

Fit the body, estimate normals, integrate them to sheets, complete the sheets, fuse. The methods
differ in which views the body is fitted to and which sheets are made of which view's normals.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from harness.core.arrays import Mask
from harness.core.artifacts import Capture, Reconstruction
from harness.core.camera import Camera
from harness.core.errors import HarnessError
from harness.core.files.atomic import atomic_path
from harness.core.mesh import Mesh
from harness.core.protocols import Context, MethodInfo, Part
from harness.core.settings import check_choice, configured
from harness.files.mesh_files import save_mesh
from harness.geometry.coinciding import concatenated
from harness.geometry.images import save_png
from harness.geometry.photo import open_photo
from harness.geometry.raycast import Raycaster
from harness.geometry.surface import SurfaceIndex
from methods.body.settings import BodyFitResult
from methods.body_fit import BodyFit
from methods.closed.lattices import cut_to_outlines
from methods.closed.surfaces import signed_outline
from methods.ifnet.completion import completed_by_network, ifnet_part
from methods.normals import NormalChoice, ViewMaps, view_maps, working_view
from methods.normals.result_maps import result_maps
from methods.publications.published import Published
from methods.stages import Stages, contact_sheet
from methods.surface.bilateral import require_device
from methods.surface.completion import (
    BodyCompletion,
    CompletionParameters,
    body_hands,
    clothed_body,
    without_hands,
    without_vertices,
)
from methods.surface.front_back import (
    BodyDepth,
    FrontBackDepth,
    FrontBackParameters,
    integrate_front_back,
)
from methods.surface.fusion import FusionParameters, fused

#: Spacing of the lattice on which a surface is cut: an edge of 50 000 faces is longer.
_ENVELOPE_M = 0.004


@dataclass(frozen=True, slots=True)
class ClothedSettings:
    """Settings of the clothed reconstruction; the defaults are the published ones of MExECON.

    Attributes:
        normals: ``body``, ``oracle`` (a privilege), ``open`` (the network that is shipped),
            ``econ`` (ECON's own, which the user imported) or ``onnx``.
        normals_model: A network's file or the name of an imported one, for ``onnx``.
        resolution: Side of the working picture in pixels; ECON's is 512.
        bilateral_k: How sharply integration lets depth jump.
        prior_weight: How strongly integration holds on to the body's depth.
        boundary_weight: How strongly both sides meet at the silhouette.
        thickness_m: By how much the body is inflated towards and away from the viewer, metres.
        clothes: What is inflated: ``uniform``, the body itself, or ``silhouettes``, the body moved
            out to the silhouettes of all views; one or two do not show the sides.
        device: What solves the integration's linear systems: ``cpu``, or a GPU such as ``cuda`` or
            ``cuda:1``, which sums in another order.
        completion: What fills the sheets' gaps: ``body``, or ``ifnet``, the surface that ECON's
            IF-Nets+ makes of sheets and body, which the user imported.
        covered_m: What completes is dropped within this distance of the sheets, metres.
        hands: ``detected`` puts in the body's hands that the detector found in the first photo, as
            ECON does, ``body`` both; ``sheets`` leaves what is seen.
        poisson_depth: Depth of the fusion's octree.
        faces: Decimate the mesh to about this many; 0 keeps all.
        envelope: ``none``, or ``outlines``: what of the fused surface lies outside the outlines of
            the photos that the body was fitted to is cut off.
    """

    normals: str = "open"
    normals_model: str = ""
    resolution: int = 512
    bilateral_k: float = 4.0
    prior_weight: float = 1e-4
    boundary_weight: float = 1e-6
    thickness_m: float = 0.02
    clothes: str = "uniform"
    device: str = "cpu"
    completion: str = "body"
    covered_m: float = 0.02
    hands: str = "sheets"
    poisson_depth: int = 10
    faces: int = 50_000
    envelope: str = "none"

    def __post_init__(self) -> None:
        check_choice("hands", self.hands, ("detected", "body", "sheets"))
        check_choice("clothes", self.clothes, ("uniform", "silhouettes"))
        check_choice("completion", self.completion, ("body", "ifnet"))
        check_choice("envelope", self.envelope, ("none", "outlines"))
        if not re.fullmatch(r"cpu|cuda(:\d+)?", self.device):
            raise HarnessError(
                f"setting 'device' cannot be '{self.device}'", expected="cpu, cuda or cuda:1"
            )
        if not 64 <= self.resolution <= 4096:
            raise HarnessError(
                f"setting 'resolution' cannot be '{self.resolution}'", expected="64 to 4096 pixels"
            )
        # Refuses settings that do not go together before anything runs.
        _ = self.normal_choice, self.fusion, self.integration, self.body_completion

    @property
    def normal_choice(self) -> NormalChoice:
        """Which estimator runs."""
        return NormalChoice(self.normals, self.normals_model)

    @property
    def integration(self) -> FrontBackParameters:
        """How normals are integrated."""
        return FrontBackParameters(
            k=self.bilateral_k,
            prior_weight=self.prior_weight,
            silhouette_weight=self.boundary_weight,
            thickness=self.thickness_m,
        )

    @property
    def body_completion(self) -> CompletionParameters:
        """How the body completes the sheets."""
        return CompletionParameters(covered_m=self.covered_m)

    @property
    def parts(self) -> tuple[Part, ...]:
        """The normal estimator, and the network that completes where there is one.

        Raises:
            MissingPart, DataError: as ``NormalChoice.part`` and ``ifnet_part``.
        """
        completing = (ifnet_part(),) if self.completion == "ifnet" else ()
        return self.normal_choice.part, *completing

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


def integrated(
    maps: ViewMaps, parameters: FrontBackParameters, device: str = "cpu"
) -> FrontBackDepth:
    """Both sheets' depth of one view, under its own camera, metres."""
    prior, view = BodyDepth(maps.body_near_m, maps.body_far_m), maps.view
    normals, camera = (maps.front, maps.back), view.camera
    if not camera.is_orthographic:
        return integrate_front_back(normals, view.mask, prior, camera.K, parameters, device)
    # Then depth is in pixels, and the weights are carried over here.
    per_m = float(camera.K[0, 0])
    carried = (parameters.pixels_per_unit / per_m) ** 2
    rules = replace(
        parameters,
        prior_weight=carried * parameters.prior_weight,
        silhouette_weight=carried * parameters.silhouette_weight,
        pixels_per_unit=per_m,
    )
    prior = BodyDepth(per_m * maps.body_near_m, per_m * maps.body_far_m)
    found = integrate_front_back(normals, view.mask, prior, None, rules, device)
    return replace(found, front=found.front / per_m, back=found.back / per_m)


class ClothedMethod:
    """A method of the ECON family.

    Args:
        names: Its name on the command line and its title in tables.
        fit: How the body is fitted, and to which views.
        plan: Which views' normals make which sheets.
        settings: How the surface is made.
        published: The publication whose name the method carries, if any.
    """

    def __init__(
        self,
        names: tuple[str, str],
        fit: BodyFit,
        plan: SheetPlan,
        settings: ClothedSettings,
        published: Published | None = None,
    ) -> None:
        self.settings = settings
        self._names, self._fit, self._plan, self._published = names, fit, plan, published

    @functools.cached_property
    def info(self) -> MethodInfo:
        """What the method says of itself.

        Made when it is asked for: a method whose network is not installed can still be configured
        to run without it.

        Raises:
            MissingPart: a network or the device of the integration is not there.
            DataError: as ``NormalChoice.part``.
        """
        if self.settings.device != "cpu":
            require_device(self.settings.device)
        choice, fit = self.settings.normal_choice, self._fit.info
        surface = {**asdict(self.settings), "normals_model": bool(self.settings.normals_model)}
        parameters = {"body": self._fit.settings.in_use(len(self._fit.views)), "surface": surface}
        return MethodInfo(
            name=self._names[0],
            title=self._names[1],
            views=fit.views,
            parts=tuple(dict.fromkeys((*fit.parts, *self.settings.parts))),
            privileges=tuple(dict.fromkeys((*fit.privileges, *choice.privileges))),
            parameters=parameters,
            deviations=self._published.deviations(parameters) if self._published else (),
            trained_on=tuple(dict.fromkeys((*fit.trained_on, *choice.trained_on))),
        )

    def configured(self, parameters: Mapping[str, str]) -> ClothedMethod:
        """The method with other settings, given as text by ``room.setting``."""
        rooms = {"body": self._fit.settings, "surface": self.settings}
        chosen = configured(rooms, parameters)
        fit = self._fit.with_settings(chosen["body"])
        return ClothedMethod(self._names, fit, self._plan, chosen["surface"], self._published)

    def require_installed(self) -> None:
        """Nothing, if the body model is there; errors as ``BodyFit.require_installed``."""
        self._fit.require_installed()

    def reconstruct(self, capture: Capture, context: Context) -> Reconstruction:
        """The clothed mesh and the body within it, world metres.

        Raises:
            MethodError: no person found, no sheet, or a surface that does not close.
            MissingPart: the body model, MediaPipe, or a network is not installed.
        """
        fit = self._fit.fit(capture, context)
        skin = fit.skin
        with context.stage("normals"):
            maps = self._maps(capture, skin, context)
        shape = skin
        if self.settings.clothes == "silhouettes":
            with context.stage("clothes"):
                outlines = [open_photo(capture, view).outline for view in fit.views_used]
                shape = clothed_body(skin, outlines)
                caster = Raycaster(shape)
                maps = [each.held_to(caster) for each in maps]
        with context.stage("integration"):
            rules, device = self.settings.integration, self.settings.device
            depths = [integrated(each, rules, device) for each in maps]
            sheets = self._plan.sheets(list(zip(maps, depths, strict=True)))
        with context.stage("completion"):
            camera = capture.cameras[self._plan.views[0]]
            parts = self._parts(sheets, fit, shape, camera)
        with context.stage("fusion"):
            mesh = fused(parts, self.settings.fusion)
        if self.settings.envelope == "outlines":
            with context.stage("envelope"):
                mesh = self._cut(mesh, capture, fit.views_used)
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
            body=fit.body,
            normals=tuple(map(result_maps, maps)),
            details={**fit.details(), **details},
        )

    def _cut(self, mesh: Mesh, capture: Capture, views: Sequence[int]) -> Mesh:
        """What of a mesh the outlines of some views leave."""
        photos = [open_photo(capture, view) for view in views]
        outlines = [signed_outline(photo.camera, photo.coverage) for photo in photos]
        return cut_to_outlines(mesh, outlines, _ENVELOPE_M)

    def _maps(self, capture: Capture, skin: Mesh, context: Context) -> list[ViewMaps]:
        choice, caster = self.settings.normal_choice, Raycaster(skin)
        maps = []
        for index in self._plan.views:
            view = working_view(capture, index, self.settings.resolution, choice.side_px)
            estimator = choice.estimator(view.camera, context.privileged)
            maps.append(view_maps(view, caster, estimator))
        return maps

    def _parts(
        self, sheets: list[Mesh], fit: BodyFitResult, shape: Mesh, camera: Camera
    ) -> list[Mesh]:
        """Sheets, completion and hands: what is fused."""
        skin, omitted = fit.skin, np.logical_or.reduce(list(fit.regions.values()))
        learned = []
        if self.settings.completion == "ifnet":
            learned = [_learned(sheets, skin, fit.regions["eyeballs"], camera)]
        replaced = self._replaced_hands(fit)
        hands = [body_hands(skin, replaced)] if replaced.any() else []
        if hands:
            sheets = without_hands(sheets, skin, replaced)
            learned = without_hands(learned, skin, replaced)
        seen = concatenated([*sheets, *hands])
        if self.settings.completion == "ifnet":
            gaps = [_uncovered(whole, seen, self.settings.covered_m) for whole in learned]
        else:
            gaps = [BodyCompletion(self.settings.body_completion)(seen, shape, omitted)]
        return [*sheets, *(gap for gap in gaps if gap is not None), *hands]

    def _replaced_hands(self, fit: BodyFitResult) -> Mask:
        """(V,) the hands of the body that stand in for those of the sheets."""
        left, right = fit.regions["left_hand"], fit.regions["right_hand"]
        if self.settings.hands == "body":
            return left | right
        if self.settings.hands == "sheets":
            return np.zeros_like(left)
        return left & fit.hands_found[0] | right & fit.hands_found[1]


def _learned(sheets: list[Mesh], skin: Mesh, eyeballs: Mask, camera: Camera) -> Mesh:
    """The closed surface that the network makes of the sheets, world metres."""
    body = without_vertices(skin, eyeballs)
    assert body is not None, "a body is more than its eyes"
    front, back = sheets
    return completed_by_network((front, back), body, camera)


def _uncovered(whole: Mesh, seen: Mesh, covered_m: float) -> Mesh | None:
    """What of a completed surface is not within a distance of what is seen."""
    _, distance = SurfaceIndex(seen).closest(whole.vertices)
    rest = without_vertices(whole, distance < covered_m)
    return None if rest is None else replace(rest, source="completion")


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

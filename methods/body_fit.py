"""``body-front``, ``body-average``, ``jmbo8``: a body fitted to one view, averaged, or jointly.

The rows of the paper's first table. Their mesh is the body's own surface, so that they are also
scored as geometry: the floor that clothes have to beat.
"""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from harness.core.artifacts import Body, Capture, Reconstruction
from harness.core.mesh import Mesh
from harness.core.privileges import Privilege
from harness.core.protocols import Context, MethodInfo
from harness.core.settings import check_choice, overridden
from methods.body import detection
from methods.body.jmbo import Weights
from methods.estimated_normals import with_estimated_normals
from methods.normals import NormalChoice

if TYPE_CHECKING:
    from methods.body.model import Parameters, ParametricBody, Posed
    from methods.body.views import Views

__all__ = [
    "BodyFit",
    "FitSettings",
    "body_average",
    "body_front",
    "body_model",
    "jmbo8",
    "jmbo8_no_head",
    "jmbo8_paper",
]

_STAGES = ("front", "average", "landmarks", "jmbo")


@dataclass(frozen=True, slots=True)
class FitSettings(Weights):
    """Settings of a body fit; those of ``Weights`` and these.

    Attributes:
        body: ``anny`` or ``smplx``.
        smplx_model: The user's own SMPL-X model file, for ``smplx``.
        stage: How far the fit goes: ``front``, ``average``, ``landmarks`` or ``jmbo``.
        start: What JMBO starts from: ``average`` (the paper) or ``landmarks``, one body fitted to
            the landmarks of all views, which also finds views with left and right exchanged.
        normals: What the normal term compares the body with: ``off``; ``open``, the network that is
            shipped; or ``oracle``, rendered from the scan, a privilege.
        subject_px: Longer side of the subject in the pictures that the fit works on.
    """

    body: str = "anny"
    smplx_model: str = ""
    stage: str = "jmbo"
    start: str = "landmarks"
    normals: str = "off"
    subject_px: int = 256

    @property
    def wants_network(self) -> bool:
        """Whether a normal network is run."""
        return self.normals == "open" and self.stage == "jmbo" and self.normal > 0


#: The paper's equation as it is printed, from the average of the single views.
PAPER = FitSettings(start="average", normals="open")
#: Better on clothed people: starts from all landmarks, clothes may stand off, a weak prior. Chosen
#: on training avatars, where the optimum is flat: half or twice a value costs at most 0.6 mm.
DEFAULT = FitSettings(
    start="landmarks",
    uncovered=0.1,
    standoff_m=0.01,
    landmark=0.2,
    prior=2e-4,
    iterations=60,
    schedule="ramp",
)


class BodyFit:
    """Fits a parametric body to some views of a capture."""

    def __init__(
        self, name: str, title: str, views: tuple[int, ...], settings: FitSettings
    ) -> None:
        self.settings = settings
        self._name, self._title, self._views = name, title, views

    @functools.cached_property
    def info(self) -> MethodInfo:
        """What the method says of itself.

        Raises:
            MissingPart, DataError: as ``NormalChoice.part``, if the fit wants a network.
        """
        return _info(self._name, self._title, self._views, self.settings)

    def configured(self, parameters: Mapping[str, str]) -> BodyFit:
        """The method with other settings, given as text by field name."""
        settings = overridden(self.settings, parameters)
        for field, known in (
            ("body", ("anny", "smplx")),
            ("stage", _STAGES),
            ("start", ("average", "landmarks")),
            ("normals", ("off", "open", "oracle")),
            ("schedule", ("plateau", "ramp")),
        ):
            check_choice(field, getattr(settings, field), known)
        return BodyFit(self._name, self._title, self._views, settings)

    def reconstruct(self, capture: Capture, context: Context) -> Reconstruction:
        """The fitted body and its surface, world metres.

        Raises:
            MethodError: no view shows a person.
            MissingPart: the body model or MediaPipe is not installed.
        """
        from methods.body.views import load_views

        wanted = [view for view in self._views if view < len(capture.cameras)]
        normals = (
            context.privileged[Privilege.ORACLE_NORMALS]
            if self.settings.normals == "oracle"
            else None
        )
        with context.stage("landmarks"):
            views = load_views(capture, wanted, self.settings.subject_px, normals)
        with context.stage("body model"):
            body = body_model(self.settings)
        with _one_thread():
            parameters, details = self.fit(body, views, capture, context)
        return _reconstruction(body, parameters, {**_said(views), **details})

    def fit(
        self, body: ParametricBody, views: Views, capture: Capture, context: Context
    ) -> tuple[dict[str, Any], dict[str, object]]:
        """Parameters of the one body that the views agree on, and what records say of the way.

        Args:
            body: With the landmarks that are to be believed.
            views: Usable ones, of the capture.
            capture: The photos.
            context: As in ``reconstruct``.
        """
        from methods.body.jmbo import optimise
        from methods.body.landmark_fit import average, fit_each_view, fit_jointly, swapped_views

        settings, details = self.settings, dict[str, object]()
        detections, sparse = views.detections, body.sparse()
        with context.stage("single views"):
            singles = fit_each_view(sparse, views.views, detections)
            parameters = average(singles)
        if settings.stage in ("front", "average"):
            return parameters, details
        if settings.stage == "landmarks" or settings.start == "landmarks":
            with context.stage("joint landmarks"):
                parameters = fit_jointly(sparse, views.views, detections, parameters)
                swapped = swapped_views(sparse, views.views, detections, parameters)
                if swapped.any():
                    detections = detections.mirrored(swapped)
                    parameters = fit_jointly(sparse, views.views, detections, parameters)
            details["swapped_views"] = [
                index
                for index, is_swapped in zip(views.indices, swapped, strict=True)
                if is_swapped
            ]
        if settings.stage == "landmarks":
            return parameters, details
        views = replace(views, detections=detections)
        if settings.wants_network:
            with context.stage("normals"):
                skin = _skin(body, _posed(body, parameters))
                views = with_estimated_normals(capture, views, skin, NormalChoice("open"))
        with context.stage("jmbo"):
            fit = optimise(body, views, parameters, settings, context.seed)
        details["jmbo"] = {
            "iterations": len(fit.costs),
            "ended": fit.ended,
            "cost": [fit.costs[0], min(fit.costs)] if fit.costs else [],
            "terms": {name: list(pair) for name, pair in fit.terms.items()},
        }
        return fit.parameters, details


def body_model(settings: FitSettings) -> ParametricBody:
    """The body that some settings name, loaded."""
    if settings.body == "smplx":
        from methods.body.smplx_body import SmplxBody

        return SmplxBody(settings.smplx_model)
    from methods.body.anny_body import AnnyBody

    return AnnyBody()


def _info(name: str, title: str, views: tuple[int, ...], settings: FitSettings) -> MethodInfo:
    from methods.body.parts import body_part

    parameters = {**asdict(settings), "smplx_model": bool(settings.smplx_model)}
    unused = {} if settings.stage == "jmbo" else {field.name for field in fields(Weights)}
    return MethodInfo(
        name=name,
        title=title,
        views=views,
        parts=(
            body_part(settings.body, settings.smplx_model),
            detection.part(),
            *((NormalChoice("open").part,) if settings.wants_network else ()),
        ),
        privileges=(
            Privilege.KNOWN_CAMERAS,
            Privilege.EXACT_MASKS,
            *((Privilege.ORACLE_NORMALS,) if settings.normals == "oracle" else ()),
        ),
        parameters={key: value for key, value in parameters.items() if key not in unused},
    )


def _said(views: Views) -> dict[str, object]:
    """What a reader of the record should know of the views."""
    said: dict[str, object] = {"views_used": list(views.indices)}
    if views.left_out:
        said["views_left_out"] = {str(index): why for index, why in views.left_out.items()}
    if len(views.views) == 1:
        said["depth"] = "one view cannot tell size from distance: its box is at the rig's centre"
    return said


def _reconstruction(
    body: ParametricBody, parameters: dict[str, Any], details: dict[str, object]
) -> Reconstruction:
    from methods.body.model import MAIN_JOINTS

    posed = _posed(body, parameters)
    mesh = _skin(body, posed)
    points = body.landmark_points(posed)
    fitted = Body(
        model=body.name,
        vertices=mesh.vertices,
        joints=posed.joints[0].double().numpy(),
        faces=body.faces,
        parameters={
            **body.export(parameters),
            "joint_names": np.array(body.joint_names),
            "main_joints": np.array([body.roles[role] for role in MAIN_JOINTS]),
            "landmark_index": body.landmarks.landmarks,
            "landmark_points": points[0].double().numpy(),
        },
    )
    return Reconstruction(mesh=mesh, body=fitted, details=details)


def _posed(body: ParametricBody, parameters: Parameters) -> Posed:
    import torch

    with torch.no_grad():
        return body.posed(parameters)


def _skin(body: ParametricBody, posed: Posed) -> Mesh:
    """The surface of the one body that was fitted, world metres."""
    return Mesh(posed.vertices[0].double().numpy(), body.faces, source="fitted body")


@contextlib.contextmanager
def _one_thread() -> Iterator[None]:
    """Small tensors: a second thread only spins, and sums keep one order for equal results."""
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


_ALL = tuple(range(8))
body_front = BodyFit("body-front", "Body, front view", (0,), replace(DEFAULT, stage="front"))
body_average = BodyFit(
    "body-average", "Body, average of views", _ALL, replace(DEFAULT, stage="average")
)
jmbo8_paper = BodyFit("jmbo8-paper", "JMBO as printed, 8 views", _ALL, PAPER)
jmbo8_no_head = BodyFit("jmbo8-no-head", "JMBO without head term", _ALL, replace(DEFAULT, head=0.0))
jmbo8 = BodyFit("jmbo8", "JMBO, 8 views", _ALL, DEFAULT)

"""``body-front``, ``body-average``, ``jmbo8``: a body fitted to one view, averaged, or jointly.

The rows of the paper's first table, and ours, ``jmbo8+``. Their mesh is the body's own surface, so
that they are also scored as geometry: the floor that clothes have to beat.
"""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from harness.core.artifacts import Body, BodyLandmarks, Capture, Reconstruction
from harness.core.mesh import Mesh
from harness.core.privileges import Privilege
from harness.core.protocols import Context, MethodInfo, Part
from harness.core.settings import by_room, overridden
from methods.body.photos import detection
from methods.deviations import BODY_AVERAGE, BODY_FRONT, JMBO_WITHOUT_HEAD, PUBLISHED_JMBO
from methods.estimated_normals import EstimatedNormals
from methods.fit_settings import JMBO, JMBO_PLUS, FitSettings
from methods.normals import NormalChoice
from methods.published import Published

if TYPE_CHECKING:
    from methods.body.models.model import Parameters, ParametricBody, Posed
    from methods.body.photos.views import Views

__all__ = [
    "BodyFit",
    "FittedBody",
    "body_average",
    "body_front",
    "body_model",
    "jmbo8",
    "jmbo8_no_head",
    "jmbo8_plus",
]

#: A hand is there when it was found in at least this share of a photo's readings.
_HAND_FOUND = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class FittedBody:
    """A body fitted to some views of a capture.

    Attributes:
        body: World metres.
        views_used: Indices of the views that it was fitted to.
        hands_found: Whether the detector found the left and the right hand in the first of them.
        details: What a reader of the record should know.
    """

    body: Body
    views_used: tuple[int, ...]
    hands_found: tuple[bool, bool]
    details: Mapping[str, object]

    @property
    def skin(self) -> Mesh:
        """The body's surface, world metres."""
        return Mesh(self.body.vertices, self.body.faces, source="fitted body")


class BodyFit:
    """Fits a parametric body to some views of a capture.

    Args:
        name: The name on the command line.
        title: The name in tables.
        views: Indices into the rig.
        settings: How the body is fitted.
        published: The publication whose name the method carries, if any.
    """

    def __init__(
        self,
        name: str,
        title: str,
        views: tuple[int, ...],
        settings: FitSettings,
        published: Published | None = None,
    ) -> None:
        self.settings = settings
        self.views = views
        self._name, self._title, self._published = name, title, published

    @functools.cached_property
    def info(self) -> MethodInfo:
        """What the method says of itself.

        Raises:
            MissingPart, DataError: as ``NormalChoice.part``, if the fit wants a network.
        """
        parameters = {"body": self.settings.in_use(len(self.views))}
        return MethodInfo(
            name=self._name,
            title=self._title,
            views=self.views,
            parts=_parts(self.settings),
            privileges=self._privileges(),
            parameters=parameters,
            deviations=self._published.deviations(parameters) if self._published else (),
        )

    def configured(self, parameters: Mapping[str, str]) -> BodyFit:
        """The method with other settings, given as text by ``body.setting``."""
        own = by_room(parameters, {"body": [field.name for field in fields(FitSettings)]})
        return self.with_settings(overridden(self.settings, own["body"]))

    def with_settings(self, settings: FitSettings) -> BodyFit:
        """The method with other settings."""
        return BodyFit(self._name, self._title, self.views, settings, self._published)

    def reconstruct(self, capture: Capture, context: Context) -> Reconstruction:
        """The fitted body and its surface, world metres.

        Raises:
            MethodError: no view shows a person.
            MissingPart: the body model or MediaPipe is not installed.
        """
        fitted = self.fitted(capture, context)
        return Reconstruction(mesh=fitted.skin, body=fitted.body, details=fitted.details)

    def fitted(self, capture: Capture, context: Context) -> FittedBody:
        """The fitted body; arguments and errors are those of ``reconstruct``."""
        from methods.body.photos.views import load_views

        wanted = [view for view in self.views if view < len(capture.cameras)]
        lent = context.privileged
        normals = lent[Privilege.ORACLE_NORMALS] if self.settings.uses_oracle else None
        centre = lent[Privilege.SUBJECT_CENTRE] if self._is_given_centre() else None
        with context.stage("landmarks"):
            views = load_views(capture, wanted, self.settings.subject_px, normals, centre)
        with context.stage("body model"):
            body = body_model(self.settings)
        with _one_thread():
            parameters, details = self.fit(body, views, capture, context)
        left, right = views.detections.hands[0] >= _HAND_FOUND
        return FittedBody(
            body=_exported(body, parameters),
            views_used=views.indices,
            hands_found=(bool(left), bool(right)),
            details={**_view_details(views), **details},
        )

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
        from methods.body.fit.fit_frame import fit_frame, in_frame, out_of_frame

        frame = fit_frame(views)
        cameras = tuple(camera.in_frame(frame) for camera in capture.cameras)
        own_capture = replace(capture, cameras=cameras)
        found, details = self._fit(body, in_frame(views, frame), own_capture, context)
        return out_of_frame(found, frame), details

    def _fit(
        self, body: ParametricBody, views: Views, capture: Capture, context: Context
    ) -> tuple[dict[str, Any], dict[str, object]]:
        """As ``fit``, all in the frame of the fit."""
        from methods.body.fit.landmark_fit import average, fit_each_view

        with context.stage("single views"):
            singles = fit_each_view(body.sparse(), views.views, views.detections)
            parameters = average(singles)
        if self.settings.stage in ("front", "average"):
            return parameters, {}
        details = dict[str, object]()
        if "landmarks" in (self.settings.stage, self.settings.start):
            with context.stage("joint landmarks"):
                views, parameters, details = _joint_landmarks(body, views, parameters)
        if self.settings.stage == "landmarks":
            return parameters, details
        optimised, told = self._jmbo(body, views, parameters, capture, context)
        return optimised, {**details, "jmbo": told}

    def _jmbo(
        self,
        body: ParametricBody,
        views: Views,
        start: Parameters,
        capture: Capture,
        context: Context,
    ) -> tuple[dict[str, Any], dict[str, object]]:
        from methods.body.fit.jmbo import optimise

        normals_of = None
        if self.settings.wants_network:
            with context.stage("normals"):
                normals_of = EstimatedNormals(capture, views, body.faces, NormalChoice("open"))
                first = normals_of(_posed(body, start).vertices[0].double().numpy())
                seen = zip(views.views, first, strict=True)
                views = replace(
                    views, views=tuple(replace(view, normals_camera=map_) for view, map_ in seen)
                )
        with context.stage("jmbo"):
            fit = optimise(body, views, start, self.settings, context.seed, normals_of)
        return fit.parameters, {
            "iterations": len(fit.costs),
            "ended": fit.ended,
            "cost": [fit.costs[0], min(fit.costs)] if fit.costs else [],
            "terms": {name: list(pair) for name, pair in fit.terms.items()},
        }

    def _is_given_centre(self) -> bool:
        return len(self.views) == 1 and self.settings.depth == "subject-centre"

    def _privileges(self) -> tuple[Privilege, ...]:
        return (
            Privilege.KNOWN_CAMERAS,
            Privilege.EXACT_MASKS,
            *((Privilege.GENERATOR_PRIOR,) if self.settings.model == "anny" else ()),
            *((Privilege.SUBJECT_CENTRE,) if self._is_given_centre() else ()),
            *((Privilege.ORACLE_NORMALS,) if self.settings.uses_oracle else ()),
        )


def body_model(settings: FitSettings) -> ParametricBody:
    """The body that some settings name, loaded."""
    if settings.model == "smplx":
        from methods.body.models.smplx_body import SmplxBody

        return SmplxBody(settings.model_file)
    from methods.body.models.anny_body import AnnyBody

    return AnnyBody()


def _parts(settings: FitSettings) -> tuple[Part, ...]:
    from methods.body.models.parts import body_part

    return (
        body_part(settings.model, settings.model_file),
        detection.part(),
        *((NormalChoice("open").part,) if settings.wants_network else ()),
    )


def _joint_landmarks(
    body: ParametricBody, views: Views, start: Parameters
) -> tuple[Views, dict[str, Any], dict[str, object]]:
    """The views with left and right put right, the body that their landmarks agree on, details."""
    from methods.body.fit.landmark_fit import fit_jointly, swapped_views

    sparse = body.sparse()
    parameters = fit_jointly(sparse, views.views, views.detections, start)
    swapped = swapped_views(sparse, views.views, views.detections, parameters)
    if swapped.any():
        views = replace(views, detections=views.detections.mirrored(swapped))
        parameters = fit_jointly(sparse, views.views, views.detections, parameters)
    told = [index for index, is_swapped in zip(views.indices, swapped, strict=True) if is_swapped]
    return views, parameters, {"swapped_views": told}


def _view_details(views: Views) -> dict[str, object]:
    """What a reader of the record should know of the views."""
    details: dict[str, object] = {"views_used": list(views.indices)}
    if views.left_out:
        details["views_left_out"] = {str(index): why for index, why in views.left_out.items()}
    if len(views.views) == 1:
        details["depth"] = (
            "held at the subject's given centre"
            if views.views[0].place.depth_is_known
            else "one view cannot tell size from distance: the body model's height prior decides"
        )
    return details


def _exported(body: ParametricBody, parameters: dict[str, Any]) -> Body:
    from methods.body.models.model import MAIN_JOINTS

    posed = _posed(body, parameters)
    points = body.landmark_points(posed)
    return Body(
        model=body.name,
        vertices=posed.vertices[0].double().numpy(),
        joints=posed.joints[0].double().numpy(),
        faces=body.faces,
        parameters=body.export(parameters),
        joint_names=body.joint_names,
        main_joints=np.array([body.roles[role] for role in MAIN_JOINTS]),
        landmarks=BodyLandmarks(body.landmarks.landmarks, points[0].double().numpy()),
    )


def _posed(body: ParametricBody, parameters: Parameters) -> Posed:
    import torch

    with torch.no_grad():
        return body.posed(parameters)


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
body_front = BodyFit(
    "body-front", "Body, front view", (0,), replace(JMBO, stage="front"), BODY_FRONT
)
body_average = BodyFit(
    "body-average", "Body, average of views", _ALL, replace(JMBO, stage="average"), BODY_AVERAGE
)
jmbo8 = BodyFit("jmbo8", "JMBO, 8 views", _ALL, JMBO, PUBLISHED_JMBO)
jmbo8_no_head = BodyFit(
    "jmbo8-no-head", "JMBO without head term", _ALL, replace(JMBO, head=0.0), JMBO_WITHOUT_HEAD
)
jmbo8_plus = BodyFit("jmbo8+", "JMBO+, 8 views", _ALL, JMBO_PLUS)

"""``body-front``, ``body-average``, ``jmbo8``: a body fitted to one view, averaged, or jointly.

The rows of the paper's first table, and ours, ``jmbo8+``. Their mesh is the body's own surface, so
that they are also scored as geometry: the floor that clothes have to beat.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from harness.core.arrays import Floats
from harness.core.artifacts import Capture, Reconstruction
from harness.core.files.hashing import file_sha256
from harness.core.process.shared_work import Work
from harness.core.protocols import Context, MethodInfo, Part, Privilege
from harness.core.settings import configured
from harness.core.typed_json import to_json
from harness.geometry.place import no_depth_is_told
from methods.body.fit.jmbo import NormalsOf
from methods.body.fitting import fit_body, packed, unpacked
from methods.body.models.choice import body_model
from methods.body.models.smplx_body import SmplxBody
from methods.body.models.smplx_file import require_model
from methods.body.models.smplx_part import body_part, model_path, named_model
from methods.body.photos import detection
from methods.body.photos.views import Given, Views, load_views
from methods.body.pixie.start import PixieView, held_values, pixie_each_view, pixie_part, pixie_sees
from methods.body.settings import JMBO, JMBO_PLUS, BodyFitResult, FitSettings
from methods.body.smplx_offsets import offsets_part
from methods.estimated_normals import EstimatedNormals
from methods.normals import NormalChoice
from methods.publications.deviations import (
    BODY_AVERAGE,
    BODY_FRONT,
    JMBO_WITHOUT_HEAD,
    PUBLISHED_JMBO,
)
from methods.publications.published import Published


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
        # Refuses settings that do not go together before anything runs.
        _ = NormalChoice.unless_off(settings.normals, settings.normals_model)

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
            trained_on=(
                _normal_choice(self.settings).trained_on if self.settings.wants_network else ()
            ),
        )

    def configured(self, parameters: Mapping[str, str]) -> BodyFit:
        """The method with other settings, given as text by ``body.setting``."""
        return self.with_settings(configured({"body": self.settings}, parameters)["body"])

    def with_settings(self, settings: FitSettings) -> BodyFit:
        """The method with other settings."""
        return BodyFit(self._name, self._title, self.views, settings, self._published)

    def require_installed(self) -> None:
        """Nothing, if the body model is there.

        Raises:
            MissingPart: it is not; the hint is the next command.
            DataError: the imported file is another one.
        """
        if self.settings.model == "smplx":
            require_model(model_path(_model_file(self.settings)))

    def reconstruct(self, capture: Capture, context: Context) -> Reconstruction:
        """The fitted body and its surface, world metres.

        Raises:
            MethodError: no view shows a person.
            MissingPart: the body model or MediaPipe is not installed.
        """
        fit = self.fit(capture, context)
        return Reconstruction(mesh=fit.skin, body=fit.body, details=fit.details())

    def fit(self, capture: Capture, context: Context) -> BodyFitResult:
        """The fitted body; arguments and errors are those of ``reconstruct``."""
        if self.settings.uses_oracle:
            # A scan's normals are no content that a key could name.
            return self._fitted(capture, context)
        return context.share(
            Work(
                name="body fit",
                module=__name__,
                inputs=self._fit_inputs(capture, context),
                make=lambda: self._fitted(capture, context),
                packed=packed,
                unpacked=unpacked,
            )
        )

    def _fit_inputs(self, capture: Capture, context: Context) -> dict[str, object]:
        wanted = self._wanted(capture)
        centre = self._given_centre(capture, context)
        return {
            "photos": [file_sha256(capture.image_path(view)) for view in wanted],
            "cameras": [capture.cameras[view].to_dict() for view in wanted],
            "views": wanted,
            "settings": self.settings.in_use(len(self.views)),
            "parts": to_json(_parts(self.settings)),
            "centre": None if centre is None else [float(value) for value in centre],
            "seed": context.seed if self.settings.draws(len(wanted)) else None,
        }

    def _wanted(self, capture: Capture) -> list[int]:
        return [view for view in self.views if view < len(capture.cameras)]

    def _fitted(self, capture: Capture, context: Context) -> BodyFitResult:
        lent = context.privileged
        normals = lent[Privilege.ORACLE_NORMALS] if self.settings.uses_oracle else None
        centre = self._given_centre(capture, context)
        with context.stage("landmarks"):
            views = load_views(
                capture,
                self._wanted(capture),
                self.settings.subject_px,
                Given(normals, centre),
                context.share,
            )
        with context.stage("body model"):
            body = body_model(self.settings.model, _model_file(self.settings))
        seen: tuple[PixieView, ...] = ()
        if self.settings.uses_pixie:
            with context.stage("first bodies"):
                seen = pixie_sees(views.views, capture)
            assert isinstance(body, SmplxBody), "the settings want SMPL-X for PIXIE"
            body = body.holding(held_values(body, seen[0]))

        def normals_in(own: Views, world_to_fit: Floats) -> NormalsOf:
            moved = _moved(capture, world_to_fit)
            return EstimatedNormals(moved, own, body.faces, _normal_choice(self.settings))

        def first_in(own: Views, world_to_fit: Floats) -> dict[str, Any]:
            assert isinstance(body, SmplxBody), "the settings want SMPL-X for PIXIE"
            return pixie_each_view(body, own.views, seen, _moved(capture, world_to_fit))

        return fit_body(
            body,
            views,
            self.settings,
            context,
            normals_in if self.settings.wants_network else None,
            first_in if self.settings.uses_pixie else None,
        )

    def _given_centre(self, capture: Capture, context: Context) -> Floats | None:
        """The subject's centre where it is a setting, or lent because photos tell no depth."""
        if self._is_given_centre():
            return context.privileged[Privilege.SUBJECT_CENTRE]
        told = not no_depth_is_told([capture.cameras[view] for view in self._wanted(capture)])
        return None if told else context.privileged.get(Privilege.SUBJECT_CENTRE)

    def _is_given_centre(self) -> bool:
        return len(self.views) == 1 and self.settings.depth == "subject-centre"

    def _knows_generated_people(self) -> bool:
        """Whether the model, what it is fitted by or what it is compared with was learned there."""
        network = _normal_choice(self.settings) if self.settings.wants_network else None
        return (
            self.settings.model == "anny"
            or (self.settings.stage == "jmbo" and not self.settings.is_published)
            or (network is not None and Privilege.GENERATOR_PRIOR in network.privileges)
        )

    def _privileges(self) -> tuple[Privilege, ...]:
        return (
            Privilege.KNOWN_CAMERAS,
            Privilege.EXACT_MASKS,
            *((Privilege.GENERATOR_PRIOR,) if self._knows_generated_people() else ()),
            *((Privilege.SUBJECT_CENTRE,) if self._is_given_centre() else ()),
            *((Privilege.ORACLE_NORMALS,) if self.settings.uses_oracle else ()),
        )


def _moved(capture: Capture, world_to_fit: Floats) -> Capture:
    """The photos with cameras described in another frame."""
    cameras = tuple(camera.in_frame(world_to_fit) for camera in capture.cameras)
    return replace(capture, cameras=cameras)


def _model_file(settings: FitSettings) -> str:
    return named_model(settings.model_file, for_pixie=settings.uses_pixie)


def _parts(settings: FitSettings) -> tuple[Part, ...]:
    return (
        body_part(settings.model, _model_file(settings)),
        *((offsets_part(),) if settings.model == "smplx" else ()),
        detection.part(),
        *((pixie_part(),) if settings.uses_pixie else ()),
        *((_normal_choice(settings).part,) if settings.wants_network else ()),
    )


def _normal_choice(settings: FitSettings) -> NormalChoice:
    """Which estimator the normal term asks, where there is one. Errors as ``NormalChoice``."""
    return NormalChoice(settings.normals, settings.normals_model)


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

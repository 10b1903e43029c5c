"""What a publication states for a method, and how a method's settings differ from it.

A method that carries a publication's name lists every difference. Differences in settings are found
by comparison, so that none can be forgotten; a setting that differs without a written reason was
set by the user. Differences that no setting shows are written down as steps.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

from harness.core.protocols import Deviation

#: The reason of a difference that the method's author gave none for.
SET_BY_USER = "set by the user"


@dataclass(frozen=True, slots=True)
class Published:
    """A published method.

    Attributes:
        source: The publication, and the public code where it says more.
        settings: Published values by ``room.setting``. A setting that is not listed is one that the
            publication does not have; ``None`` stands for a setting that follows from the photos.
        reasons: Why a setting differs by default, by ``room.setting``.
        steps: Differences that no setting shows.
        ended_by: Steps, by name, that are no differences where a ``room.setting`` has a value.
        only_with: Steps, by name, that are differences only where a ``room.setting`` has a value.
        also: Further values by ``room.setting`` that are as published.
    """

    source: str
    settings: Mapping[str, object]
    reasons: Mapping[str, str] = field(default_factory=dict[str, str])
    steps: tuple[Deviation, ...] = ()
    ended_by: Mapping[str, tuple[str, object]] = field(
        default_factory=dict[str, tuple[str, object]]
    )
    only_with: Mapping[str, tuple[str, object]] = field(
        default_factory=dict[str, tuple[str, object]]
    )
    also: Mapping[str, object] = field(default_factory=dict[str, object])

    def deviations(self, parameters: Mapping[str, Mapping[str, object]]) -> tuple[Deviation, ...]:
        """Every difference of a method with these nested parameters, settings first."""
        found = []
        for path, published in self.settings.items():
            room, _, name = path.partition(".")
            # What a stage does not use is not among its parameters.
            if name not in parameters.get(room, {}):
                continue
            here = parameters[room][name]
            if here not in (published, self.also.get(path, published)):
                why = self.reasons.get(path, SET_BY_USER)
                found.append(Deviation(path, str(published), str(here), why))
        ended = _holding(self.ended_by, parameters)
        absent = self.only_with.keys() - _holding(self.only_with, parameters)
        return (*found, *(step for step in self.steps if step.what not in ended | absent))


def _holding(
    conditions: Mapping[str, tuple[str, object]], parameters: Mapping[str, Mapping[str, object]]
) -> set[str]:
    """The names whose setting has its value."""
    return {name for name, (path, value) in conditions.items() if _value(parameters, path) == value}


def _value(parameters: Mapping[str, Mapping[str, object]], path: str) -> object:
    room, _, name = path.partition(".")
    return parameters.get(room, {}).get(name)


_SMPLX = ("body.model", "smplx")
_PIXIE = ("body.start", "pixie")

_LANDMARK_PLACES = Deviation(
    "landmark positions on SMPL-X",
    "joints of the model, and points on its faces by a table of barycentric coordinates",
    "joints as the model's regressor blends them from the skin, and the vertices that the package "
    "smplx names for nose, eyes, ears, heels and toes; moved by measured offsets where the parts "
    "name them; finger landmarks count 0.3",
    "the table is in a licensed file; 'harness parts calibrate smplx --forget' has no offsets",
)
_CROPS = Deviation(
    "pictures that PIXIE sees",
    "the box that a detector (Mask R-CNN) finds, and crops of head and hands, whose answers a "
    "moderator weighs against the body's",
    "the box of the mask alone: head, wrists, fingers and jaw come from the picture of the body",
    "the crops are placed by a first body, and are cut from the same 224 pixels",
)
_SPACES = Deviation(
    "shape and expression that PIXIE sees",
    "200 and 50 values of SMPLX_NEUTRAL_2020",
    "the same where that model is imported, as the parts say; with another model the mean of both",
    "the values of one model mean nothing in another",
)
_SIZE = Deviation(
    "size of the body",
    "PIXIE's scale, which no step changes",
    "the model's own metres: PIXIE's scale says how far away the body is, unless the views do",
    "the cameras are known, in metres",
)

STEPS = (_LANDMARK_PLACES, _CROPS, _SPACES, _SIZE)
#: The setting and value with which alone each of them is a difference.
ONLY_WITH: Mapping[str, tuple[str, object]] = {
    _LANDMARK_PLACES.what: _SMPLX,
    **{step.what: _PIXIE for step in (_CROPS, _SPACES, _SIZE)},
}
#: Steps of the open parts that are none with these.
ENDED: Mapping[str, tuple[str, object]] = {
    "landmark positions on the body": _SMPLX,
    # Face and hands stay those of PIXIE, as published.
    "what is optimised": _PIXIE,
    "first body of each view": _PIXIE,
    "distance of a single view's body": _PIXIE,
}

"""What a publication states for a method, and how a method's settings differ from it.

A method that carries a publication's name lists every difference. Differences in settings are found
by comparison, so that none can be forgotten; a setting that differs without a written reason was
set by the user. Differences that no setting shows are written down as steps.
"""

from __future__ import annotations

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

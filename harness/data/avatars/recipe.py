"""A recipe: all that the generator needs to know about one subject, from its id.

The same recipe and ``AVATARS_VERSION`` give the same files. The ids ``a01`` to ``a20`` are written
down in ``subjects``; ``t00001`` and so on are drawn from ``training``, which shares no seed, colour
or pattern size with them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass

from harness.core.errors import DataError, did_you_mean
from harness.core.hashing import derive_seed
from harness.data.avatars.subjects import SUBJECTS, Subject
from harness.data.avatars.training import TRAINING_ID, training_subject
from harness.data.avatars.wardrobe import Bottom, Colour, Hair, Shoes, Top

__all__ = ["AvatarRecipe", "recipe_for", "subject_ids"]


@dataclass(frozen=True)
class AvatarRecipe:
    """One subject: phenotype (Anny's values, 0 to 1), pose (by name), looks and clothes."""

    id: str
    seed: int
    phenotype: Mapping[str, float]
    pose: str
    skin: Colour
    eyes: Colour
    hair: Hair
    top: Top
    bottom: Bottom | None
    shoes: Shoes

    @property
    def clothing(self) -> str:
        """What is worn, in words."""
        worn = [self.top.kind] + ([self.bottom.kind] if self.bottom else [])
        return " and ".join(worn)

    def as_dict(self) -> dict[str, object]:
        """Plain values for JSON."""
        record: dict[str, object] = dict(self.__dict__)
        for key in ("hair", "top", "bottom", "shoes"):
            part = getattr(self, key)
            record[key] = None if part is None else asdict(part)
        record["phenotype"] = dict(self.phenotype)
        return record


def subject_ids() -> tuple[str, ...]:
    """The ids of the written list, in order."""
    return tuple(SUBJECTS)


def _described(subject_id: str) -> Subject:
    if subject_id in SUBJECTS:
        return SUBJECTS[subject_id]
    if TRAINING_ID.fullmatch(subject_id):
        return training_subject(subject_id)
    hint = did_you_mean(subject_id, SUBJECTS)
    raise DataError(
        f"no avatar '{subject_id}'", expected="a01 to a20, or t00001 and so on", hint=hint
    )


def recipe_for(subject_id: str) -> AvatarRecipe:
    """The recipe of a subject.

    Raises:
        DataError: no such subject; the message names the nearest.
    """
    subject = _described(subject_id)
    person = subject.person
    names = ("gender", "age", "height", "weight", "muscle", "proportions")
    return AvatarRecipe(
        id=subject_id,
        seed=derive_seed(0, "avatar", subject_id),
        phenotype={name: getattr(person, name) for name in names},
        pose=subject.pose,
        skin=person.skin,
        eyes=person.eyes,
        hair=person.hair,
        top=subject.top,
        bottom=subject.bottom,
        shoes=subject.shoes,
    )

"""A recipe: all that the generator needs to know about one subject, from its id.

The same recipe and ``AVATARS_VERSION`` give the same files.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass

from harness.core.errors import DataError, did_you_mean
from harness.core.hashing import derive_seed
from harness.data.avatars.poses import POSES, Angles
from harness.data.avatars.subjects import SUBJECTS
from harness.data.avatars.wardrobe import Bottom, Colour, Hair, Shoes, Top

__all__ = ["AvatarRecipe", "recipe_for", "subject_ids"]


@dataclass(frozen=True)
class AvatarRecipe:
    """One subject. phenotype: Anny's, 0 to 1. pose_deg: rotation vectors, degrees, product axes."""

    id: str
    seed: int
    phenotype: Mapping[str, float]
    pose: str
    pose_deg: Mapping[str, Angles]
    skin: Colour
    eyes: Colour
    hair: Hair
    top: Top
    bottom: Bottom
    shoes: Shoes

    def as_dict(self) -> dict[str, object]:
        """Plain values for JSON."""
        record = dict(self.__dict__)
        for key in ("hair", "top", "bottom", "shoes"):
            record[key] = asdict(record[key])
        record["phenotype"] = dict(self.phenotype)
        record["pose_deg"] = {bone: list(angles) for bone, angles in self.pose_deg.items()}
        return record


def subject_ids() -> tuple[str, ...]:
    """All ids that have a recipe, in order."""
    return tuple(SUBJECTS)


def recipe_for(subject_id: str) -> AvatarRecipe:
    """The recipe of a subject.

    Raises:
        DataError: no such subject; the message names the nearest.
    """
    if subject_id not in SUBJECTS:
        raise DataError(f"no avatar '{subject_id}'", hint=did_you_mean(subject_id, SUBJECTS))
    subject = SUBJECTS[subject_id]
    person = subject.person
    phenotype = {
        name: getattr(person, name) for name in ("gender", "age", "height", "weight", "muscle")
    }
    return AvatarRecipe(
        id=subject_id,
        seed=derive_seed(0, "avatar", subject_id),
        phenotype=phenotype | {"proportions": 0.6},
        pose=subject.pose,
        pose_deg=dict(POSES[subject.pose]),
        skin=person.skin,
        eyes=person.eyes,
        hair=person.hair,
        top=subject.top,
        bottom=subject.bottom,
        shoes=subject.shoes,
    )

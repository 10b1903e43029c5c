"""A recipe: all that the generator needs to know about one subject, from its id.

The same recipe and ``AVATARS_VERSION`` give the same files. The ids ``a01`` to ``a20`` are written
down in ``subjects``; ``t00001`` and so on are drawn in ``training``, which shares no seed, colour
or pattern size with them; ``s01`` to ``s20`` (sealed) and ``u00001`` and so on (wide training) are
drawn in ``populations``, with poses and bodies of their own; ``b01`` to ``b20`` and ``v00001`` and
so on are drawn in ``creased_people``, in clothes that crease.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass

from clothed_avatars.clothes.wardrobe import Bottom, Colour, Hair, Shoes, Top
from clothed_avatars.clothes.weaves import Worn
from clothed_avatars.people.poses import POSES, Pose
from clothed_avatars.people.shape import Deformation
from clothed_avatars.subjects.creased_people import (
    CREASED_TRAINING_ID,
    creased_test_ids,
    creased_test_subject,
    creased_training_subject,
)
from clothed_avatars.subjects.hard import HARD_SUBJECTS
from clothed_avatars.subjects.populations import (
    WIDE_TRAINING_ID,
    sealed_ids,
    sealed_subject,
    wide_training_subject,
)
from clothed_avatars.subjects.training import TRAINING_ID, training_subject
from clothed_avatars.subjects.written import SUBJECTS, Subject
from harness.core.errors import DataError, did_you_mean
from harness.core.files.hashing import derive_seed


@dataclass(frozen=True)
class AvatarRecipe:
    """One subject: phenotype (Anny's values, 0 to 1), pose, looks and clothes.

    ``pose`` names the pose; ``drawn_pose`` is given if it is not one of the written library, and
    ``shape`` if the body model cannot give the body. ``worn`` is given if the clothes crease.
    """

    id: str
    seed: int
    phenotype: Mapping[str, float]
    pose: str
    skin: Colour
    eyes: Colour
    hair: Hair
    top: Top
    bottom: Bottom | None
    shoes: Shoes | None
    drawn_pose: Pose | None = None
    shape: Deformation | None = None
    worn: Worn | None = None

    @property
    def posture(self) -> Pose:
        """How limbs, trunk and head are held."""
        return POSES[self.pose] if self.drawn_pose is None else self.drawn_pose

    @property
    def is_for_training(self) -> bool:
        """Whether networks may be trained on the subject; it is no test subject then."""
        return is_for_training(self.id)

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
        for key in ("drawn_pose", "shape", "worn"):
            # Left out where there is none: records of the written list stay as they were.
            if record[key] is None:
                del record[key]
            else:
                record[key] = asdict(getattr(self, key))
        record["phenotype"] = dict(self.phenotype)
        return record


def subject_ids() -> tuple[str, ...]:
    """The ids of the written list, in order."""
    return tuple(SUBJECTS)


_WRITTEN = (SUBJECTS, HARD_SUBJECTS)
_DRAWN_BY_NAME = ((sealed_ids, sealed_subject), (creased_test_ids, creased_test_subject))
_FOR_TRAINING = (
    (TRAINING_ID, training_subject),
    (WIDE_TRAINING_ID, wide_training_subject),
    (CREASED_TRAINING_ID, creased_training_subject),
)


def is_for_training(subject_id: str) -> bool:
    """Whether networks may be trained on the subject of an id; nothing is drawn to say so."""
    return any(form.fullmatch(subject_id) for form, _ in _FOR_TRAINING)


def _described(subject_id: str) -> Subject:
    for subjects in _WRITTEN:
        if subject_id in subjects:
            return subjects[subject_id]
    for ids, drawn in _DRAWN_BY_NAME:
        if subject_id in ids():
            return drawn(subject_id)
    for form, drawn in _FOR_TRAINING:
        if form.fullmatch(subject_id):
            return drawn(subject_id)
    raise DataError(
        f"no avatar '{subject_id}'",
        expected="a01 to a20, b01 to b20, h01 to h05, s01 to s20, or t, u or v and five digits, "
        "as t00001",
        hint=did_you_mean(subject_id, SUBJECTS),
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
        drawn_pose=subject.drawn_pose,
        shape=subject.shape,
        worn=subject.worn,
    )

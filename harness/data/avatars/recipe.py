"""The written list of subjects: who they are, how they stand, what they wear.

A recipe is all that the generator needs; the same recipe and ``AVATARS_VERSION`` give the same
files. Poses and garments are data, so that another draping can read them too.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from types import MappingProxyType

from harness.core.errors import DataError, did_you_mean
from harness.core.hashing import derive_seed

__all__ = ["POSES", "AvatarRecipe", "Bottom", "Colour", "Fabric", "Hair", "Shoes", "Top", "recipe_for", "subject_ids"]

Colour = tuple[int, int, int]
Angles = tuple[float, float, float]


@dataclass(frozen=True)
class Fabric:
    """Colours (8-bit sRGB) and pattern: plain, stripes, checks, dots, denim, print."""

    colour: Colour
    pattern: str = "plain"
    second: Colour = (235, 235, 230)


@dataclass(frozen=True)
class Top:
    """A shirt: sleeve ends (1 elbow, 2 wrist), hem below the hip joint (m, positive is lower),
    ease (m) is the mean distance from the body."""

    kind: str
    fabric: Fabric
    sleeve: float = 0.6
    hem: float = 0.05
    ease: float = 0.014
    sleeve_radius: float = 0.0


@dataclass(frozen=True)
class Bottom:
    """Trousers, shorts or a skirt: ends at ``length`` along the leg (1 knee, 2 ankle); ``width`` (m)
    is the least radius of a leg, ``flare`` (m) what a skirt gains towards its hem."""

    kind: str
    fabric: Fabric
    length: float = 1.93
    width: float = 0.0
    flare: float = 0.0
    ease: float = 0.010


@dataclass(frozen=True)
class Hair:
    """Cut (short, bob, long, bun) and colour."""

    cut: str
    colour: Colour


@dataclass(frozen=True)
class Shoes:
    """Colour of the upper and of the sole; ``height`` (m) above the ankle joint."""

    colour: Colour
    sole: Colour = (230, 228, 222)
    height: float = 0.0


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
        record = {key: value for key, value in self.__dict__.items()}
        for key in ("hair", "top", "bottom", "shoes"):
            record[key] = asdict(record[key])
        record["phenotype"] = dict(self.phenotype)
        record["pose_deg"] = {bone: list(angles) for bone, angles in self.pose_deg.items()}
        return record


def _mirrored(one_side: Mapping[str, Angles]) -> dict[str, Angles]:
    """Left angles and their mirror image: a reflection in x keeps x and turns y and z around."""
    both: dict[str, Angles] = {}
    for bone, (x, y, z) in one_side.items():
        both[f"{bone}.L"] = (x, y, z)
        both[f"{bone}.R"] = (x, -y, -z)
    return both


_ARMS_DOWN: dict[str, Angles] = _mirrored({"upperarm01": (0, 0, -22)})

POSES: Mapping[str, Mapping[str, Angles]] = MappingProxyType(
    {
        "a-pose": _mirrored({"upperarm01": (0, 0, -12)}),
        "standing": _ARMS_DOWN | _mirrored({"lowerarm01": (12, 0, -6)}),
        "arms-bent": _ARMS_DOWN | _mirrored({"lowerarm01": (-48, 0, 0)}),
        "walking": _ARMS_DOWN
        | {
            "upperarm01.L": (22, 0, -24),
            "upperarm01.R": (-20, 0, 24),
            "upperleg01.L": (-20, 0, -3),
            "lowerleg01.L": (8, 0, 0),
            "upperleg01.R": (12, 0, 3),
            "lowerleg01.R": (24, 0, 0),
            "foot.R": (8, 0, 0),
            "spine03": (0, 5, 0),
        },
        "hand-on-hip": _ARMS_DOWN
        | {
            "upperarm01.L": (14, 0, 2),
            "lowerarm01.L": (-40, -50, -60),
            "spine03": (0, 0, 4),
            "head": (0, 8, 0),
        },
        "weight-on-one-leg": _ARMS_DOWN
        | {
            "upperleg01.R": (-14, 0, 2),
            "lowerleg01.R": (22, 0, 0),
            "spine04": (0, 0, -3),
            "head": (4, -10, 0),
            "lowerarm01.R": (-30, 0, 0),
        },
        "looking-aside": _ARMS_DOWN
        | {
            "spine03": (0, 10, 0),
            "spine01": (0, 8, 0),
            "neck01": (0, 10, 0),
            "head": (0, 14, 0),
            "lowerarm01.L": (-60, 0, 0),
        },
    }
)


@dataclass(frozen=True)
class _Subject:
    """One line of the list; see ``AvatarRecipe`` for the meaning."""

    gender: float
    height: float
    weight: float
    muscle: float
    pose: str
    skin: Colour
    hair: Hair
    top: Top
    bottom: Bottom
    shoes: Shoes
    eyes: Colour = (92, 62, 40)
    age: float = 0.66
    extra: Mapping[str, float] = field(default_factory=dict)


_PALE, _LIGHT, _TAN, _BROWN, _DARK = (
    (236, 200, 178),
    (224, 180, 152),
    (198, 148, 112),
    (148, 100, 70),
    (98, 64, 46),
)
_BLACK, _DARK_BROWN, _CHESTNUT, _BLOND, _GREY, _RED = (
    (34, 28, 26),
    (62, 42, 30),
    (98, 62, 38),
    (186, 146, 92),
    (140, 138, 136),
    (138, 66, 34),
)
_JEANS = Fabric((62, 84, 124), "denim", (128, 148, 180))
_BLACK_JEANS = Fabric((46, 48, 54), "denim", (84, 86, 92))
_CHINO = Fabric((170, 146, 108), "plain")

_SUBJECTS: Mapping[str, _Subject] = MappingProxyType(
    {
        "a01": _Subject(
            0.05, 0.34, 0.5, 0.6, "a-pose", _LIGHT, Hair("short", _DARK_BROWN),
            Top("t-shirt", Fabric((176, 52, 48), "print", (240, 232, 214))),
            Bottom("trousers", _JEANS, width=0.075), Shoes((238, 238, 236), (200, 60, 50)),
        ),
        "a02": _Subject(
            0.95, 0.46, 0.45, 0.45, "hand-on-hip", _PALE, Hair("long", _BLOND),
            Top("long-sleeved shirt", Fabric((244, 242, 236), "stripes", (40, 60, 110)), sleeve=1.9, hem=-0.02),
            Bottom("skirt", Fabric((38, 96, 88), "plain"), length=0.95, flare=0.05),
            Shoes((60, 40, 34), (36, 28, 24)), eyes=(70, 110, 140),
        ),
    }
)


def subject_ids() -> tuple[str, ...]:
    """All ids that have a recipe, in order."""
    return tuple(_SUBJECTS)


def recipe_for(subject_id: str) -> AvatarRecipe:
    """The recipe of a subject.

    Raises:
        DataError: no such subject; the message names the nearest.
    """
    if subject_id not in _SUBJECTS:
        raise DataError(f"no avatar '{subject_id}'", hint=did_you_mean(subject_id, _SUBJECTS))
    s = _SUBJECTS[subject_id]
    phenotype = {"gender": s.gender, "age": s.age, "muscle": s.muscle, "weight": s.weight}
    phenotype |= {"height": s.height, "proportions": 0.6, **s.extra}
    return AvatarRecipe(
        id=subject_id,
        seed=derive_seed(0, "avatar", subject_id),
        phenotype=MappingProxyType(phenotype),
        pose=s.pose,
        pose_deg=MappingProxyType(dict(POSES[s.pose])),
        skin=s.skin,
        eyes=s.eyes,
        hair=s.hair,
        top=s.top,
        bottom=s.bottom,
        shoes=s.shoes,
    )

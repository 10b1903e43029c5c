"""The pose library: joint rotations that put people in everyday stances.

Rotation vectors in degrees about the product's axes (x to the person's left, y up, z forward), as
they are at the joint before its parents move. Zero is Anny's rest: arms 45 degrees out, feet apart.
Arm angles were solved for where the wrist and the knuckles should be, on the mean body.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

__all__ = ["POSES", "Angles"]

Angles = tuple[float, float, float]


def _left(angles: Mapping[str, Angles]) -> dict[str, Angles]:
    return {f"{bone}.L": value for bone, value in angles.items()}


def _right(angles: Mapping[str, Angles]) -> dict[str, Angles]:
    """The left side's angles mirrored: a reflection in x keeps x and turns y and z around."""
    return {f"{bone}.R": (x, -y, -z) for bone, (x, y, z) in angles.items()}


def _both(angles: Mapping[str, Angles]) -> dict[str, Angles]:
    return _left(angles) | _right(angles)


_DOWN = {"upperarm01": (12.0, -2.0, -12.0), "lowerarm01": (15.0, -10.0, -14.0)}
_BENT = {"upperarm01": (12.0, -2.0, -14.0), "lowerarm01": (-48.0, -12.0, -6.0)}
_HIP = {
    "upperarm01": (31.0, 8.0, 5.0),
    "lowerarm01": (-3.0, -41.0, -57.0),
    "wrist": (-13.0, -7.0, 3.0),
}
_CHEST = {"upperarm01": (8.0, -13.0, -17.0), "lowerarm01": (-46.0, -70.0, -10.0)}
_POCKET = {"upperarm01": (22.0, 0.0, -5.0), "lowerarm01": (3.0, -33.0, -25.0)}
_REACH = {"upperarm01": (-34.0, -32.0, -8.0), "lowerarm01": (-9.0, -11.0, 5.0)}
_WAVE = {"upperarm01": (-27.0, 1.0, 15.0), "lowerarm01": (-70.0, -18.0, 38.0)}

# The rest stance is wide; people stand with the feet under the hips.
_STAND = _both({"upperleg01": (0.0, 0.0, -4.0), "foot": (0.0, 0.0, 3.0)})
_CURLED = _both({f"finger{i}-1": (-14.0, 0.0, -6.0) for i in (2, 3, 4, 5)})
_BASE = _STAND | _CURLED

_WALK = {
    "upperleg01.L": (-22.0, 0.0, -4.0),
    "lowerleg01.L": (10.0, 0.0, 0.0),
    "foot.L": (2.0, 0.0, 3.0),
    "upperleg01.R": (12.0, 0.0, 4.0),
    "lowerleg01.R": (24.0, 0.0, 0.0),
    "foot.R": (6.0, 0.0, -3.0),
    "spine03": (0.0, 6.0, 0.0),
    "head": (0.0, -4.0, 0.0),
}
_ONE_KNEE = {
    "upperleg01.R": (-18.0, 0.0, 5.0),
    "lowerleg01.R": (30.0, 0.0, 0.0),
    "foot.R": (-8.0, 0.0, -3.0),
    "spine05": (0.0, 0.0, -2.0),
    "spine02": (0.0, 0.0, 3.0),
}
_TURNED = {
    "spine04": (0.0, 6.0, 0.0),
    "spine02": (0.0, 9.0, 0.0),
    "neck01": (0.0, 8.0, 0.0),
    "head": (0.0, 12.0, 0.0),
}
_SWING = {"upperarm01.L": (32.0, -2.0, -12.0), "upperarm01.R": (-12.0, 2.0, 14.0)}

POSES: Mapping[str, Mapping[str, Angles]] = MappingProxyType(
    {
        "a-pose": _BASE | _both({"upperarm01": (8.0, 0.0, -6.0), "lowerarm01": (14.0, -6.0, -6.0)}),
        "standing": _BASE | _both(_DOWN),
        "arms-bent": _BASE | _both(_BENT),
        "walking": _BASE | _both(_DOWN) | _SWING | _WALK,
        "hand-on-hip": _BASE | _both(_DOWN) | _left(_HIP) | {"head": (0.0, 8.0, 3.0)},
        "hands-on-hips": _BASE | _both(_HIP),
        "one-knee-bent": _BASE | _both(_DOWN) | _right(_POCKET) | _ONE_KNEE,
        "turning": _BASE | _both(_DOWN) | _left(_BENT) | _TURNED,
        "hand-to-chest": _BASE | _both(_DOWN) | _right(_CHEST) | {"head": (6.0, 0.0, 0.0)},
        "reaching": _BASE | _both(_DOWN) | _left(_REACH),
        "greeting": _BASE | _both(_DOWN) | _right(_WAVE) | {"head": (0.0, -6.0, -2.0)},
        "hands-at-pockets": _BASE | _both(_POCKET) | {"head": (4.0, 5.0, 0.0)},
    }
)

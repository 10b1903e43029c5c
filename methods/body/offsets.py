"""Where MediaPipe marks a body, relative to the points that a model calls by the same name.

A detector's shoulder is not a regressor's shoulder. The differences are systematic, so they were
measured once on generated people who are not among the test subjects.
"""

from __future__ import annotations

__all__ = ["ANNY_OFFSETS_MM", "LEAN_DEG"]

#: MediaPipe's bodies in space lean this much towards the camera, about its x axis: the median over
#: eight views of six generated training subjects (standard deviation 3.3).
LEAN_DEG = 5.0

#: Millimetres in the world's axes of the rest pose, by MediaPipe index.
ANNY_OFFSETS_MM: dict[int, tuple[float, float, float]] = {
    0: (0, 0, -5),
    2: (-11, 1, -7),
    5: (11, 1, -7),
    7: (-24, 5, 29),
    8: (24, 5, 29),
    11: (10, 9, 0),
    12: (-10, 9, 0),
    13: (5, -8, -5),
    14: (-5, -8, -5),
    15: (8, -13, 10),
    16: (-8, -13, 10),
    17: (-10, 14, 14),
    18: (10, 14, 14),
    19: (-2, -8, -19),
    20: (2, -8, -19),
    21: (21, -23, 4),
    22: (-21, -23, 4),
    23: (3, 13, 4),
    24: (-3, 13, 4),
    25: (-8, 3, 4),
    26: (8, 3, 4),
    27: (-2, -3, -3),
    28: (2, -3, -3),
    29: (-13, -7, -5),
    30: (13, -7, -5),
    31: (12, 0, -13),
    32: (-12, 0, -13),
}

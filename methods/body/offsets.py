"""Where MediaPipe marks a body, relative to the points that a model calls by the same name.

A detector's shoulder is not a regressor's shoulder, and clothes move what it sees: a knee in
trousers is marked lower and further in. The differences are systematic, so they were measured once
on 18 draped training avatars, none of them a test subject. Subjects differ from the mean (median
distance) by 6 mm at the face, 8 at the shoulders, 9 at wrists, 13 at elbows, 16 at hips and ankles,
19 at knees. ``python -m harness.pipeline.landmark_offsets t00001..t00020`` measures them again.
"""

from __future__ import annotations

__all__ = ["ANNY_OFFSETS_MM", "LEAN_DEG"]

#: MediaPipe's bodies in space lean this much towards the camera, about its x axis: the median over
#: eight views of six generated training subjects (standard deviation 3.3).
LEAN_DEG = 5.0

#: Millimetres in the world's axes of the rest pose, by MediaPipe index.
ANNY_OFFSETS_MM: dict[int, tuple[float, float, float]] = {
    0: (0, 15, -3),
    2: (-9, 17, -12),
    5: (9, 17, -12),
    7: (-22, 17, 16),
    8: (22, 17, 16),
    11: (13, 5, -4),
    12: (-13, 5, -4),
    13: (1, -9, -9),
    14: (-1, -9, -9),
    15: (5, -6, 3),
    16: (-5, -6, 3),
    17: (-10, 17, 12),
    18: (10, 17, 12),
    19: (-3, -7, -26),
    20: (3, -7, -26),
    21: (20, -19, -8),
    22: (-20, -19, -8),
    23: (5, -12, 2),
    24: (-5, -12, 2),
    25: (-22, -11, 11),
    26: (22, -11, 11),
    27: (-6, 7, -1),
    28: (6, 7, -1),
    29: (-13, 5, -7),
    30: (13, 5, -7),
    31: (12, 8, -22),
    32: (-12, 8, -22),
}

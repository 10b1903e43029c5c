"""Where MediaPipe marks a body, relative to the points that a model calls by the same name.

A detector's shoulder is not a regressor's shoulder, and clothes move what it sees: a knee in
trousers is marked lower and further in. The differences are systematic, so they were measured once
on 34 draped training avatars, none of them a test subject, with what silhouettes and priors add to
them in a fit. Fitted to 18 of them and tried on the other 16, joints come 0.5 mm nearer by the
latter. After it, landmarks of a fitted subject differ from the mean (median distance) by 3 to 5 mm
at head, shoulders and wrists, 9 at elbows, 10 to 13 at hips, knees and ankles.
``python -m harness.pipeline.calibrating.landmark_offsets t00001..t00036`` measures them again. They
are of two readings a photo; six (see ``detection``) move them by 2 mm at most and fitted joints by
0.02.
"""

from __future__ import annotations

#: MediaPipe's bodies in space lean this much towards the camera, about its x axis: the median over
#: eight views of six generated training subjects (standard deviation 3.3).
LEAN_DEG = 5.0

#: Millimetres in the world's axes of the rest pose, by MediaPipe index.
ANNY_OFFSETS_MM: dict[int, tuple[float, float, float]] = {
    0: (0, 18, -6),
    2: (-10, 20, -15),
    5: (10, 20, -15),
    7: (-22, 19, 14),
    8: (22, 19, 14),
    11: (15, 3, -2),
    12: (-15, 3, -2),
    13: (1, -15, -19),
    14: (-1, -15, -19),
    15: (3, -4, 3),
    16: (-3, -4, 3),
    17: (-11, 20, 11),
    18: (11, 20, 11),
    19: (-5, -4, -27),
    20: (5, -4, -27),
    21: (18, -17, -9),
    22: (-18, -17, -9),
    23: (9, -9, 0),
    24: (-9, -9, 0),
    25: (-20, -8, 13),
    26: (20, -8, 13),
    27: (-4, 6, 0),
    28: (4, 6, 0),
    29: (-16, 3, -5),
    30: (16, 3, -5),
    31: (16, 10, -20),
    32: (-16, 10, -20),
}

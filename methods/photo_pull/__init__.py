"""Closed surfaces that follow what neighbouring photos agree on, for the methods that make such.

``task`` says what is asked of the photos. ``camera_shifts`` and ``shift_system`` correct cameras
that contradict each other, ``dents`` fills the hollows of a start surface where photos show
something in front of them, and ``pulled`` moves the surface to the points.
"""

"""Closed surfaces that follow what neighbouring photos agree on, for the methods that make such.

``dents`` fills the hollows of a start surface where photos show something in front of them, and
``pulled`` moves the surface to the points.
"""

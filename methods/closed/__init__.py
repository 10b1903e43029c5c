"""Closed surfaces: on lattices of points, with values at vertices, and against outlines."""

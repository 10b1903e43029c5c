"""Figures of a run: methods side by side, errors, bodies and normals."""

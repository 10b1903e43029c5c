"""Depth Anything 3, run by the user's own installation of ``depth-anything-3``."""

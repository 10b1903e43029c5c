"""Blender: the scene as data, the job that spawns it, the worker that runs inside."""

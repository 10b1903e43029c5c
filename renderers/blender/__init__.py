"""Blender: the scene as data, the job that starts it, the worker that runs inside."""

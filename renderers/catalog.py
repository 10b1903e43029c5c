"""The renderers by name; a renderer is imported when it is first used."""

from __future__ import annotations

from harness.core.process.registry import Registry

RENDERERS = Registry(
    "renderer",
    {
        # Path-traced photographs, in Blender's own process.
        "blender": "renderers.blender.job:BlenderRenderer",
        # First hits with plain shading: fast, needs no Blender.
        "raycast": "renderers.raycast:RaycastRenderer",
    },
)

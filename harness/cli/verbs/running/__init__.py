"""Commands that make photos, meshes and numbers."""

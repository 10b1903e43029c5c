"""Files that others write: meshes, materials, cameras."""

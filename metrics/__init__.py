"""Turn two meshes into numbers with units: pure functions on arrays."""

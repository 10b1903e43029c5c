"""Samples of generated people: photos, the bodies that a fit might give, and true normals."""

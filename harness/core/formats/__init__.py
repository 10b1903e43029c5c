"""Mesh files: OBJ, PLY, GLB, OFF and STL, each read by one module of numpy."""

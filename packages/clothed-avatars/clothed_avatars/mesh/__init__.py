"""Meshes of the generator: quads, closed surfaces, texture charts, smooth noise."""

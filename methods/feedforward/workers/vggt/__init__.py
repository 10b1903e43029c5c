"""VGGT, run by the user's own installation of the ``vggt`` package."""

"""Points to a closed mesh: depth maps of many sources, one alignment, one filter, one surface.

A source (``sources``) gives depth and cameras of each view, ``frames`` says how its pixels belong
to the photos, ``alignment`` brings them to the world's metres, ``filtering`` keeps what can be
believed, ``normals`` orients the points by their depth grid, and ``meshing`` makes one closed,
outward piece by screened Poisson reconstruction. ``method`` puts these together.

The room knows photos, cameras and masks; nothing in it needs a body.
"""

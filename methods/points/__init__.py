"""Depth maps, clouds and Gaussians to a closed mesh: one alignment, one filter, one surface.

``surfacing`` puts it together: ``splats`` renders Gaussians as depth maps, ``alignment`` brings a
result to the world's metres, ``filtering`` and ``clouds`` keep what can be believed and orient it,
and ``meshing`` makes one closed, outward piece by screened Poisson reconstruction.

The room knows photos, cameras and masks; nothing in it needs a body.
"""

"""Photo-consistency: what neighbouring calibrated photos agree on pulls a closed surface.

``patchmatch`` finds a depth map for each view, ``consistency`` keeps the points that the maps of
two neighbours share, ``pull`` moves a closed surface to them, and ``narrow`` finishes it with a
short search in the photos' full resolution. ``evidence`` decides how far each step is believed.

The room knows photos, cameras and a mesh to start from; nothing in it needs a body or normals.
"""

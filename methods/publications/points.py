"""How ``vggt8`` differs from the row of that name in the MExECON paper, as far as that is known.

The paper says: eight photos, the official code with its default parameters, a mesh by Poisson
surface reconstruction of the point cloud. It says neither how the result was brought to the
ground truth's frame and scale nor how the points were chosen and oriented.
"""

from __future__ import annotations

from harness.core.protocols import Deviation
from methods.publications.published import Published

_NOT_STATED = "not stated"

VGGT_ROW = Published(
    source="MExECON, comparison with VGGT, and VGGT's official code",
    settings={"network.fit": "crop", "keep.drop_share": 0.5},
    reasons={
        "network.fit": (
            "the official default fills the width and cuts what is taller, which are head and feet "
            "in photos of standing people; whether the authors' photos were cut is not known"
        ),
        "keep.drop_share": (
            "the official viewer drops the less confident half, which leaves gaps in a person's "
            "surface; VGGT's author advises a fifth; what the paper's mesh was made of is not known"
        ),
    },
    steps=(
        Deviation(
            "alignment",
            _NOT_STATED,
            "as align.mode says, in the title",
            "VGGT's world has a unit and axes of its own, so that there was one; it decides the "
            "numbers as much as the network does",
        ),
        Deviation(
            "points",
            "VGGT's dense point cloud; from which head is not stated",
            "depth, unprojected with the estimated cameras",
            "VGGT's authors call it the more accurate one",
        ),
        Deviation(
            "choice of points",
            _NOT_STATED,
            "exact mask, depth edges, confidence, consistency of views, outliers",
            "the background has to go, and the record says what each step keeps",
        ),
        Deviation(
            "normals of points",
            _NOT_STATED,
            "from the depth grid, facing the camera",
            "no side has to be guessed",
        ),
        Deviation(
            "surface",
            "Poisson surface reconstruction (2006), settings not stated",
            "screened Poisson reconstruction (2013), as mesh.depth and mesh.trim say",
            "its successor, which Open3D has",
        ),
        Deviation(
            "background of the photos",
            _NOT_STATED,
            "white",
            "what VGGT's own code puts behind transparent pixels",
        ),
    ),
)

"""What still differs from the publications where the paper's own parts run: SMPL-X and PIXIE.

Each of these is listed where its part is used, and nowhere else; what it replaces is named too.
"""

from __future__ import annotations

from collections.abc import Mapping

from harness.core.protocols import Deviation

_SMPLX = ("body.model", "smplx")
_PIXIE = ("body.start", "pixie")

_LANDMARK_PLACES = Deviation(
    "landmark positions on SMPL-X",
    "joints of the model, and points on its faces by a table of barycentric coordinates",
    "joints as the model's regressor blends them from the skin, and the vertices that the package "
    "smplx names for nose, eyes, ears, heels and toes; moved by measured offsets where the parts "
    "name them; finger landmarks count 0.3",
    "the table is in a licensed file; 'harness parts calibrate smplx --forget' has no offsets",
)
_CROPS = Deviation(
    "pictures that PIXIE sees",
    "the box that a detector (Mask R-CNN) finds, and crops of head and hands, whose answers a "
    "moderator weighs against the body's",
    "the box of the mask alone: head, wrists, fingers and jaw come from the picture of the body",
    "the crops are placed by a first body, and are cut from the same 224 pixels",
)
_SPACES = Deviation(
    "shape and expression that PIXIE sees",
    "200 and 50 values of SMPLX_NEUTRAL_2020",
    "the same where that model is imported, as the parts say; with another model the mean of both",
    "the values of one model mean nothing in another",
)
_SIZE = Deviation(
    "size of the body",
    "PIXIE's scale, which no step changes",
    "the model's own metres: PIXIE's scale says how far away the body is, unless the views do",
    "the cameras are known, in metres",
)

STEPS = (_LANDMARK_PLACES, _CROPS, _SPACES, _SIZE)
#: The setting and value with which alone each of them is a difference.
ONLY_WITH: Mapping[str, tuple[str, object]] = {
    _LANDMARK_PLACES.what: _SMPLX,
    **{step.what: _PIXIE for step in (_CROPS, _SPACES, _SIZE)},
}
#: Steps of the open parts that are none with these.
ENDED: Mapping[str, tuple[str, object]] = {
    "landmark positions on the body": _SMPLX,
    # Face and hands stay those of PIXIE, as published.
    "what is optimised": _PIXIE,
    "first body of each view": _PIXIE,
    "distance of a single view's body": _PIXIE,
}

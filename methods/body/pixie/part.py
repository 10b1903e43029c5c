"""The kind of part ``pixie``: ``pixie_model.tar``, converted to one ONNX file."""

from __future__ import annotations

from methods.parts.kind import About
from methods.parts.store import ConvertedKind

#: The file that the network becomes.
NETWORK = "body.onnx"
#: What it answers with, in this order, and how many numbers each has.
OUTPUTS = {"body": 117, "head": 259, "left_hand": 96, "right_hand": 96}

PIXIE = ConvertedKind(
    About(
        name="pixie",
        role="first body",
        purpose="PIXIE, which regresses the first SMPL-X body of each view",
        licence="PIXIE licence (non-commercial research)",
        source="Register at https://pixie.is.tue.mpg.de, or take it from ECON's pixie_data.zip",
        files=("pixie_model.tar",),
    ),
    "methods.body.pixie.network:examine",
    "harness eval --method mexecon8 --set body.model=smplx --set body.start=pixie",
)

"""The kind of part ``ifnet``: ECON's ``ifnet.ckpt``, converted to two ONNX files."""

from __future__ import annotations

from methods.parts.kind import About
from methods.parts.store import ConvertedKind

#: The files for what is computed once for a subject, and for each point.
ENCODER, DECODER = "encoder.onnx", "decoder.onnx"

IFNET = ConvertedKind(
    About(
        name="ifnet",
        role="completion",
        purpose="IF-Nets+, ECON's network that completes the sheets to a closed surface",
        licence="ECON licence (non-commercial research)",
        source="Register at https://icon.is.tue.mpg.de and unpack econ_data.zip, where it is in "
        "ckpt/",
        files=("ifnet.ckpt",),
    ),
    "methods.ifnet.network:examine",
    "harness eval --method mexecon8 --set surface.completion=ifnet",
)

"""The kind of part ``econ-normal``: ECON's ``normal.ckpt``, converted to two ONNX files."""

from __future__ import annotations

from methods.parts.kind import About
from methods.parts.store import ConvertedKind

#: The files that the networks for the front and the back become, by their names in the checkpoint.
FILES = {"netF": "netF.onnx", "netB": "netB.onnx"}

ECON_NORMALS = ConvertedKind(
    About(
        name="econ-normal",
        role="normal estimator",
        purpose="ECON's own normal networks for the front and the back, as the paper uses them",
        licence="ECON licence (non-commercial research)",
        source="Register at https://icon.is.tue.mpg.de and unpack econ_data.zip, where it is in "
        "ckpt/",
        files=("normal.ckpt",),
    ),
    "methods.normals.econ.network:examine",
    "harness eval --method econ --set surface.normals=econ --set body.normals=econ",
)

"""The kind of part ``econ-normal``: ECON's ``normal.ckpt``, converted to two ONNX files."""

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
    "methods.normals.econ_network:examine",
    "harness eval --method econ --set surface.normals=econ --set body.normals=econ",
)


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

"""The kind of part ``masks-onnx``: a network that marks the person in a photo."""

from __future__ import annotations

from methods.masks.recipes import MASK_RECIPES
from methods.parts.kind import About
from methods.parts.store import ConvertedKind

#: The file of the network, and the detail that names its recipe.
NETWORK_FILE, RECIPE = "network.onnx", "recipe"

MASK_NETWORKS = ConvertedKind(
    About(
        name="masks-onnx",
        role="segmentation",
        purpose="a network that marks the person in a photo, for photos without masks",
        licence="as the file's publisher says",
        source="Take U2-Net (u2net_human_seg), IS-Net or BiRefNet as ONNX from its authors or from "
        f"rembg's releases, and say --recipe {' or '.join(MASK_RECIPES)}",
        files=("FILE.onnx",),
        takes=("name", "recipe"),
    ),
    "methods.masks.network:examine",
    "harness capture import DIR --masks-by {name}",
)

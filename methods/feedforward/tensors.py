"""The tensors of VGGT-1B that depth and cameras need, by name and shape.

Of its 1,257 million parameters 1,158 million: the aggregator, the camera head and the depth head.
The heads for points and tracks are not used, and neither kept nor loaded.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping

Shape = tuple[int, ...]

#: What names of tensors begin with that a file may hold and that are left out.
UNUSED_HEADS = ("point_head.", "track_head.")

_WIDTH, _BLOCKS, _HEAD_WIDTH = 1024, 24, 64
_CAMERA_BLOCKS, _FEATURES = 4, 256
_DPT_WIDTHS = (256, 512, 1024, 1024)


@functools.cache
def vggt_shapes() -> Mapping[str, Shape]:
    """Shape of each tensor by its name in the file."""
    found: dict[str, Shape] = {}
    found |= {
        "aggregator.camera_token": (1, 2, 1, _WIDTH),
        "aggregator.register_token": (1, 2, 4, _WIDTH),
    }
    found |= _patch_embedding("aggregator.patch_embed")
    for kind in ("frame_blocks", "global_blocks"):
        for number in range(_BLOCKS):
            name = f"aggregator.{kind}.{number}"
            found |= _block(name, _WIDTH) | _norm(f"{name}.attn.q_norm", _HEAD_WIDTH)
            found |= _norm(f"{name}.attn.k_norm", _HEAD_WIDTH)
    return found | _camera_head("camera_head", 2 * _WIDTH) | _depth_head("depth_head", 2 * _WIDTH)


def _norm(name: str, width: int) -> dict[str, Shape]:
    return {f"{name}.weight": (width,), f"{name}.bias": (width,)}


def _layer(name: str, *shape: int) -> dict[str, Shape]:
    """A linear or convolutional layer with a bias."""
    return {f"{name}.weight": shape, f"{name}.bias": shape[:1]}


def _block(name: str, width: int) -> dict[str, Shape]:
    """A transformer block."""
    return {
        **_norm(f"{name}.norm1", width),
        **_layer(f"{name}.attn.qkv", 3 * width, width),
        **_layer(f"{name}.attn.proj", width, width),
        f"{name}.ls1.gamma": (width,),
        **_norm(f"{name}.norm2", width),
        **_layer(f"{name}.mlp.fc1", 4 * width, width),
        **_layer(f"{name}.mlp.fc2", width, 4 * width),
        f"{name}.ls2.gamma": (width,),
    }


def _patch_embedding(name: str) -> dict[str, Shape]:
    found: dict[str, Shape] = {
        f"{name}.cls_token": (1, 1, _WIDTH),
        f"{name}.pos_embed": (1, 1 + 37 * 37, _WIDTH),
        f"{name}.register_tokens": (1, 4, _WIDTH),
        f"{name}.mask_token": (1, _WIDTH),
        **_norm(f"{name}.norm", _WIDTH),
    }
    # A convolution's bias has one number for each output, as a linear layer's has.
    found |= _layer(f"{name}.patch_embed.proj", _WIDTH, 3, 14, 14)
    for number in range(_BLOCKS):
        found |= _block(f"{name}.blocks.{number}", _WIDTH)
    return found


def _camera_head(name: str, width: int) -> dict[str, Shape]:
    found: dict[str, Shape] = {
        f"{name}.empty_pose_tokens": (1, 1, 9),
        **_norm(f"{name}.token_norm", width),
        **_norm(f"{name}.trunk_norm", width),
        **_layer(f"{name}.embed_pose", width, 9),
        **_layer(f"{name}.poseLN_modulation.1", 3 * width, width),
        **_layer(f"{name}.pose_branch.fc1", width // 2, width),
        **_layer(f"{name}.pose_branch.fc2", 9, width // 2),
    }
    for number in range(_CAMERA_BLOCKS):
        found |= _block(f"{name}.trunk.{number}", width)
    return found


def _depth_head(name: str, width: int) -> dict[str, Shape]:
    found: dict[str, Shape] = _norm(f"{name}.norm", width)
    for number, own in enumerate(_DPT_WIDTHS):
        found |= _layer(f"{name}.projects.{number}", own, width, 1, 1)
        found[f"{name}.scratch.layer{number + 1}_rn.weight"] = (_FEATURES, own, 3, 3)
    for number, size in ((0, 4), (1, 2), (3, 3)):
        own = _DPT_WIDTHS[number]
        found |= _layer(f"{name}.resize_layers.{number}", own, own, size, size)
    for number in range(1, 5):
        part = f"{name}.scratch.refinenet{number}"
        found |= _layer(f"{part}.out_conv", _FEATURES, _FEATURES, 1, 1)
        # The innermost one has nothing to add to, so that its first unit is missing.
        for unit in ("resConfUnit1", "resConfUnit2")[number == 4 :]:
            for conv in ("conv1", "conv2"):
                found |= _layer(f"{part}.{unit}.{conv}", _FEATURES, _FEATURES, 3, 3)
    found |= _layer(f"{name}.scratch.output_conv1", _FEATURES // 2, _FEATURES, 3, 3)
    found |= _layer(f"{name}.scratch.output_conv2.0", 32, _FEATURES // 2, 3, 3)
    found |= _layer(f"{name}.scratch.output_conv2.2", 2, 32, 1, 1)
    return found

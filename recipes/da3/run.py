"""Depth Anything 3 on some photos, by its package, which resizes them itself.

Given cameras it keeps, so that its depth is in metres then. Source: Lin et al., "Depth Anything 3:
Recovering the visual space from any views", 2025.
"""

from __future__ import annotations

import importlib
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
import exchange


def main() -> None:
    """Read the folder, write depth and cameras on the pixels that the package chose."""
    import torch

    asked = exchange.arguments("weights", "side", "background", "device")
    photos = exchange.read_photos(asked.photos)
    if len({photo.rgba.shape for photo in photos}) > 1:
        exchange.refuse("photos of several sizes cannot be sent")
    device = exchange.device_of(asked.device, torch)
    start = time.perf_counter()
    api = importlib.import_module("depth_anything_3.api")
    model = api.DepthAnything3.from_pretrained(asked.weights).to(device).eval()
    loaded = time.perf_counter()
    given = {}
    if photos[0].intrinsics is not None:
        given["intrinsics"] = np.stack([p.intrinsics for p in photos]).astype(np.float32)
        given["extrinsics"] = np.stack([p.world_to_camera for p in photos]).astype(np.float32)
    found = model.inference(
        [np.asarray(exchange.over(photo.rgba, int(asked.background))) for photo in photos],
        **given,
        align_to_input_ext_scale=True,
        process_res=int(asked.side),
        process_res_method="upper_bound_resize",
    )
    report = exchange.costs(device, torch, start, loaded)
    arrays = {
        "depth": np.asarray(found.depth, np.float32),
        "confidence": np.asarray(found.conf, np.float32),
        "intrinsics": np.asarray(found.intrinsics, np.float64),
        "world_to_camera": exchange.whole(found.extrinsics),
    }
    exchange.write_depth(asked.out, arrays, report)


if __name__ == "__main__":
    main()

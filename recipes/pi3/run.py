"""Pi3 on some photos, by its package. It gives points of each view, and poses, but no intrinsics.

A focal length for each view is fitted to its points, with the middle of the picture as principal
point. Source: Wang et al., "Pi3: Permutation-equivariant visual geometry learning", 2025.
"""

from __future__ import annotations

import importlib
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
import exchange

_PATCH = 14


def fitted_intrinsics(points: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """(S, 3, 3) of the pinhole cameras nearest to points (S, H, W, 3) in camera axes."""
    height, width = points.shape[1:3]
    across = np.arange(width) + 0.5 - width / 2
    down = (np.arange(height) + 0.5 - height / 2)[:, None]
    found = np.tile(np.eye(3), (len(points), 1, 1))
    ahead = np.where(points[..., 2] > 0, points[..., 2], np.inf)
    for axis, place in ((0, across), (1, down)):
        slope = points[..., axis] / ahead
        both = (weight * slope * place).sum(axis=(1, 2)) / (weight * slope**2).sum(axis=(1, 2))
        found[:, axis, axis], found[:, axis, 2] = both, (width, height)[axis] / 2
    return found


def main() -> None:
    """Read the folder, write depth and cameras."""
    import torch

    asked = exchange.arguments("weights", "side", "background", "device")
    photos = exchange.read_photos(asked.photos)
    shown = exchange.fitted_all(photos, int(asked.side), _PATCH, "fit", int(asked.background))
    device = exchange.device_of(asked.device, torch)
    start = time.perf_counter()
    models = importlib.import_module("pi3.models.pi3")
    model = models.Pi3.from_pretrained(asked.weights).to(device).eval()
    loaded = time.perf_counter()
    images = torch.from_numpy(np.stack([each.picture for each in shown]))
    images = images.permute(0, 3, 1, 2)[None].float().div(255).to(device)
    with torch.no_grad(), torch.autocast(device, torch.bfloat16, enabled=device == "cuda"):
        found = model(images)
    points = found["local_points"][0].float().cpu().numpy().astype(np.float64)
    # Its confidences are logits.
    sure = torch.sigmoid(found["conf"][0, ..., 0].float()).cpu().numpy()
    poses = found["camera_poses"][0].float().cpu().numpy().astype(np.float64)
    report = exchange.costs(device, torch, start, loaded)
    arrays = {
        "depth": points[..., 2],
        "confidence": sure,
        "intrinsics": fitted_intrinsics(points, sure),
        "world_to_camera": np.linalg.inv(poses),
    }
    exchange.write_depth(asked.out, arrays, report, shown)


if __name__ == "__main__":
    main()

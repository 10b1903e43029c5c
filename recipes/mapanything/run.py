"""MapAnything on some photos, by its package.

With cameras given its world is metric but starts at its first camera; depth is along the optical
axis either way, so that the given cameras stand for its own. Source: Keetha et al., "MapAnything:
Universal feed-forward metric 3D reconstruction", 2025.
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
#: What its encoder was trained with, under the name ``dinov2``.
_MEAN, _DEVIATION, _NORM = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225), "dinov2"


def _views(shown, photos, device):  # noqa: ANN001, ANN202
    """What the network takes of each photo."""
    import torch

    mean, deviation = (torch.tensor(values)[None, :, None, None] for values in (_MEAN, _DEVIATION))
    views = []
    for each, photo in zip(shown, photos):  # noqa: B905 - Python 3.8
        image = torch.from_numpy(each.picture.copy())[None].permute(0, 3, 1, 2).float().div(255)
        view = {"img": ((image - mean) / deviation).to(device), "data_norm_type": [_NORM]}
        if photo.intrinsics is not None:
            pose = np.linalg.inv(photo.world_to_camera)
            for key, value in (("intrinsics", each.intrinsics(photo)), ("camera_poses", pose)):
                view[key] = torch.from_numpy(value)[None].float().to(device)
            view["is_metric_scale"] = torch.tensor([True], device=device)
        views.append(view)
    return views


def _stacked(found, key):  # noqa: ANN001, ANN202
    return np.stack([each[key][0].float().cpu().numpy() for each in found])


def main() -> None:
    """Read the folder, write depth and cameras."""
    import torch

    asked = exchange.arguments("weights", "side", "fit", "background", "device", "precision")
    photos = exchange.read_photos(asked.photos)
    shown = exchange.fitted_all(photos, int(asked.side), _PATCH, asked.fit, int(asked.background))
    device = exchange.device_of(asked.device, torch)
    half = asked.precision == "bf16" or (asked.precision == "auto" and device == "cuda")
    start = time.perf_counter()
    models = importlib.import_module("mapanything.models")
    model = models.MapAnything.from_pretrained(asked.weights).to(device).eval()
    loaded = time.perf_counter()
    found = model.infer(
        _views(shown, photos, device),
        memory_efficient_inference=True,
        use_amp=half,
        amp_dtype="bf16",
        # Masks and filters are the harness's, the same for every method.
        apply_mask=False,
        mask_edges=False,
        apply_confidence_mask=False,
    )
    if photos[0].intrinsics is None:
        intrinsics = _stacked(found, "intrinsics")
        moves = np.linalg.inv(_stacked(found, "camera_poses").astype(np.float64))
    else:
        intrinsics = np.stack([e.intrinsics(p) for e, p in zip(shown, photos)])  # noqa: B905
        moves = np.stack([photo.world_to_camera for photo in photos])
    report = exchange.costs(device, torch, start, loaded)
    arrays = {
        "depth": _stacked(found, "depth_z")[..., 0],
        "confidence": _stacked(found, "conf"),
        "intrinsics": intrinsics,
        "world_to_camera": moves,
    }
    exchange.write_depth(asked.out, arrays, report, shown)


if __name__ == "__main__":
    main()

"""MapAnything on some pictures: ``python worker.py REQUEST ANSWER``; needs its package.

The request: ``images`` (S, H, W, 3) uint8, perhaps ``intrinsics`` (S, 3, 3) and
``camera_to_world`` (S, 4, 4), metres, and settings ``weights`` (a folder with ``config.json`` and
``model.safetensors``), ``device`` and ``precision``. The answer: ``depth`` and ``confidence``
(S, H, W), ``intrinsics`` (S, 3, 3), ``camera_to_world`` (S, 4, 4).
"""

from __future__ import annotations

import importlib
import json
import sys
import time

import numpy as np
import torch

#: What its encoder was trained with, under the name ``dinov2``.
_MEAN, _DEVIATION = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
_NORM = "dinov2"


def _views(request, device):  # noqa: ANN001, ANN202
    images = torch.from_numpy(request["images"]).permute(0, 3, 1, 2).float().div(255)
    mean, deviation = (torch.tensor(values)[None, :, None, None] for values in (_MEAN, _DEVIATION))
    images = (images - mean) / deviation
    views = []
    for index in range(len(images)):
        view = {"img": images[index : index + 1].to(device), "data_norm_type": [_NORM]}
        for name, key in (("intrinsics", "intrinsics"), ("camera_to_world", "camera_poses")):
            if name in request:
                view[key] = torch.from_numpy(request[name][index : index + 1]).float().to(device)
        if "camera_poses" in view:
            view["is_metric_scale"] = torch.tensor([True], device=device)
        views.append(view)
    return views


def _stacked(found, key):  # noqa: ANN001, ANN202
    return np.stack([each[key][0].float().cpu().numpy() for each in found])


def _main(request, settings):  # noqa: ANN001, ANN202
    cuda = torch.cuda.is_available() and settings["device"] != "cpu"
    if settings["device"] == "cuda" and not cuda:
        return {"refusal": np.array("device 'cuda' was asked for, and this torch sees none")}
    device = "cuda" if cuda else "cpu"
    start = time.perf_counter()
    models = importlib.import_module("mapanything.models")
    model = models.MapAnything.from_pretrained(settings["weights"]).to(device).eval()
    loaded = time.perf_counter()
    found = model.infer(
        _views(request, device),
        memory_efficient_inference=True,
        use_amp=settings["precision"] == "bf16" or (settings["precision"] == "auto" and cuda),
        amp_dtype="bf16",
        # Masks and filters are the harness's, the same for every source.
        apply_mask=False,
        mask_edges=False,
        apply_confidence_mask=False,
    )
    report = {
        "device": device,
        "torch": torch.__version__,
        "load_s": round(loaded - start, 2),
        "run_s": round(time.perf_counter() - loaded, 2),
    }
    return {
        "depth": _stacked(found, "depth_z")[..., 0],
        "confidence": _stacked(found, "conf"),
        "intrinsics": _stacked(found, "intrinsics"),
        "camera_to_world": _stacked(found, "camera_poses"),
        "report": np.array(json.dumps(report)),
    }


if __name__ == "__main__":
    asked = np.load(sys.argv[1], allow_pickle=False)
    np.savez(sys.argv[2], **_main(asked, json.loads(str(asked["settings"]))))

"""Depth Anything 3 on some pictures: ``python worker.py REQUEST ANSWER``; needs its package.

The request: ``images`` (S, H, W, 3) uint8, perhaps ``intrinsics`` (S, 3, 3) and ``extrinsics``
(S, 4, 4) world-to-camera, and settings ``weights`` (a folder with ``config.json`` and
``model.safetensors``), ``device`` and ``side``. The answer, on the pixels that it worked on:
``depth`` and ``confidence`` (S, h, w), ``intrinsics`` (S, 3, 3), ``extrinsics`` (S, 3, 4).
"""

from __future__ import annotations

import importlib
import json
import sys
import time

import numpy as np
import torch


def _main(request, settings):  # noqa: ANN001, ANN202
    cuda = torch.cuda.is_available() and settings["device"] != "cpu"
    if settings["device"] == "cuda" and not cuda:
        return {"refusal": np.array("device 'cuda' was asked for, and this torch sees none")}
    device = "cuda" if cuda else "cpu"
    start = time.perf_counter()
    api = importlib.import_module("depth_anything_3.api")
    model = api.DepthAnything3.from_pretrained(settings["weights"]).to(device).eval()
    loaded = time.perf_counter()
    given = {
        name: request[name].astype(np.float32)
        for name in ("extrinsics", "intrinsics")
        if name in request
    }
    found = model.inference(
        list(request["images"]),
        **given,
        align_to_input_ext_scale=True,
        process_res=settings["side"],
        process_res_method="upper_bound_resize",
    )
    report = {
        "device": device,
        "torch": torch.__version__,
        "load_s": round(loaded - start, 2),
        "run_s": round(time.perf_counter() - loaded, 2),
    }
    return {
        "depth": np.asarray(found.depth, np.float32),
        "confidence": np.asarray(found.conf, np.float32),
        "intrinsics": np.asarray(found.intrinsics, np.float64),
        "extrinsics": np.asarray(found.extrinsics, np.float64)[:, :3],
        "report": np.array(json.dumps(report)),
    }


if __name__ == "__main__":
    asked = np.load(sys.argv[1], allow_pickle=False)
    np.savez(sys.argv[2], **_main(asked, json.loads(str(asked["settings"]))))

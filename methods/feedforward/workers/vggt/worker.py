"""VGGT on some pictures: ``python worker.py REQUEST ANSWER``; needs torch, numpy and ``vggt``.

The request: ``images`` (S, H, W, 3) uint8, and settings ``weights`` (a safetensors file of the
aggregator, the camera head and the depth head), ``device`` and ``precision``. The answer:
``pose_enc`` (S, 9), ``depth`` and ``confidence`` (S, H, W), as the network has them.
"""

from __future__ import annotations

import contextlib
import importlib
import inspect
import json
import sys
import time

import numpy as np
import torch

_KINDS = {
    "F32": (np.dtype("<f4"), torch.float32),
    "F16": (np.dtype("<f2"), torch.float16),
    "BF16": (np.dtype("<i2"), torch.bfloat16),
}


class _Refused(Exception):
    """Why this cannot be done, for the user."""


def _weights(path):  # noqa: ANN001, ANN202
    """The tensors of a safetensors file by name, from the file's own memory."""
    with open(path, "rb") as stream:  # noqa: PTH123
        length = int.from_bytes(stream.read(8), "little")
        header = json.loads(stream.read(length))
    header.pop("__metadata__", None)
    memory = np.memmap(path, mode="c", dtype=np.uint8, offset=8 + length)
    tensors = {}
    for name, entry in header.items():
        dtype, kind = _KINDS[entry["dtype"]]
        start, end = entry["data_offsets"]
        values = torch.from_numpy(memory[start:end].view(dtype).reshape(entry["shape"]))
        tensors[name] = values.view(kind) if kind is torch.bfloat16 else values
    return tensors


@contextlib.contextmanager
def _without_initial_values():  # noqa: ANN202
    """Parameters keep the memory they get: it is never touched, and the file's takes its place."""
    names = [name for name in dir(torch.nn.init) if name.endswith("_") and name[0] != "_"]
    kept = {name: getattr(torch.nn.init, name) for name in names}
    try:
        for name in names:
            setattr(torch.nn.init, name, lambda tensor, *_, **__: tensor)
        yield
    finally:
        for name, function in kept.items():
            setattr(torch.nn.init, name, function)


def _model(weights, device):  # noqa: ANN001, ANN202
    """The network without the heads that are not asked; its memory is that of the file."""
    module = importlib.import_module("vggt.models.vggt")
    wanted = {"enable_point": False, "enable_track": False}
    known = inspect.signature(module.VGGT.__init__).parameters
    with _without_initial_values():
        model = module.VGGT(**{name: value for name, value in wanted.items() if name in known})
    for head in ("point_head", "track_head"):
        if getattr(model, head, None) is not None:
            setattr(model, head, None)
    for part in ("aggregator", "camera_head", "depth_head"):
        if getattr(model, part, None) is None:
            raise _Refused(f"the vggt package at {module.__file__} has no {part}: it is a fork")
    left = model.load_state_dict(weights, strict=False, assign=True)
    if left.missing_keys or left.unexpected_keys:
        odd = [*left.missing_keys, *left.unexpected_keys]
        raise _Refused(
            f"the vggt package at {module.__file__} is of another network than the weights: "
            f"{len(odd)} names differ, such as {odd[0]}"
        )
    return model.eval().to(device)


def _run(model, images, dtype, device):  # noqa: ANN001, ANN202
    """The three arrays, and a refusal where the package is a fork that means something else."""
    with torch.no_grad(), torch.autocast(device.type, dtype, enabled=dtype != torch.float32):
        found = model.aggregator(images)
    if not isinstance(found, (tuple, list)) or len(found) != 2:
        raise _Refused(
            f"the aggregator of this vggt package returns {len(found)} values and not 2: it is a "
            "fork with another meaning"
        )
    # The heads compute in single precision, as upstream does; only the trunk may be in bfloat16.
    tokens = [None if each is None else each.float() for each in found[0]]
    start = int(found[1])
    with torch.no_grad():
        poses = model.camera_head(tokens)
        depth, confidence = model.depth_head(tokens, images=images, patch_start_idx=start)
    views, height, width = images.shape[1], images.shape[3], images.shape[4]
    shapes = {
        "pose_enc": (poses[-1], (1, views, 9)),
        "depth": (depth, (1, views, height, width, 1)),
        "confidence": (confidence, (1, views, height, width)),
    }
    answer = {}
    for name, (tensor, shape) in shapes.items():
        if tuple(tensor.shape) != shape:
            raise _Refused(f"{name} of this vggt package is {tuple(tensor.shape)}, not {shape}")
        answer[name] = tensor[0].float().cpu().numpy()
    answer["depth"] = answer["depth"][..., 0]
    if answer["confidence"].min() < 1 or answer["depth"].min() <= 0:
        raise _Refused("depths and confidences of this vggt package are not VGGT's: it is a fork")
    return answer


def _main(request, settings):  # noqa: ANN001, ANN202
    cuda = torch.cuda.is_available() and settings["device"] != "cpu"
    if settings["device"] == "cuda" and not cuda:
        raise _Refused("device 'cuda' was asked for, and this torch sees none")
    device = torch.device("cuda" if cuda else "cpu")
    half = settings["precision"] == "bf16" or (settings["precision"] == "auto" and cuda)
    dtype = torch.bfloat16 if half else torch.float32
    start = time.perf_counter()
    model = _model(_weights(settings["weights"]), device)
    loaded = time.perf_counter()
    images = torch.from_numpy(request["images"]).permute(0, 3, 1, 2)[None].float().div(255)
    if cuda:
        torch.cuda.reset_peak_memory_stats()
    answer = _run(model, images.to(device), dtype, device)
    report = {
        "device": str(device),
        "precision": str(dtype).replace("torch.", ""),
        "torch": torch.__version__,
        "load_s": round(loaded - start, 2),
        "run_s": round(time.perf_counter() - loaded, 2),
        "threads": torch.get_num_threads(),
    }
    if cuda:
        report["peak_gpu_mib"] = round(torch.cuda.max_memory_allocated() / 2**20)
    return {**answer, "report": np.array(json.dumps(report))}


if __name__ == "__main__":
    asked = np.load(sys.argv[1], allow_pickle=False)
    try:
        told = _main(asked, json.loads(str(asked["settings"])))
    except _Refused as reason:
        told = {"refusal": np.array(str(reason))}
    np.savez(sys.argv[2], **told)

"""VGGT on some photos, by its public classes, without the heads that nobody asks.

Source: Wang et al., "VGGT: Visual geometry grounded transformer", CVPR 2025.
"""

from __future__ import annotations

import contextlib
import importlib
import inspect
import json
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
import exchange

_PATCH = 14
#: What names of tensors begin with that a file may hold and that are left out.
_UNUSED = ("point_head.", "track_head.")
#: The network's unprojection counts pixels by whole numbers and has the principal point at half the
#: picture; here the middle of the first pixel is at 0.5, so that the point moves by as much.
_HALF_PIXEL = 0.5


def decoded_cameras(encoded, size):  # noqa: ANN001, ANN201
    """Intrinsics (S, 3, 3) and world-to-camera (S, 4, 4) behind pose encodings (S, 9).

    An encoding is the shift (3) and the quaternion x, y, z, w of world-to-camera in OpenCV's axes,
    then the vertical and the horizontal field of view, radians. ``size`` is width and height.
    """
    encoded = np.asarray(encoded, dtype=np.float64)
    length, fields = np.linalg.norm(encoded[:, 3:7], axis=1), encoded[:, 7:9]
    good = np.isfinite(encoded).all(axis=1) & (length > 0)
    good &= ((fields > 0) & (fields < np.pi)).all(axis=1)
    if not good.all():
        exchange.refuse(
            f"the network found no camera for photo {np.argmin(good) + 1} of {len(encoded)}: a "
            "rotation, and fields of view between 0 and 180 degrees, are needed"
        )
    intrinsics, moves = np.zeros((len(encoded), 3, 3)), np.tile(np.eye(4), (len(encoded), 1, 1))
    for K, move, row, norm in zip(intrinsics, moves, encoded, length):  # noqa: B905 - Python 3.8
        x, y, z, w = row[3:7] / norm
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        move[:3, :3] = np.eye(3) + 2.0 * w * cross + 2.0 * cross @ cross
        move[:3, 3] = row[:3]
        focal = np.array(size) / 2.0 / np.tan(row[[8, 7]] / 2.0)
        K[0, 0], K[1, 1], K[2, 2] = *focal, 1.0
        K[:2, 2] = np.array(size) / 2.0 + _HALF_PIXEL
    return intrinsics, moves


def weights_of(path: Path):  # noqa: ANN201
    """The tensors of a file by name, from the file's own memory; nothing that it names is run."""
    import torch

    if path.suffix != ".safetensors":
        try:
            return torch.load(path, map_location="cpu", weights_only=True, mmap=True)
        except Exception as error:  # noqa: BLE001 - torch raises what it likes
            exchange.refuse(f"{path} is not a checkpoint of tensors: {str(error).splitlines()[0]}")
    kinds = {"F32": ("<f4", torch.float32), "F16": ("<f2", torch.float16)}
    kinds["BF16"] = ("<i2", torch.bfloat16)
    with path.open("rb") as stream:
        length = int.from_bytes(stream.read(8), "little")
        header = json.loads(stream.read(length))
    header.pop("__metadata__", None)
    memory = np.memmap(path, mode="c", dtype=np.uint8, offset=8 + length)
    tensors = {}
    for name, entry in header.items():
        dtype, kind = kinds[entry["dtype"]]
        start, end = entry["data_offsets"]
        values = torch.from_numpy(memory[start:end].view(dtype).reshape(entry["shape"]))
        tensors[name] = values.view(kind) if kind is torch.bfloat16 else values
    return tensors


@contextlib.contextmanager
def _without_initial_values():  # noqa: ANN202
    """Parameters keep the memory they get: it is never touched, and the file's takes its place."""
    import torch

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
            exchange.refuse(f"the vggt package at {module.__file__} has no {part}: it is a fork")
    used = {name: value for name, value in weights.items() if not name.startswith(_UNUSED)}
    try:
        left = model.load_state_dict(used, strict=False, assign=True)
        odd = [*left.missing_keys, *left.unexpected_keys]
    except RuntimeError as error:
        odd = [str(error).splitlines()[-1].strip()]
    if odd:
        exchange.refuse(
            f"the vggt package at {module.__file__} is of another network than the weights: "
            f"{len(odd)} names differ, such as {odd[0]}"
        )
    return model.eval().to(device)


def answered(images, weights: Path, device: str, precision: str):  # noqa: ANN001, ANN201
    """``pose_enc`` (S, 9), ``depth`` and ``confidence`` (S, H, W) of pictures (S, H, W, 3) uint8.

    A package that is a fork and means something else is refused. The second value is a report.
    """
    import torch

    if precision not in ("auto", "fp32", "bf16"):
        exchange.refuse(f"network.precision must be auto, fp32 or bf16, not '{precision}'")
    device = exchange.device_of(device, torch)
    half = precision == "bf16" or (precision == "auto" and device == "cuda")
    dtype = torch.bfloat16 if half else torch.float32
    start = time.perf_counter()
    model = _model(weights_of(weights), device)
    loaded = time.perf_counter()
    images = torch.from_numpy(images).permute(0, 3, 1, 2)[None].float().div(255).to(device)
    with torch.no_grad(), torch.autocast(device, dtype, enabled=half):
        found = model.aggregator(images)
    if not isinstance(found, (tuple, list)) or len(found) != 2:
        exchange.refuse(
            f"the aggregator of this vggt package returns {len(found)} values and not 2: it is a "
            "fork with another meaning"
        )
    # The heads compute in single precision, as upstream does; only the trunk may be in bfloat16.
    tokens = [None if each is None else each.float() for each in found[0]]
    with torch.no_grad():
        poses = model.camera_head(tokens)
        depth, confidence = model.depth_head(tokens, images=images, patch_start_idx=int(found[1]))
    report = {
        **exchange.costs(device, torch, start, loaded),
        "precision": str(dtype).replace("torch.", ""),
        "picture_px": list(images.shape[:2:-1]),
    }
    return _checked(poses[-1], depth, confidence, images.shape), report


def _checked(poses, depth, confidence, shape):  # noqa: ANN001, ANN202
    """The arrays, if they are what VGGT gives."""
    views, (height, width) = shape[1], shape[3:]
    expected = {
        "pose_enc": (poses, (1, views, 9)),
        "depth": (depth, (1, views, height, width, 1)),
        "confidence": (confidence, (1, views, height, width)),
    }
    answer = {}
    for name, (tensor, size) in expected.items():
        if tuple(tensor.shape) != size:
            exchange.refuse(f"{name} of this vggt package is {tuple(tensor.shape)}, not {size}")
        answer[name] = tensor[0].float().cpu().numpy()
    answer["depth"] = answer["depth"][..., 0]
    if answer["confidence"].min() < 1 or answer["depth"].min() <= 0:
        exchange.refuse("depths and confidences of this vggt package are not VGGT's: it is a fork")
    return answer


def main() -> None:
    """Read the folder, write depth and cameras."""
    asked = exchange.arguments("weights", "side", "fit", "background", "device", "precision")
    photos = exchange.read_photos(asked.photos)
    shown = exchange.fitted_all(photos, int(asked.side), _PATCH, asked.fit, int(asked.background))
    images = np.stack([each.picture for each in shown])
    found, report = answered(images, Path(asked.weights), asked.device, asked.precision)
    intrinsics, moves = decoded_cameras(found["pose_enc"], images.shape[2:0:-1])
    arrays = {
        "depth": found["depth"],
        "confidence": found["confidence"],
        "intrinsics": intrinsics,
        "world_to_camera": moves,
    }
    exchange.write_depth(asked.out, arrays, report, shown)


if __name__ == "__main__":
    main()

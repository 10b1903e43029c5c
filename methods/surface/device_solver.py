"""The conjugate gradients of ``lattice`` on a torch device, for maps of many pixels and a GPU."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import csr_array, dia_array

from harness.core.arrays import Singles
from harness.core.errors import MissingPart
from methods.surface.reduced_system import ReducedSystem

if TYPE_CHECKING:
    import torch

# Reading the residual back stalls the device; a few steps too many cost less.
_STEPS_BETWEEN_READINGS = 8


def require_device(device: str) -> None:
    """Refuse a device that torch cannot compute on here.

    Raises:
        MissingPart: this machine has no such device.
    """
    import torch

    name, _, index = device.partition(":")
    if name == "cuda" and int(index or 0) >= torch.cuda.device_count():
        raise MissingPart(
            "normals cannot be integrated on the GPU",
            expected=f"a device '{device}' that torch can use",
            got=f"{torch.cuda.device_count()} GPUs",
            hint="Choose the device 'cpu': --set surface.device=cpu",
        )


def conjugate_gradients_on(device: str, system: ReducedSystem) -> tuple[Singles, int]:
    """The system's solution (N,) and the steps taken.

    The arithmetic is that of the processor's version, the order of the sums is not.

    Raises:
        MissingPart: this machine has no such device.
    """
    import torch

    require_device(device)
    left, right = _on_device(system.from_black, device), _on_device(system.from_red, device)
    remaining = torch.from_numpy(system.residual.copy()).to(device)
    weights = torch.from_numpy(system.unscale).to(device)
    tiny = torch.tensor(torch.finfo(torch.float32).tiny, device=device)
    solution, direction = torch.zeros_like(remaining), remaining.clone()
    squared = torch.dot(remaining, remaining)
    steps = 0
    for steps in range(system.max_steps + 1):
        reading = steps % _STEPS_BETWEEN_READINGS == 0
        if steps == system.max_steps:
            break
        if reading and float((weights * remaining).norm()) <= system.limit:
            break
        product = direction - left @ (right @ direction)
        # Once nothing remains, both quotients have to stay finite until the next reading.
        length = squared / torch.maximum(torch.dot(direction, product), tiny)
        solution += length * direction
        remaining -= length * product
        previous, squared = squared, torch.dot(remaining, remaining)
        direction = remaining + (squared / torch.maximum(previous, tiny)) * direction
    return solution.cpu().numpy(), steps


def _on_device(operator: dia_array, device: str) -> torch.Tensor:
    import torch

    rows = csr_array(operator, dtype=np.float32)
    with warnings.catch_warnings():
        # torch calls its CSR tensors beta; the product with a vector is all that is used.
        warnings.filterwarnings("ignore", message="Sparse", category=UserWarning)
        return torch.sparse_csr_tensor(
            torch.from_numpy(rows.indptr.astype(np.int32)),
            torch.from_numpy(rows.indices.astype(np.int32)),
            torch.from_numpy(rows.data),
            size=rows.shape,
        ).to(device)

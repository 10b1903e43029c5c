"""Warp, started without a word, and arrays in its memory."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import warp as wp

_DEVICE = "cpu"


def _started() -> None:
    """Start Warp without a word: it would tell on standard error that there is no GPU driver."""
    wp.config.log_level = wp.LOG_ERROR
    kept, nothing = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nothing, 2)
        wp.init()
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nothing)


_started()


def device_array(values: Any, kind: Any) -> Any:
    """A copy of an array in Warp's memory, as single precision, integers or vectors."""
    plain = np.int32 if kind in (wp.int32, wp.vec2i) else np.float32
    return wp.array(np.ascontiguousarray(values, dtype=plain), dtype=kind, device=_DEVICE)


def launch(kernel: Any, count: int, arguments: list[Any]) -> None:
    """Run a kernel for each of ``count`` indices, in order, on the thread that calls."""
    wp.launch(kernel, dim=count, inputs=arguments, device=_DEVICE)

"""Networks are run by onnxruntime: on the processor, or on a GPU where its build has one."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.core.errors import DataError, MethodError
from harness.core.missing import not_installed

_CPU, _CUDA = "CPUExecutionProvider", "CUDAExecutionProvider"


def open_session(path: Path, *, gpu: bool = False) -> Any:
    """The network in an ONNX file, ready to run on all cores that this process is given.

    Args:
        path: The file.
        gpu: Whether to use a GPU if onnxruntime was built for one; it rounds in another way.

    Raises:
        MissingPart: onnxruntime is not installed.
        DataError: not a network that can be run.
    """
    try:
        import onnxruntime
    except ImportError as error:
        raise not_installed("onnxruntime", "running a network") from error
    options = onnxruntime.SessionOptions()
    # Else the working memory of the largest run stays taken for as long as the network is kept.
    options.enable_cpu_mem_arena = False
    if hasattr(os, "sched_getaffinity"):  # on Linux
        # Otherwise onnxruntime counts cores that this process is not given and pins threads there.
        options.intra_op_num_threads = len(os.sched_getaffinity(0))
    on_gpu = gpu and _CUDA in onnxruntime.get_available_providers()
    providers = [_CUDA, _CPU] if on_gpu else [_CPU]
    try:
        return onnxruntime.InferenceSession(str(path), options, providers=providers)
    except Exception as error:  # onnxruntime has no public base of its errors
        raise DataError(f"{path} is not a network that can be run", got=str(error)) from error


def answers(
    session: Any, what: str, inputs: Mapping[str, NDArray[np.float32]]
) -> list[NDArray[np.float32]]:
    """All outputs of a network.

    Args:
        session: From ``open_session``.
        what: The network, for the message.
        inputs: By name.

    Raises:
        MethodError: it cannot work on these inputs.
    """
    try:
        found: list[NDArray[np.float32]] = session.run(None, dict(inputs))
    except Exception as error:  # onnxruntime has no public base of its errors
        raise MethodError(f"{what} cannot be run", got=str(error)) from error
    return found

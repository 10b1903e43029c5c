"""Networks are run by onnxruntime: on the processor, or on a GPU where its build has one."""

import functools
import hashlib
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.core.errors import DataError, MethodError
from harness.core.files.hashing import file_sha256
from harness.core.files.names import named_path
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


def network_sha256(path: Path) -> str:
    """The sha256 of all that a network consists of.

    It is that of the network's file or, where there are several, that of the list of their hashes.

    Raises:
        DataError: not an ONNX file, or one of its files is not there or outside its folder.
        MissingPart: onnx is not installed.
    """
    sums = [file_sha256(file) for file in _files(path)]
    if len(sums) == 1:
        return sums[0]
    return hashlib.sha256("\n".join(sums).encode()).hexdigest()


def read_network(path: Path) -> Any:
    """The model in an ONNX file, with its weights, as the package onnx has it.

    Raises:
        DataError: not an ONNX file, or weights outside its folder.
        MissingPart: onnx is not installed.
    """
    try:
        import onnx
    except ImportError as error:
        raise not_installed("onnx", "reading a network") from error
    try:
        onnx.load(path, load_external_data=False)
        _files(path)
        return onnx.load(path)
    except DataError:
        raise
    except Exception as error:  # protobuf's errors have no public base
        raise DataError(f"{path} is not an ONNX network", got=str(error)) from error


def network_stamp(path: Path) -> tuple[tuple[int, int], ...]:
    """Another one when one of a network's files may have changed.

    Raises:
        DataError, MissingPart: as ``network_sha256``.
    """
    return tuple(_stamp(file) for file in _files(path))


def _files(path: Path) -> tuple[Path, ...]:
    """The network's file, and those beside it, all of which are there."""
    beside = _beside(path, *_stamp(path))
    for file in beside:
        if not file.is_file():
            raise DataError(f"{path} is not whole", expected=f"its weights in {file}")
    return (path, *beside)


def _stamp(path: Path) -> tuple[int, int]:
    found = path.stat()
    return found.st_mtime_ns, found.st_size


@functools.lru_cache(maxsize=8)
def _beside(path: Path, _changed_ns: int, _size: int) -> tuple[Path, ...]:
    """The other files that hold a network's weights, in order."""
    try:
        import onnx
    except ImportError as error:
        raise not_installed("onnx", "reading a network") from error
    try:
        model = onnx.load(path, load_external_data=False)
    except Exception as error:  # protobuf's errors have no public base
        raise DataError(f"{path} is not a network that can be run", got=str(error)) from error
    names = {name for part in (model.graph, *model.functions) for name in _locations(part)}
    return tuple(named_path(path, name) for name in sorted(names))


def _locations(graph: Any) -> Iterator[str]:
    """Where the tensors of a graph or function, and of the graphs in it, have their values."""
    tensors = [*getattr(graph, "initializer", ())]
    for sparse in getattr(graph, "sparse_initializer", ()):
        tensors += [sparse.values, sparse.indices]
    for attribute in (each for node in graph.node for each in node.attribute):
        tensors += [attribute.t, *attribute.tensors]
        for inner in (attribute.g, *attribute.graphs):
            if inner.node or inner.initializer:
                yield from _locations(inner)
    for tensor in tensors:
        yield from (entry.value for entry in tensor.external_data if entry.key == "location")

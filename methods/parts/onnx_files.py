"""The files of an ONNX network: a large one keeps its weights in others beside it."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from harness.core.errors import DataError
from harness.core.files.hashing import file_sha256
from harness.core.files.reach import named_path
from harness.core.missing import not_installed


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

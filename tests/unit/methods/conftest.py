"""Numbers that fill networks by a rule, so that golden vectors need no licensed weight."""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
import torch

Shapes = Mapping[str, tuple[int, ...]]


def _wave(key: str, shape: tuple[int, ...], gain: float) -> np.ndarray:
    """Sines of a phase that the name gives; matrices of rank 2."""
    place = np.arange(math.prod(shape), dtype=np.float64)
    values = np.sin(0.7390851332 * place + zlib.crc32(key.encode()) % 10007).reshape(shape)
    scale = 3.0 / math.sqrt(math.prod(shape[1:])) if len(shape) > 1 else 0.1
    return (gain * scale * values).astype(np.float32)


def _hash(key: str, shape: tuple[int, ...], gain: float) -> np.ndarray:
    """A hash of the place and the name, evenly spread; matrices of full rank."""
    place = np.arange(1, math.prod(shape) + 1, dtype=np.uint64)
    mixed = ((place * 2654435761 + zlib.crc32(key.encode())) & 0xFFFFFFFF).astype(np.uint32)
    for shift, factor in ((16, 0x85EBCA6B), (13, 0xC2B2AE35)):
        mixed ^= mixed >> shift
        mixed *= np.uint32(factor)
    mixed ^= mixed >> 16
    spread = (mixed / 2.0**31 - 1.0).reshape(shape)
    if len(shape) > 1:
        values = gain * math.sqrt(3.0) * spread / math.sqrt(math.prod(shape[1:]))
    elif key.endswith(("weight", "gamma", "running_var", "temperature")):
        values = 1.0 + 0.1 * spread
    else:
        values = 0.1 * spread
    return values.astype(np.float32)


RULES = {"wave": _wave, "hash": _hash}


@pytest.fixture(scope="session")
def fill() -> Callable[..., dict[str, np.ndarray]]:
    """``fill(shapes, rule, gain)``: the numbers of all tensors by name; ``wave`` or ``hash``."""

    def numbers(shapes: Shapes, rule: str = "hash", gain: float = 1.0) -> dict[str, np.ndarray]:
        return {key: RULES[rule](key, tuple(shape), gain) for key, shape in shapes.items()}

    return numbers


@pytest.fixture(scope="session")
def save_checkpoint() -> Callable[..., Path]:
    """``save_checkpoint(path, numbers, *place)``: a file of ``torch.save``, as Lightning has it."""

    def save(path: Path, numbers: Mapping[str, np.ndarray], *place: str, **beside) -> Path:
        content: object = {key: torch.from_numpy(value) for key, value in numbers.items()}
        for key in reversed(place):
            content = {key: content, **beside}
        torch.save(content, path)
        return path

    return save


@pytest.fixture(scope="session")
def reference() -> Callable[[str], Path]:
    """``reference("golden_ifnet.npz")``: a file beside the checkout, or the test is skipped."""

    def find(name: str) -> Path:
        for folder in Path(__file__).parents:
            for inside in ("data", "facts"):
                if (folder / "shared" / inside / name).is_file():
                    return folder / "shared" / inside / name
        pytest.skip(f"{name} is not here")

    return find


@pytest.fixture
def parts(tmp_path, monkeypatch) -> Path:
    """The user's own folder of parts, which need not exist."""
    monkeypatch.setenv("HARNESS_PARTS", str(tmp_path / "parts"))
    monkeypatch.setenv("HARNESS_WEIGHTS", str(tmp_path / "weights"))
    return tmp_path / "parts"

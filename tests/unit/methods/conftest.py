"""Numbers that fill networks by a rule, so that golden vectors need no licensed weight."""

from __future__ import annotations

import functools
import math
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
import torch

from harness.core.mesh import Mesh

Shapes = Mapping[str, tuple[int, ...]]


#: Numbers that are worked out at once: they stay in the processor's cache.
AT_ONCE = 1 << 16
STEP_RAD = 0.7390851332


@functools.cache
def _turns() -> tuple[np.ndarray, np.ndarray]:
    """Sines and cosines (AT_ONCE,) of the steps from 0 on."""
    angles = STEP_RAD * np.arange(AT_ONCE, dtype=np.float64)
    return np.sin(angles), np.cos(angles)


def _wave(key: str, shape: tuple[int, ...], gain: float) -> np.ndarray:
    """Sines of a phase that the name gives; matrices of rank 2."""
    scale = 3.0 / math.sqrt(math.prod(shape[1:])) if len(shape) > 1 else 0.1
    values = np.empty(math.prod(shape), np.float32)
    sines, cosines = _turns()
    for start in range(0, len(values), AT_ONCE):
        part = values[start : start + AT_ONCE]
        # The sine of a sum: some hundred million sines would take most of the time.
        begin = STEP_RAD * start + zlib.crc32(key.encode()) % 10007
        of_cosine, of_sine = (gain * scale * each(begin) for each in (math.sin, math.cos))
        part[:] = of_cosine * cosines[: len(part)] + of_sine * sines[: len(part)]
    return values.reshape(shape)


def _hash(key: str, shape: tuple[int, ...], gain: float) -> np.ndarray:
    """A hash of the place and the name, evenly spread; matrices of full rank."""
    values = np.empty(math.prod(shape), np.float32)
    for start in range(0, len(values), AT_ONCE):
        part = values[start : start + AT_ONCE]
        spread = _spread(zlib.crc32(key.encode()), start, len(part))
        if len(shape) > 1:
            part[:] = gain * math.sqrt(3.0) * spread / math.sqrt(math.prod(shape[1:]))
        elif key.endswith(("weight", "gamma", "running_var", "temperature")):
            part[:] = 1.0 + 0.1 * spread
        else:
            part[:] = 0.1 * spread
    return values.reshape(shape)


def _spread(seed: int, start: int, count: int) -> np.ndarray:
    """(count,) numbers between -1 and 1, of the places from ``start`` on."""
    mixed = np.arange(start + 1, start + count + 1, dtype=np.uint32)
    mixed *= np.uint32(2654435761)  # whole numbers that wrap around at 2^32
    mixed += np.uint32(seed)
    for shift, factor in ((16, 0x85EBCA6B), (13, 0xC2B2AE35)):
        mixed ^= mixed >> shift
        mixed *= np.uint32(factor)
    mixed ^= mixed >> 16
    return mixed / 2.0**31 - 1.0


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


@pytest.fixture(scope="session")
def ball() -> Mesh:
    """A unit sphere, outward, edges of about 0.07."""
    polar, around = np.linspace(0, np.pi, 49)[1:-1], np.arange(72) * 2 * np.pi / 72
    v, u = np.meshgrid(polar, around, indexing="ij")
    ring = np.stack([np.sin(v) * np.sin(u), np.cos(v), np.sin(v) * np.cos(u)], -1)
    points = np.concatenate([ring.reshape(-1, 3), [[0, 1, 0], [0, -1, 0]]])
    index = np.arange(47 * 72).reshape(47, 72)
    right = np.roll(index, -1, axis=1)
    a, b, c, d = (part.ravel() for part in (index[:-1], index[1:], right[1:], right[:-1]))
    top, low = (np.full(72, len(points) - k) for k in (2, 1))
    caps = [np.stack([top, index[0], right[0]], 1), np.stack([low, right[-1], index[-1]], 1)]
    return Mesh(points, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1), *caps]))

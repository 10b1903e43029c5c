"""Freed memory goes back to the system."""

from __future__ import annotations

import ctypes
import subprocess
import sys

import psutil
import pytest

from harness.core.process.freed_memory import give_freed_memory_back

_BLOCK, _BLOCKS = 60_000, 4_000


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "malloc_trim"), reason="not the GNU C library")
def test_what_was_freed_is_no_longer_resident() -> None:
    process = psutil.Process()
    blocks = [b"x" * _BLOCK for _ in range(_BLOCKS)]
    # A block at the end keeps the library from giving the rest back by itself.
    last = b"x" * _BLOCK
    held = process.memory_info().rss
    del blocks
    give_freed_memory_back()
    assert held - process.memory_info().rss > 0.5 * _BLOCK * _BLOCKS
    assert len(last) == _BLOCK


_LARGE_ARRAYS = """
import sys, psutil
from harness.core.process.freed_memory import keep_no_large_blocks
if sys.argv[1] == "called":
    keep_no_large_blocks()
# Freeing it teaches the library to keep blocks of up to its size.
teacher = b"x" * (24 * 2**20)
del teacher
blocks = [b"x" * (8 * 2**20) for _ in range(20)]
last = [b"x" * 100_000 for _ in range(20)]
process = psutil.Process()
held = process.memory_info().rss
del blocks
print((held - process.memory_info().rss) / (160 * 2**20))
"""


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "mallopt"), reason="not the GNU C library")
@pytest.mark.parametrize(("called", "least", "most"), [("called", 0.9, 1.1), ("not", -0.1, 0.5)])
def test_large_arrays_are_given_back_as_soon_as_they_are_freed(
    called: str, least: float, most: float
) -> None:
    command = [sys.executable, "-c", _LARGE_ARRAYS, called]
    given_back = float(subprocess.run(command, capture_output=True, check=True, text=True).stdout)
    assert least < given_back < most

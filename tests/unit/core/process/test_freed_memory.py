"""Freed memory goes back to the system."""

from __future__ import annotations

import ctypes

import psutil
import pytest

from harness.core.process.threads import give_freed_memory_back

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

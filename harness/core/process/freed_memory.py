"""Memory that was freed, given back to the system."""

from __future__ import annotations

import ctypes
import gc
import sys


def give_freed_memory_back() -> None:
    """Let the system have what this process has freed but still holds.

    The GNU C library keeps freed memory for later requests of the same sizes; after a library has
    been closed these never come. Nothing happens with other C libraries.
    """
    gc.collect()
    if sys.platform == "linux":
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
        if trim is not None:
            trim(0)

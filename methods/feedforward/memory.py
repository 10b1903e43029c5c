"""What a network of this size takes, said before its weights are loaded."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import psutil

from harness.core.errors import MethodError

_GIB = 2**30
#: What Python, torch and the pictures take.
_BASE_BYTES = 1.0 * _GIB
#: The depth head works on eight pictures at a time, at full size with 128 channels, several copies.
_HEAD_PICTURES, _HEAD_BYTES_PER_PIXEL = 8, 128 * 4 * 3
_CGROUP = Path("/sys/fs/cgroup")


@dataclass(frozen=True, slots=True)
class NetworkSize:
    """A network, as far as its memory goes.

    Attributes:
        weights_bytes: Its file.
        width: Numbers for each patch that every block hands on.
        blocks: How many do.
        patch: Side of a patch, pixels.
    """

    weights_bytes: int
    width: int = 2048
    blocks: int = 24
    patch: int = 14

    def needed_bytes(self, views: int, size: tuple[int, int]) -> int:
        """About what a run in single precision takes beyond nothing at all, bytes.

        Args:
            views: Number of pictures.
            size: Their width and height, pixels.
        """
        tokens = (size[0] // self.patch) * (size[1] // self.patch) + 5
        handed_on = 4.0 * views * tokens * self.width * self.blocks
        head = min(views, _HEAD_PICTURES) * size[0] * size[1] * _HEAD_BYTES_PER_PIXEL
        return int(self.weights_bytes + handed_on + head + _BASE_BYTES)


def available_bytes() -> int:
    """What this process may still take: of the machine, and of the container it runs in."""
    free = int(psutil.virtual_memory().available)
    try:
        most = (_CGROUP / "memory.max").read_text().strip()
        used = int((_CGROUP / "memory.current").read_text())
        # What the kernel caches of files counts as used, and is given back when it is wanted.
        statistics = (_CGROUP / "memory.stat").read_text().split()
        cached = int(statistics[statistics.index("inactive_file") + 1])
        return free if most == "max" else min(free, int(most) - used + cached)
    except (OSError, ValueError, IndexError):
        return free


def require_memory(name: str, needed: int) -> None:
    """Nothing, if there is enough memory.

    Raises:
        MethodError: there is not, with both numbers.
    """
    free = available_bytes()
    if free < needed:
        raise MethodError(
            f"this machine cannot hold '{name}'",
            expected=f"about {needed / _GIB:.1f} GiB of free memory",
            got=f"{free / _GIB:.1f} GiB",
            hint="End other programs, take fewer views, a smaller 'side', or a larger machine",
        )

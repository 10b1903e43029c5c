"""Whether locks in a folder reach all machines that see it: what its mount says, and a probe."""

from __future__ import annotations

import fcntl
import itertools
import platform
import re
import time
import uuid
from dataclasses import dataclass
from pathlib import Path

from harness.core.errors import DataError
from harness.core.files.atomic import read_json, write_json
from harness.core.process.interrupts import require_not_stopped
from harness.core.typed_json import from_json

_MOUNTS = Path("/proc/self/mounts")
_OCTAL = re.compile(r"\\([0-7]{3})")
#: Kinds of network file systems, and options with which their locks stay on one machine.
_NETWORK = {
    "nfs": ("nolock", "local_lock=flock", "local_lock=all"),
    "nfs4": ("nolock", "local_lock=flock", "local_lock=all"),
    "lustre": ("localflock", "noflock"),
    "cifs": ("nobrl",),
    "smb3": ("nobrl",),
}
#: Kinds whose locks are this machine's whatever their options say.
_ALWAYS_LOCAL = ("fuse.sshfs",)
_PROBE = ".lock-probe"
_POLL_S = 0.2
#: How long a side that has met the other stays. Network file systems show changes with a delay.
_STAY_S = 5.0


@dataclass(frozen=True, slots=True)
class Mount:
    """A file system that is in use.

    Attributes:
        place: The folder that it is mounted on.
        kind: Such as ``nfs4``.
        options: How it is mounted.
    """

    place: Path
    kind: str
    options: tuple[str, ...]


def mount_of(folder: Path, mounts: Path = _MOUNTS) -> Mount | None:
    """The file system that a folder is on, or will be; None where the system does not say."""
    try:
        lines = mounts.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return None
    found: Mount | None = None
    for words in map(str.split, lines):
        if len(words) < 4:
            continue
        # Blanks in a path are written as octal numbers.
        place = Path(_OCTAL.sub(lambda found: chr(int(found[1], 8)), words[1]))
        is_longer = found is None or len(place.parts) >= len(found.place.parts)
        if folder.resolve().is_relative_to(place) and is_longer:
            found = Mount(place, words[2], tuple(words[3].split(",")))
    return found


def host_local_locks(mount: Mount) -> str:
    """Why locks on a file system do not reach other machines; empty where they should.

    A file system of this machine's own disks gives an empty text, too: no other machine sees it.
    """
    if mount.kind in _ALWAYS_LOCAL:
        return f"{mount.kind} keeps locks on each machine"
    wrong = [option for option in _NETWORK.get(mount.kind, ()) if option in mount.options]
    return f"{mount.kind} with {', '.join(wrong)} keeps locks on each machine" if wrong else ""


@dataclass(frozen=True, slots=True)
class LockProbe:
    """What two machines found.

    Attributes:
        works: Whether one was kept out while the other held the lock; None where no other came.
        other: The other machine.
    """

    works: bool | None
    other: str = ""


def probe_locks(folder: Path, wait_s: float) -> LockProbe:
    """Hold a lock in a folder, or be kept out by another machine that does.

    Run it on two machines at about the same time. One of them gets the lock and holds it until it
    sees the other, which must have been kept out.

    Args:
        folder: That both see.
        wait_s: How long the one that holds the lock waits for the other, seconds.
    """
    place = folder / _PROBE
    place.mkdir(parents=True, exist_ok=True)
    own = place / f"{uuid.uuid4().hex}.json"
    with (place / ".lock").open("a") as stream:
        holds = True
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holds = False
        try:
            return _Meeting(place, own, holds).found(wait_s)
        finally:
            own.unlink(missing_ok=True)


@dataclass(frozen=True, slots=True)
class _Meeting:
    """One machine's side of a probe.

    Attributes:
        place: The folder of the probe.
        own: The file in which this side shows that it is there.
        holds: Whether this side got the lock.
    """

    place: Path
    own: Path
    holds: bool

    def found(self, wait_s: float) -> LockProbe:
        """What came of meeting another side, or of waiting for one."""
        end = time.monotonic() + wait_s
        seen: dict[str, int] = {}
        result = LockProbe(None)
        for beat in itertools.count():
            require_not_stopped()
            write_json(self.own, {"host": platform.node(), "holds": self.holds, "beat": beat})
            others = self._others(seen)
            if others and result.works is None:
                # The lock does what it should if one of the two was kept out by it. The other side
                # is given time to see this one.
                result = LockProbe(self.holds != others[0].holds, others[0].host)
                end = time.monotonic() + _STAY_S
            if time.monotonic() >= end:
                break
            time.sleep(_POLL_S)
        return result

    def _others(self, seen: dict[str, int]) -> list[_Side]:
        """Sides that are alive: those whose beat has changed since it was last read."""
        found: list[_Side] = []
        for path in sorted(self.place.glob("*.json")):
            if path == self.own:
                continue
            try:
                side = from_json(_Side, read_json(path), path, "a side of a lock probe")
            except DataError:
                continue  # it has ended meanwhile
            if seen.setdefault(path.name, side.beat) != side.beat:
                found.append(side)
        return found


@dataclass(frozen=True, slots=True)
class _Side:
    host: str
    holds: bool
    beat: int

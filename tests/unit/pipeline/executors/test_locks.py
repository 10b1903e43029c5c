"""What a mount says of its locks, and two sides of a probe."""

from __future__ import annotations

import fcntl
import json
import platform
import threading
from pathlib import Path

import pytest

from harness.run import locks
from harness.run.locks import LockProbe, Mount, host_local_locks, probe_locks

MOUNTS = """\
/dev/vda / ext4 rw,relatime 0 0
server:/nodes /nodes nfs4 rw,vers=4.2,local_lock=none 0 0
server:data /nodes/shared\\040data nfs rw,vers=3,local_lock=flock 0 0
tmpfs /nodes/a/fast tmpfs rw 0 0
"""


@pytest.mark.parametrize(
    ("folder", "kind"),
    [("/data", "ext4"), ("/nodes/a/runs", "nfs4"), ("/nodes/shared data/ws", "nfs"),
     ("/nodes/a/fast/x", "tmpfs"), ("/nodesx", "ext4")],
)  # fmt: skip
def test_a_folder_is_on_the_mount_nearest_to_it(tmp_path: Path, folder: str, kind: str) -> None:
    (tmp_path / "mounts").write_text(MOUNTS)

    found = locks.mount_of(Path(folder), tmp_path / "mounts")

    assert found is not None
    assert found.kind == kind


@pytest.mark.parametrize(
    ("kind", "options", "found"),
    [
        ("ext4", "rw", ""),
        ("nfs4", "rw,local_lock=none", ""),
        ("nfs", "rw,local_lock=flock", "nfs with local_lock=flock keeps locks on each machine"),
        ("nfs", "rw,nolock", "nfs with nolock keeps locks on each machine"),
        ("lustre", "rw,localflock", "lustre with localflock keeps locks on each machine"),
        ("fuse.sshfs", "rw", "fuse.sshfs keeps locks on each machine"),
    ],
)
def test_locks_that_stay_on_one_machine_are_seen(kind: str, options: str, found: str) -> None:
    assert host_local_locks(Mount(Path("/x"), kind, tuple(options.split(",")))) == found


def two_sides(folder: Path) -> list[LockProbe]:
    found: list[LockProbe] = []
    sides = [
        threading.Thread(target=lambda: found.append(probe_locks(folder, 10.0))) for _ in range(2)
    ]
    for side in sides:
        side.start()
    for side in sides:
        side.join()
    return found


@pytest.mark.parametrize("works", [True, False])
def test_two_sides_agree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, works: bool) -> None:
    monkeypatch.setattr(locks, "_POLL_S", 0.02)
    monkeypatch.setattr(locks, "_STAY_S", 0.3)
    if not works:
        # As on a file system that keeps locks on one machine: both get it.
        monkeypatch.setattr(fcntl, "flock", lambda *arguments: None)

    found = two_sides(tmp_path)

    assert found == [LockProbe(works, platform.node())] * 2
    assert list((tmp_path / ".lock-probe").glob("*.json")) == []


def test_nobody_else_and_what_a_killed_probe_left_say_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(locks, "_POLL_S", 0.02)
    (tmp_path / ".lock-probe").mkdir()
    left = {"host": "gone", "holds": True, "beat": 3}
    (tmp_path / ".lock-probe" / "0.json").write_text(json.dumps(left))

    assert probe_locks(tmp_path, 0.3) == LockProbe(None)


def test_mounts_are_found_by_names_in_any_script(tmp_path):
    folder = tmp_path / "Données 3"
    folder.mkdir()
    written = str(folder).replace(" ", "\\040")
    mounts = tmp_path / "mounts"
    mounts.write_text(f"disk / ext4 rw 0 0\nserver {written} nfs4 rw,nolock 0 0\n")
    found = locks.mount_of(folder / "runs", mounts)
    assert found is not None
    assert (found.place, found.kind) == (folder, "nfs4")

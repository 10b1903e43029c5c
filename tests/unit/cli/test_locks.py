"""What a mount says of its locks."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.cli.doctor import Mount, host_local_locks, mount_of

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

    found = mount_of(Path(folder), tmp_path / "mounts")

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


def test_mounts_are_found_by_names_in_any_script(tmp_path):
    folder = tmp_path / "Données 3"
    folder.mkdir()
    written = str(folder).replace(" ", "\\040")
    mounts = tmp_path / "mounts"
    mounts.write_text(f"disk / ext4 rw 0 0\nserver {written} nfs4 rw,nolock 0 0\n")
    found = mount_of(folder / "runs", mounts)
    assert found is not None
    assert (found.place, found.kind) == (folder, "nfs4")

"""Writing is all or nothing: nothing is left behind, and inputs are not blamed on the output."""

from __future__ import annotations

import errno
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from harness.core.errors import DataError
from harness.core.files.atomic import (
    atomic_directory,
    atomic_path,
    read_json,
    write_json,
    write_text,
)


def names(folder: Path) -> list[str]:
    return sorted(file.name for file in folder.iterdir())


def no_space(*_: object, **__: object) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_file_appears_whole_in_a_folder_that_is_made_for_it(tmp_path: Path) -> None:
    path = tmp_path / "a" / "b" / "picture.png"

    with atomic_path(path) as temporary:
        temporary.write_bytes(b"half")
        assert not path.exists()
        assert temporary.parent == path.parent, "a rename must not cross file systems"
        assert temporary.suffix == ".png"

    assert path.read_bytes() == b"half"
    assert names(path.parent) == ["picture.png"]


def test_a_file_is_synced_before_it_gets_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.json"
    seen: list[bool] = []
    monkeypatch.setattr(os, "fsync", lambda _: seen.append(path.exists()))

    write_json(path, {})

    assert seen == [False]


@pytest.mark.parametrize("old", [None, "old"])
def test_an_error_in_the_block_leaves_what_was_there(tmp_path: Path, old: str | None) -> None:
    path = tmp_path / "a.txt"
    if old:
        write_text(path, old)

    with pytest.raises(ZeroDivisionError), atomic_path(path) as temporary:
        temporary.write_text("new")
        raise ZeroDivisionError

    assert names(tmp_path) == (["a.txt"] if old else [])
    assert not old or path.read_text() == old


@pytest.mark.parametrize("call", ["fsync", "replace"])
def test_a_disk_that_fills_up_is_a_data_error_that_names_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: str
) -> None:
    path = tmp_path / "record.json"
    write_text(path, "old")
    monkeypatch.setattr(os, call, no_space)

    with pytest.raises(DataError, match="could not write .*record.json: No space left on device"):
        write_text(path, "new")

    assert path.read_text() == "old"
    assert names(tmp_path) == ["record.json"]


def test_a_full_disk_during_the_write_itself(tmp_path: Path) -> None:
    with (
        pytest.raises(DataError, match="could not write .*mesh.ply: No space left"),
        atomic_path(tmp_path / "mesh.ply") as temporary,
    ):
        temporary.write_bytes(b"first half")
        no_space()

    assert names(tmp_path) == []


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A real file system of 64 KiB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mounting = ["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", str(folder)]
    if (
        not shutil.which("mount")
        or subprocess.run(mounting, capture_output=True, check=False).returncode
    ):
        pytest.skip("no right to mount a file system here")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def test_a_disk_that_is_really_full(small_disk: Path) -> None:
    write_text(small_disk / "old.txt", "old")

    with pytest.raises(DataError, match="could not write .*new.txt: No space left"):
        write_text(small_disk / "new.txt", "x" * 200_000)
    with (
        pytest.raises(DataError, match="could not write .*folder: No space left"),
        atomic_directory(small_disk / "folder") as temporary,
    ):
        (temporary / "big.txt").write_text("x" * 200_000)

    assert names(small_disk) == ["old.txt"]


def test_an_input_that_cannot_be_read_is_not_a_failed_write(tmp_path: Path) -> None:
    absent = tmp_path / "absent.png"

    with pytest.raises(FileNotFoundError, match="absent.png"), atomic_path(tmp_path / "o.png"):
        absent.read_bytes()
    with pytest.raises(OSError, match="truncated"), atomic_directory(tmp_path / "o"):
        raise OSError("image file is truncated")  # as Pillow says it: no number, no name

    assert names(tmp_path) == []


def test_a_parent_that_is_a_file(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("")

    with pytest.raises(DataError, match="could not write .*b.txt"):
        write_text(tmp_path / "a" / "b.txt", "")


def test_a_block_that_writes_nothing_is_a_failed_write(tmp_path: Path) -> None:
    with (
        pytest.raises(DataError, match="could not write .*No such file"),
        atomic_path(tmp_path / "a.txt"),
    ):
        pass


@pytest.mark.parametrize("old", [False, True])
def test_a_folder_is_replaced_as_a_whole(tmp_path: Path, old: bool) -> None:
    path = tmp_path / "captures" / "a01"
    if old:
        path.mkdir(parents=True)
        (path / "stale.png").write_bytes(b"")

    with atomic_directory(path) as temporary:
        (temporary / "rgb").mkdir()
        (temporary / "rgb" / "00.png").write_bytes(b"0")
        assert names(path) == ["stale.png"] if old else not path.exists()

    assert names(path) == ["rgb"]
    assert names(path.parent) == ["a01"]


@pytest.mark.parametrize(
    ("error", "raised"),
    [
        (OSError(errno.ENOSPC, "No space left on device"), DataError),
        (ZeroDivisionError(), ZeroDivisionError),
        (KeyboardInterrupt(), KeyboardInterrupt),
    ],
)
def test_a_folder_that_fails_leaves_the_old_one(
    tmp_path: Path, error: BaseException, raised: type[BaseException]
) -> None:
    path = tmp_path / "a01"
    path.mkdir()
    (path / "old.png").write_bytes(b"")

    with pytest.raises(raised), atomic_directory(path) as temporary:
        (temporary / "new.png").write_bytes(b"")
        raise error

    assert names(path) == ["old.png"]
    assert names(tmp_path) == ["a01"]


def test_a_folder_that_cannot_be_renamed_is_put_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a01"
    path.mkdir()
    (path / "old.png").write_bytes(b"")
    rename = os.rename

    def refuse_new(source: Path, target: Path) -> None:
        if Path(target) == path and (Path(source) / "new.png").exists():
            no_space()
        rename(source, target)

    monkeypatch.setattr(os, "rename", refuse_new)
    with (
        pytest.raises(DataError, match="could not write .*a01"),
        atomic_directory(path) as temporary,
    ):
        (temporary / "new.png").write_bytes(b"")

    assert names(path) == ["old.png"]
    assert names(tmp_path) == ["a01"]


def test_a_killed_writer_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "record.json"
    write_text(path, "old")
    script = (
        "import os, signal, sys; from pathlib import Path\n"
        "from harness.core.files.atomic import atomic_path\n"
        "with atomic_path(Path(sys.argv[1])) as temporary:\n"
        "    temporary.write_text('ne'); os.kill(os.getpid(), signal.SIGKILL)\n"
    )

    ended = subprocess.run([sys.executable, "-c", script, str(path)], check=False)

    assert ended.returncode == -9
    assert path.read_text() == "old"
    assert all(name == "record.json" or name.startswith(".") for name in names(tmp_path))


def test_a_link_is_written_through_and_stays(tmp_path: Path) -> None:
    (tmp_path / "far").mkdir()
    (tmp_path / "far" / "old.txt").write_text("old")
    for name, target in (("link", "far/old.txt"), ("chain", "link"), ("dangling", "far/new.txt")):
        (tmp_path / name).symlink_to(target)
        write_text(tmp_path / name, name)

        assert (tmp_path / name).is_symlink()
        assert (tmp_path / target).read_text() == name
    assert {path.name for path in (tmp_path / "far").iterdir()} == {"old.txt", "new.txt"}


def test_a_folder_behind_a_link_is_replaced_and_the_link_stays(tmp_path: Path) -> None:
    (tmp_path / "page").mkdir()
    (tmp_path / "link").symlink_to("page")
    with atomic_directory(tmp_path / "link") as temporary:
        (temporary / "new").write_text("new")

    assert (tmp_path / "link").is_symlink()
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["link", "new", "page"]


def test_a_fifo_is_written_to(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "fifo")
    reader = subprocess.Popen(["cat", tmp_path / "fifo"], stdout=subprocess.PIPE)
    write_text(tmp_path / "fifo", "through")

    assert reader.communicate(timeout=30)[0] == b"through"
    assert [path.name for path in tmp_path.iterdir()] == ["fifo"]
    assert (tmp_path / "fifo").is_fifo()


def test_devices_are_written_to(capfd: pytest.CaptureFixture[str]) -> None:
    write_text(Path("/dev/null"), "nothing")
    write_text(Path("/dev/stdout"), "shown")

    assert Path("/dev/null").is_char_device()
    assert capfd.readouterr().out == "shown"
    with pytest.raises(DataError, match="could not write /dev/full: No space left"):
        write_text(Path("/dev/full"), "no room")


def test_json_there_and_back(tmp_path: Path) -> None:
    value = {"b": [1, 2.5, None, True], "a": {"ü": "ø"}}
    write_json(tmp_path / "a.json", value)

    assert read_json(tmp_path / "a.json") == value
    assert (tmp_path / "a.json").read_text().endswith("}\n")


@pytest.mark.parametrize("value", [float("nan"), float("inf"), object()])
def test_what_json_does_not_have_is_not_written(tmp_path: Path, value: object) -> None:
    with pytest.raises((ValueError, TypeError)):
        write_json(tmp_path / "a.json", {"value": value})

    assert names(tmp_path) == []


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "not valid JSON: .*line 1 column 1"),
        (b'{"a": 1,\n "b" 2}', "not valid JSON: .*line 2 column 6"),
        (b'{"a": 1', "not valid JSON"),
        (b"\xff\xfe", "not valid JSON"),
        (b"[" * 100_000, "not valid JSON"),
        (b"[1]", "is not a JSON object .*got list"),
    ],
)
def test_what_is_not_a_json_object(tmp_path: Path, content: bytes, message: str) -> None:
    (tmp_path / "a.json").write_bytes(content)

    with pytest.raises(DataError, match=message):
        read_json(tmp_path / "a.json")


def test_json_that_is_not_there_or_not_a_file(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no file at .*a.json"):
        read_json(tmp_path / "a.json")
    with pytest.raises(DataError, match="could not read .*Is a directory"):
        read_json(tmp_path)


def test_the_folder_of_a_killed_writer_goes_and_that_of_a_living_one_stays(tmp_path: Path) -> None:
    target = tmp_path / "photos"
    killed = tmp_path / f".{target.name}.0123456789ab.part"
    (killed / "rgb").mkdir(parents=True)

    with atomic_directory(target) as living:
        (living / "whose").write_text("the first")
        with atomic_directory(target) as second:
            (second / "whose").write_text("the second")
            assert living.is_dir()
        assert (target / "whose").read_text() == "the second"

    assert (target / "whose").read_text() == "the first"
    assert [path.name for path in tmp_path.iterdir()] == ["photos"]

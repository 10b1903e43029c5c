"""One publication for each cell: a mesh and a record of different attempts never stand together."""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.core.errors import DataError, WriteError
from harness.core.files.hashing import file_sha256
from harness.core.protocols import MethodInfo
from harness.core.records import CaptureStamp, ProtocolStamp, Record
from harness.run import publication
from harness.run.publication import Attempt, collect, file_of
from harness.run.store import CellFolder, RunStore

RECORD = Record(
    key="k",
    method=MethodInfo("m", "M"),
    dataset="d",
    subject="s",
    recipe="r",
    protocol=ProtocolStamp("p", None, ""),
    capture=CaptureStamp(),
    seed=0,
    status="ok",
)


@pytest.fixture
def tmp_path(tmp_path: Path) -> Path:
    """The folder of the record's cell."""
    cell = tmp_path / RECORD.method_name / RECORD.subject
    cell.mkdir(parents=True)
    return cell


#: Publishes attempts for ever, each with a number in its mesh, its body and its record.
WRITER = """\
import sys
import time
from pathlib import Path
sys.path[:0] = [{tests!r}]
from test_publication import publish_one
from harness.run.store import CellFolder
cell = CellFolder(Path({cell!r}))
for number in range({start}, {start} + {count}):
    with cell.locked():
        publish_one(cell, number)
    time.sleep(0.02)
"""


def publish_one(cell: CellFolder, number: int, *, log: str | None = None) -> Record:
    """An attempt whose results and record all say the same number."""
    attempt = cell.new_attempt()
    text = str(number) * 1000
    for name in ("mesh.ply", "body.npz"):
        (attempt.results / name).write_text(text)
    attempt.log.write_text(text if log is None else log)
    files = {name: file_sha256(attempt.results / name) for name in ("body.npz", "mesh.ply")}
    return cell.file(replace(RECORD, reason=str(number), files=files), attempt).record


def consistent(cell: Path) -> int | None:
    """The number of the cell's record, after a check that its files are of the same attempt."""
    found = CellFolder(cell).record()
    if found is None:
        return None
    assert set(found.files) == {"mesh.ply", "body.npz", "log.txt"}
    for name, sha256 in found.files.items():
        path = file_of(cell, found, name)
        assert file_sha256(path) == sha256
        assert path.read_text() == found.reason * 1000
    return int(found.reason)


def folders(cell: Path) -> list[str]:
    return sorted(path.name for path in cell.iterdir() if path.is_dir() and not path.is_symlink())


def test_results_are_seen_through_the_record_alone(tmp_path):
    store = RunStore(tmp_path)
    cell = store.cell("m", "s")
    with cell.locked():
        record = publish_one(cell, 7)
    assert store.result(record, "mesh.ply").read_text() == "7" * 1000
    assert store.records() == [record]
    assert folders(cell.directory) == [file_of(cell.directory, record, "x").parent.name]
    for name in ("mesh.ply", "body.npz", "log.txt"):
        assert (cell.directory / name).is_symlink()
        assert (cell.directory / name).read_text() == "7" * 1000
    assert not (cell.directory / "normals.npz").exists()


def test_what_was_replaced_is_gone(tmp_path):
    cell = CellFolder(tmp_path)
    for number in (1, 2):
        with cell.locked():
            publish_one(cell, number)
    assert consistent(tmp_path) == 2
    assert len(folders(tmp_path)) == 1


def test_the_same_results_again_are_the_same_folder(tmp_path):
    cell = CellFolder(tmp_path)
    for _ in range(2):
        with cell.locked():
            publish_one(cell, 3)
    assert consistent(tmp_path) == 3
    assert len(folders(tmp_path)) == 1
    # Spoilt ones are replaced.
    record = cell.record()
    assert record is not None
    file_of(tmp_path, record, "mesh.ply").write_text("spoilt")
    with cell.locked():
        publish_one(cell, 3)
    assert consistent(tmp_path) == 3


def test_intermediate_results_go_along_and_halves_do_not(tmp_path):
    cell = CellFolder(tmp_path)
    for status in ("ok", "failed"):
        with cell.locked():
            attempt = cell.new_attempt()
            (attempt.results / "work").mkdir()
            (attempt.results / "work" / "map.png").write_text("map")
            (attempt.results / ".mesh.ply.1234.part.ply").write_text("half")
            attempt.log.write_text(status)
            cell.file(replace(RECORD, status=status), attempt)
        kept = [path.name for path in tmp_path.rglob("*.p*")]
        assert kept == (["map.png"] if status == "ok" else [])
        assert (tmp_path / "work").is_symlink() == (status == "ok")


def test_a_failure_has_its_log_and_no_mesh(tmp_path):
    cell = CellFolder(tmp_path)
    with cell.locked():
        publish_one(cell, 1)
    with cell.locked():
        attempt = cell.new_attempt()
        attempt.log.write_text("why")
        failed = cell.file(replace(RECORD, status="failed", reason="no"), attempt).record
    assert set(failed.files) == {"log.txt"}
    assert (tmp_path / "log.txt").read_text() == "why"
    assert not (tmp_path / "mesh.ply").is_symlink()
    assert len(folders(tmp_path)) == 1


def test_a_failure_that_leaves_a_good_record_leaves_its_log(tmp_path):
    cell = CellFolder(tmp_path)
    with cell.locked():
        publish_one(cell, 1)
    with cell.locked():
        attempt = cell.new_attempt()
        attempt.log.write_text("why")
        outcome = cell.file(
            replace(RECORD, status="failed", reason="no"), attempt, own_failure=False
        )
    assert outcome.status == "stale"
    assert consistent(tmp_path) == 1
    assert (tmp_path / "failed-attempt.log").read_text() == "why"
    with cell.locked():
        publish_one(cell, 2)
    assert not (tmp_path / "failed-attempt.log").exists()


def old_layout(cell: Path, number: int) -> Record:
    """A cell as earlier versions wrote it: files beside the record, the log not among them."""
    cell.mkdir(parents=True, exist_ok=True)
    text = str(number) * 1000
    for name in ("mesh.ply", "body.npz", "log.txt"):
        (cell / name).write_text(text)
    files = {name: file_sha256(cell / name) for name in ("body.npz", "mesh.ply")}
    record = replace(RECORD, reason=str(number), files=files)
    record.save(cell / "record.json")
    return record


def test_cells_of_earlier_versions_are_read_and_replaced(tmp_path):
    store = RunStore(tmp_path)
    cell = store.cell("m", "s")
    record = old_layout(cell.directory, 4)
    (cell.directory / ".attempt").mkdir()
    with cell.locked():
        pass
    assert store.result(record, "mesh.ply").read_text() == "4" * 1000
    assert not (cell.directory / "mesh.ply").is_symlink()
    assert folders(cell.directory) == []
    with cell.locked():
        publish_one(cell, 5)
    assert consistent(cell.directory) == 5
    assert (cell.directory / "mesh.ply").is_symlink()
    with pytest.raises(DataError, match="is not what its record measured"):
        store.result(record, "mesh.ply")


def test_a_copy_that_followed_the_links_is_a_cell_as_well(tmp_path):
    cell = CellFolder(tmp_path / "cell")
    with cell.locked():
        publish_one(cell, 1)
    copy = CellFolder(tmp_path / "copy" / "m" / "s")
    shutil.copytree(cell.directory, copy.directory)
    assert not (copy.directory / "mesh.ply").is_symlink()
    assert consistent(copy.directory) == 1
    with copy.locked():
        publish_one(copy, 2)
    assert (copy.directory / "mesh.ply").read_text() == "2" * 1000


def test_a_file_system_without_links_has_the_record_alone(tmp_path, monkeypatch):
    def refused(*_: object, **__: object) -> None:
        raise OSError("no links here")

    monkeypatch.setattr(Path, "symlink_to", refused)
    cell = CellFolder(tmp_path)
    with cell.locked():
        publish_one(cell, 1)
    assert consistent(tmp_path) == 1
    assert not (tmp_path / "mesh.ply").exists()


def test_what_other_machines_left_stays_for_a_day(tmp_path, monkeypatch):
    with monkeypatch.context() as elsewhere:
        elsewhere.setattr(publication, "_owner", lambda: "other000")
        attempt = Attempt.begin(tmp_path)
        (attempt.results / "mesh.ply").write_text("x")
        half = Attempt.begin(tmp_path)
        (half.results / "mesh.ply").write_text("y")
        publication._put(half.results, tmp_path / "results-1234", {})
    cell = CellFolder(tmp_path)
    with cell.locked():
        publish_one(cell, 1)
    assert (tmp_path / "results-1234").is_dir()
    long_ago = time.time() - 25 * 3600
    assert attempt.folder.is_dir()
    for folder in (attempt.folder, half.folder, tmp_path / "results-1234"):
        os.utime(folder, (long_ago, long_ago))
    collect(tmp_path, cell.record())
    assert len(folders(tmp_path)) == 1


class Killed(Exception):
    """Stands for the end of the process at this system call."""


#: What a publication asks of the file system, in some order.
CALLS = ((Path, "rename"), (Path, "replace"), (Path, "mkdir"), (Path, "unlink"),
         (Path, "symlink_to"), (Path, "write_text"), (os, "replace"), (os, "rename"),
         (shutil, "rmtree"))  # fmt: skip


@given(kills=st.lists(st.tuples(st.integers(0, 40), st.integers(1, 3)), max_size=6))
def test_an_end_at_any_call_leaves_one_attempt(tmp_path_factory, kills):
    place = tmp_path_factory.mktemp("cell") / "m" / "s"
    cell, last = CellFolder(place), None
    for calls, number in kills:
        with pytest.MonkeyPatch.context() as patch:
            died = _dying(patch, calls)
            try:
                with cell.locked():
                    publish_one(cell, number)
            except Killed:
                pass
        found = consistent(place)
        assert found in (last, number)
        if not died:
            assert found == number
        last = found
    with cell.locked():
        publish_one(cell, 9)
    assert consistent(place) == 9
    assert len(folders(place)) == 1
    assert not [path for path in place.rglob("*.part*") if not path.name.startswith("results-")]


def _dying(patch: pytest.MonkeyPatch, calls: int) -> list[str]:
    """After so many calls every further one fails, as after SIGKILL; says which was the first."""
    left, died = [calls], []

    def counted(name, original):
        def call(*arguments, **more):
            if left[0] <= 0:
                died.append(name)
                raise Killed(name)
            left[0] -= 1
            return original(*arguments, **more)

        return call

    for owner, name in CALLS:
        patch.setattr(owner, name, counted(name, getattr(owner, name)))
    return died


def writer(cell: Path, start: int, count: int) -> subprocess.Popen[bytes]:
    program = WRITER.format(
        tests=str(Path(__file__).parent), cell=str(cell), start=start, count=count
    )
    return subprocess.Popen([sys.executable, "-c", program])


@pytest.mark.nightly
def test_kills_at_random_moments_and_two_processes_on_one_cell(tmp_path):
    dice = random.Random(11)
    seen: set[int] = set()
    steady = writer(tmp_path, 10_000, 100_000)
    try:
        for turn in range(5):
            process = writer(tmp_path, 1000 * (turn + 1), 1000)
            end = time.monotonic() + 60
            while not {n for n in seen if n < 10_000 and n // 1000 == turn + 1}:
                assert time.monotonic() < end
                number = _seen(tmp_path)
                if number is not None:
                    seen.add(number)
            time.sleep(dice.uniform(0.0, 0.05))
            process.send_signal(signal.SIGKILL)
            process.wait()
    finally:
        steady.kill()
        steady.wait()
    assert len(seen) > 5
    cell = CellFolder(tmp_path)
    consistent(tmp_path)
    with cell.locked():
        publish_one(cell, 1)
    assert consistent(tmp_path) == 1
    assert len(folders(tmp_path)) == 1
    assert json.loads((tmp_path / "record.json").read_text())["reason"] == "1"


def _seen(cell: Path) -> int | None:
    """What a reader sees; the files of a record may be gone by the time that it looks."""
    found = CellFolder(cell).record()
    if found is None:
        return None
    for name, sha256 in found.files.items():
        try:
            folder = publication._folder(cell, found.files)
            content = (folder / name).read_text()
        except OSError:
            return None
        assert content == found.reason * 1000, "files of another attempt"
        assert len(sha256) == 64
    return int(found.reason)


def test_a_cell_that_cannot_be_written_is_told(tmp_path):
    (tmp_path / "runs").write_text("")
    with pytest.raises(WriteError, match="could not write .*: Not a directory"):
        Attempt.begin(tmp_path / "runs" / "m" / "s")

"""Results handed in: whatever was changed is found, and only what is right goes on the board."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from harness.board.copying import (
    MergedEntry,
    changes_markdown,
    compare_boards,
    export_results,
    merge_entry,
)
from harness.board.entries import Entry, entries_in, versions
from harness.board.page import write_board_page
from harness.board.verify import Truths, Verification, verify_entry
from harness.cli.main import app
from harness.core.errors import HarnessError
from harness.core.files.hashing import file_sha256
from harness.core.records import Record
from harness.data.manifest import load_manifest
from harness.files.mesh_files import load_mesh, save_mesh
from harness.report.tables import FORMATS, ReportRequest, build_table
from harness.run.progress import Silent
from harness.run.store import RunStore
from harness.run.workspace import Workspace
from tests.mutations import mutated

#: More than this take their time: five hundred were tried.
MUTATIONS = 20
ERRORS = {
    "area_share": 0.1, "accuracy_mm": 0.01, "completeness_mm": 0.01, "normal_error_deg": 1.0,
    "missing_share": 0.0, "bulge_share": 0.0, "n_predicted": 10, "n_truth": 10,
}  # fmt: skip


def as_version(world: Path, version: str) -> Entry:
    """The world's results as a version that is handed in."""
    store = RunStore.existing(Workspace(world), None)
    (entry,) = export_results(store, store.records(), version, world / "in")
    return entry


@pytest.fixture
def handed_in(world: Path, measured: None) -> Entry:
    """The world's results of ``gt`` as version 1."""
    return as_version(world, "1")


@pytest.fixture
def verified(world: Path) -> Callable[..., Verification]:
    """``verified(entry)``: what is found in it."""

    def found(entry: Entry, **choices: str) -> Verification:
        manifest = load_manifest(world / "data_manifest.yaml")
        return verify_entry(entry, Truths(manifest, Workspace(world), **choices), Silent())

    return found


def failed(entry: Entry, subject: str) -> None:
    """The subject's result becomes a failure, as a run would hand it in."""
    nothing = {"metrics": {}, "regions": {}, "normal_maps": [], "files": {}}
    change(entry.record_path(subject), status="failed", reason="no person was found", **nothing)
    entry.mesh_path(subject).unlink()


def texts(found: Verification) -> list[tuple[str, str]]:
    return [(one.subject, one.what) for one in found.findings]


def change(path: Path, **values: object) -> None:
    document = json.loads(path.read_text())
    path.write_text(json.dumps({**document, **values}))


def test_what_a_run_hands_in_is_right(handed_in: Entry, verified: Callable) -> None:
    found = verified(handed_in)

    assert texts(found) == []
    assert found.scored == ("t1", "t2", "t3")


def test_another_mesh_is_found(handed_in: Entry, verified: Callable) -> None:
    path = handed_in.mesh_path("t2")
    mesh = load_mesh(path)
    save_mesh(path, replace(mesh, vertices=mesh.vertices * 1.01))
    found = texts(verified(handed_in))

    assert {subject for subject, _ in found} == {"t2"}
    assert "is not the one that was scored" in found[0][1]
    assert any(what.startswith("p2s_accuracy is 0.0000 mm in the record") for _, what in found)


def test_another_mesh_is_found_even_where_its_digest_was_put_right(
    handed_in: Entry, verified: Callable
) -> None:
    path = handed_in.mesh_path("t2")
    mesh = load_mesh(path)
    save_mesh(path, replace(mesh, vertices=mesh.vertices * 1.01))
    files = json.loads(handed_in.record_path("t2").read_text())["files"]
    change(handed_in.record_path("t2"), files={**files, "mesh.ply": file_sha256(path)})
    found = texts(verified(handed_in))

    assert {subject for subject, _ in found} == {"t2"}
    assert all("in the record, but" in what for _, what in found)


def test_a_missing_subject_is_found(handed_in: Entry, verified: Callable) -> None:
    handed_in.record_path("t3").unlink()

    assert texts(verified(handed_in)) == [("t3", "no record")]


def test_a_split_need_only_be_complete_itself(handed_in: Entry, verified: Callable) -> None:
    handed_in.record_path("t3").unlink()
    found = verified(handed_in, complete="toy-one")

    assert (texts(found), found.scored) == ([], ("t1",))


def test_a_changed_number_is_found(handed_in: Entry, verified: Callable) -> None:
    path = handed_in.record_path("t1")
    metrics = json.loads(path.read_text())["metrics"]
    metrics["normal_error"]["value"] += 0.01
    change(path, metrics=metrics)
    ((subject, what),) = texts(verified(handed_in))

    assert subject == "t1"
    assert what.startswith("normal_error is ")


def test_a_lost_mesh_a_strange_record_and_another_protocol_are_found(
    handed_in: Entry, verified: Callable
) -> None:
    handed_in.mesh_path("t1").unlink()
    handed_in.record_path("t2").write_text("{")
    protocol = json.loads(handed_in.record_path("t3").read_text())["protocol"]
    change(handed_in.record_path("t3"), protocol={**protocol, "sha": "0" * 16})
    found = dict(texts(verified(handed_in)))

    assert found["t1"] == "no mesh beside its record"
    assert "not valid JSON" in found["t2"]
    assert "measured with protocol" in found["t3"]


def test_a_failure_is_handed_in_as_a_failure(handed_in: Entry, verified: Callable) -> None:
    failed(handed_in, "t1")
    found = verified(handed_in)
    assert (texts(found), found.failed) == ([], ("t1",))

    change(handed_in.record_path("t2"), status="failed", reason="no person was found")
    assert texts(verified(handed_in)) == [
        ("t2", "failed, but with numbers"),
        ("t2", "failed, but with a mesh"),
    ]


def test_a_subject_that_the_dataset_does_not_have_is_found(
    handed_in: Entry, verified: Callable
) -> None:
    copied = handed_in.record_path("t1").read_text().replace('"t1"', '"t9"')
    handed_in.record_path("t9").write_text(copied)
    assert texts(verified(handed_in)) == [("t9", "no subject of toy")]
    # One split is asked for: others of its dataset are nobody's fault, and an unknown one is.
    assert texts(verified(handed_in, complete="toy-one")) == [("t9", "no subject of toy")]


def test_what_was_not_verified_does_not_go_on_the_board(
    world: Path, handed_in: Entry, verified: Callable
) -> None:
    found = merged(handed_in, verified(handed_in, complete="toy-one"), world / "board")
    assert found.entry.subjects() == ("t1",)
    assert [path.name for path in sorted(found.entry.directory.iterdir())] == ["t1.json", "t1.ply"]


@pytest.mark.parametrize("of", ["record", "mesh"])
def test_links_are_not_followed(world: Path, handed_in: Entry, verified: Callable, of: str) -> None:
    place = handed_in.record_path("t2") if of == "record" else handed_in.mesh_path("t2")
    place.rename(world / "elsewhere")
    place.symlink_to(world / "elsewhere")
    found = verified(handed_in)
    assert texts(found) == [("t2", f"gt/1/{place.name} is a link, not a file")]
    assert "t2" not in found.scored


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"regions": {"head": ERRORS}}, "a region 'head', which the scan does not have"),
        ({"created_utc": "9999-01-01T00:00:00+00:00"}, "yet to come"),
        ({"created_utc": "yesterday"}, "made at 'yesterday', which is no time such as"),
        ({"created_utc": "2026-01-01T00:00:00+05:00"}, "which is not in UTC"),
        ({"recipe": "other"}, "their recipe differs"),
    ],
)
def test_other_claims_are_found(
    handed_in: Entry, verified: Callable, changes: dict, said: str
) -> None:
    change(handed_in.record_path("t2"), **changes)
    ((_, what),) = texts(verified(handed_in))
    assert said in what


def test_a_forged_floor_and_what_is_no_number_are_found(
    handed_in: Entry, verified: Callable
) -> None:
    metrics = json.loads(handed_in.record_path("t1").read_text())["metrics"]
    metrics["chamfer"]["floor"] = 123.0
    change(handed_in.record_path("t1"), metrics=metrics)
    change(handed_in.record_path("t2"), details={"seconds": float("nan")})
    found = dict(texts(verified(handed_in)))
    assert found["t1"].startswith("the floor of chamfer is 123.0000, but ")
    assert "NaN is no number in JSON" in found["t2"]


def test_another_state_of_the_method_is_found(handed_in: Entry, verified: Callable) -> None:
    method = json.loads(handed_in.record_path("t2").read_text())["method"]
    change(handed_in.record_path("t2"), method={**method, "privileges": []})
    ((subject, what),) = texts(verified(handed_in))
    assert subject == ""
    assert "two states of the method" in what


def test_what_a_killed_merge_left_is_no_version(
    world: Path, handed_in: Entry, verified: Callable
) -> None:
    board = world / "board"
    merged(handed_in, verified(handed_in), board)
    (board / "gt" / ".2.0123456789ab.part").mkdir()
    assert [each.entry.version for each in versions(Entry(board, "gt", "3"))] == ["1"]


def test_methods_and_subjects_that_are_not_there_are_told(world: Path, handed_in: Entry) -> None:
    with pytest.raises(HarnessError, match="no results of 'hull' in"):
        entries_in(world / "in", ("gt", "hull"))
    found = CliRunner().invoke(
        app, ["results", "export", f"{world / 'out'}", "--version", "1", "--subjects", "t1,t7",
              "--workspace", f"{world}"]
    )  # fmt: skip
    assert "no record of subject 't7'" in str(found.exception)
    assert not (world / "out").exists()


def merged(entry: Entry, found: Verification, board: Path) -> MergedEntry:
    return merge_entry(entry, found, Entry(board, entry.method, entry.version))


def test_right_results_go_on_the_board_once(
    world: Path, handed_in: Entry, verified: Callable
) -> None:
    board = world / "board"
    found = merged(handed_in, verified(handed_in), board)
    (there,) = entries_in(board)

    assert (found.subjects, found.last) == (3, "")
    assert verified(there).findings == ()
    with pytest.raises(HarnessError, match="already"):
        merged(handed_in, verified(handed_in), board)


def test_a_version_that_lost_a_subject_or_is_wrong_does_not_go_on_the_board(
    world: Path, handed_in: Entry, verified: Callable
) -> None:
    board = world / "board"
    merged(handed_in, verified(handed_in), board)
    second = as_version(world, "2")
    failed(second, "t1")

    with pytest.raises(HarnessError, match=r"lost subjects that gt/1 has \(got t1\)"):
        merged(second, verified(second), board)
    second.record_path("t1").unlink()
    with pytest.raises(HarnessError, match="t1: no record"):
        merged(second, verified(second), board)
    assert [entry.version for entry in entries_in(board)] == ["1"]


def test_subjects_outside_a_split_are_lost_to_a_board_that_has_them(
    world: Path, handed_in: Entry, verified: Callable
) -> None:
    board = world / "board"
    merged(handed_in, verified(handed_in), board)
    second = as_version(world, "2")
    with pytest.raises(HarnessError, match=r"lost subjects that gt/1 has \(got t2, t3\)"):
        merged(second, verified(second, complete="toy-one"), board)


def test_a_changed_record_fails_or_goes_all_the_way(
    world: Path, handed_in: Entry, verified: Callable
) -> None:
    path, board = handed_in.record_path("t2"), world / "board"
    ends = {"refused": 0, "merged": 0}
    for text in mutated(path.read_text(), MUTATIONS):
        path.write_text(text)
        found = verified(handed_in)
        if found.findings:
            ends["refused"] += 1
            continue
        ends["merged"] += 1
        shutil.rmtree(board, ignore_errors=True)
        merged(handed_in, found, board)
        (change,) = compare_boards(world / "nothing", board)
        assert change.faults == ()
        assert "`gt/1`" in changes_markdown([change])
        page = write_board_page(board, world / "page", "Board").read_text(encoding="utf-8")
        assert 'data-method="gt/1"' in page
        assert "Left out" not in page
        records = [Record.load(each, "gt", each.stem) for each in (board / "gt/1").glob("*.json")]
        for form in FORMATS:
            for table in ("geometry", "cost"):
                assert build_table(records, ReportRequest(table, form))
    assert ends["refused"] > ends["merged"] > 0, ends


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"scale_rule": "units"}, "of the scale rule 'units', but the dataset's is"),
        ({"capture": {"key": "", "views": 99, "warnings": []}}, "of 99 photos, but recipe"),
        ({"created_utc": "20260101T000000+0000"}, "which is no time such as"),
        ({"created_utc": "0001-01-01T00:00:00+00:00"}, "which is no time such as"),
        ({"diagnostics": None}, "of diagnostics is None in the record, but"),
    ],
)
def test_what_is_printed_beside_the_means_is_proven(
    handed_in: Entry, verified: Callable, changes: dict, said: str
) -> None:
    for subject in handed_in.subjects():
        change(handed_in.record_path(subject), **changes)
    found = texts(verified(handed_in))
    assert {subject for subject, _ in found if subject} == {"t1", "t2", "t3"}
    assert any(said in what for _, what in found), found


@pytest.mark.parametrize(
    ("place", "said"),
    [
        (("protocol", "version"), "measured with protocol"),
        (("protocol", "settings", "samples"), "measured with protocol"),
        (("diagnostics", "f_score", "5_mm", "f"), "f 5_mm f_score of diagnostics is"),
        (("diagnostics", "meshes", "truth", "faces"), "faces truth meshes of diagnostics is"),
        (("metrics", "chamfer", "n"), "n chamfer is"),
    ],
)
def test_settings_and_scores_beside_the_means_are_proven(
    handed_in: Entry, verified: Callable, place: tuple[str, ...], said: str
) -> None:
    path = handed_in.record_path("t2")
    document = json.loads(path.read_text())
    holder = document
    for name in place[:-1]:
        holder = holder[name]
    holder[place[-1]] = 0.5 if place[-1] == "f" else holder[place[-1]] + 10
    path.write_text(json.dumps(document))
    found = dict(texts(verified(handed_in)))
    assert said in found["t2"]


def test_a_board_with_a_link_in_its_place_is_not_written_through(
    world: Path, handed_in: Entry, verified: Callable
) -> None:
    board = world / "board"
    (world / "elsewhere").mkdir()
    board.mkdir()
    (board / "gt").symlink_to("../elsewhere")
    with pytest.raises(HarnessError, match="outside the folders that were given"):
        merged(handed_in, verified(handed_in), board)
    assert list((world / "elsewhere").iterdir()) == []


def test_a_file_of_another_name_is_one_finding(handed_in: Entry, verified: Callable) -> None:
    (handed_in.directory / "t1 (1).json").write_text("{}")
    found = verified(handed_in)
    ((subject, what),) = texts(found)
    assert subject == "t1 (1)"
    assert "cannot be the name of a subject" in what
    assert found.scored == ("t1", "t2", "t3")


def test_a_new_version_says_what_it_changes(
    world: Path, handed_in: Entry, verified: Callable
) -> None:
    board = world / "board"
    merged(handed_in, verified(handed_in), board)
    second = as_version(world, "2")

    assert str(merged(second, verified(second), board)).startswith(
        "gt/2, against 1: 3 subjects, chamfer "
    )


def test_the_commands_hand_in_verify_and_merge(
    harness: Callable, world: Path, measured: None
) -> None:
    assert harness("results", "export", "in", "--version", "1").returncode == 0
    done = harness("results", "merge", "in", "board")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("gt/1, new: 3 subjects")

    (world / "board" / "gt" / "1" / "t2.json").unlink()
    done = harness("results", "verify", "board", "--json")
    assert done.returncode == 1
    assert json.loads(done.stdout)[0]["findings"] == [{"subject": "t2", "what": "no record"}]


def test_the_command_finds_a_tampered_mesh_a_changed_number_and_a_missing_subject(
    harness: Callable, handed_in: Entry
) -> None:
    path = handed_in.mesh_path("t1")
    mesh = load_mesh(path)
    save_mesh(path, replace(mesh, vertices=mesh.vertices * 1.01))
    files = json.loads(handed_in.record_path("t1").read_text())["files"]
    change(handed_in.record_path("t1"), files={**files, "mesh.ply": file_sha256(path)})
    metrics = json.loads(handed_in.record_path("t2").read_text())["metrics"]
    metrics["normal_error"]["value"] += 0.01
    change(handed_in.record_path("t2"), metrics=metrics)
    handed_in.record_path("t3").unlink()

    done = harness("results", "verify", "in", "--json")
    assert done.returncode == 1
    findings = json.loads(done.stdout)[0]["findings"]
    assert {finding["subject"] for finding in findings} == {"t1", "t2", "t3"}
    told = {
        subject: [f["what"] for f in findings if f["subject"] == subject]
        for subject in ("t1", "t2", "t3")
    }
    assert any(what.startswith("p2s_accuracy is 0.0000 mm") for what in told["t1"])
    assert [what.split(" is ")[0] for what in told["t2"]] == ["normal_error"]
    assert told["t3"] == ["no record"]


def test_scans_that_may_not_be_passed_on_are_not_handed_in(
    world: Path, harness: Callable, measured: None
) -> None:
    manifest = world / "data_manifest.yaml"
    manifest.write_text(manifest.read_text().replace("licence: CC0-1.0", "licence: theirs"))
    refused = harness("results", "export", "in", "--version", "1", "--method", "gt")
    assert refused.returncode == 2
    assert "the meshes of gt are scans that may not be passed on" in refused.stderr
    assert not (world / "in").exists()
    assert harness("eval", "--dataset", "toy", "--recipe", "tiny", "--method", "hull8",
                   "--subjects", "t1", "--set", "hull.voxel_m=0.05").returncode == 0  # fmt: skip
    done = harness("results", "export", "in", "--version", "1")
    assert done.returncode == 0
    assert "left out: the meshes of gt are scans" in done.stderr
    assert [path.name for path in (world / "in").iterdir()] == ["hull8"]

"""What a board would show that it did not show before: numbers, lost subjects, changed files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from harness.board.copying import changed_entries, changes_markdown, compare_boards
from tests.unit.board.boards import RECORDS, put, shifted

HULL = RECORDS["hull8"]


@pytest.fixture
def base(tmp_path: Path) -> Path:
    return put(tmp_path / "base", "1", HULL)


@pytest.fixture
def head(tmp_path: Path, base: Path) -> Path:
    """The same board, to be changed."""
    return put(tmp_path / "head", "1", HULL)


def test_equal_boards_have_no_change(base: Path, head: Path) -> None:
    assert compare_boards(base, head) == ()
    assert changes_markdown(()) == "No results change.\n"


def test_the_first_results_of_all_are_new(tmp_path: Path, head: Path) -> None:
    (change,) = compare_boards(tmp_path / "nothing", head)

    assert (change.entry, change.against, change.subjects) == ("hull8/1", "", len(HULL))
    assert change.faults == ()


def test_a_new_version_says_by_how_much_its_means_change(base: Path, head: Path) -> None:
    put(head, "2", tuple(shifted(record, chamfer=-1.5) for record in HULL), day=2)
    (change,) = compare_boards(base, head)

    assert (change.entry, change.against, change.faults) == ("hull8/2", "hull8/1", ())
    assert change.changes["chamfer"] == pytest.approx(-1.5)
    assert change.changes["normal_error"] == pytest.approx(0.0)
    assert change.means["chamfer"] == pytest.approx(
        sum(record.metrics["chamfer"].value for record in HULL) / len(HULL) - 1.5
    )
    text = changes_markdown((change,))
    assert "| `hull8/2` | `hull8/1` | 3 | 0 |" in text
    assert "(-1.50)" in text
    assert "Faults" not in text


def test_changes_are_over_the_subjects_that_both_versions_have(tmp_path: Path) -> None:
    base = put(tmp_path / "base", "1", HULL[:2])
    head = put(tmp_path / "head", "1", HULL[:2])
    worse = (*HULL[:2], shifted(HULL[2], chamfer=1000.0))
    put(head, "2", worse, day=2)
    (change,) = compare_boards(base, head)

    assert change.changes["chamfer"] == pytest.approx(0.0)
    assert change.subjects == 3


def test_the_version_that_was_made_last_is_the_one_to_compare_with(base: Path, head: Path) -> None:
    for board in (base, head):
        put(board, "0.9", HULL, day=5)
    put(head, "2", HULL, day=6)

    assert [change.against for change in compare_boards(base, head)] == ["hull8/0.9"]


def test_lost_subjects_are_a_fault(base: Path, head: Path) -> None:
    failed = replace(HULL[1], status="failed", reason="ran out of memory", metrics={})
    put(head, "2", (HULL[0], failed), day=2)
    (change,) = compare_boards(base, head)

    lost = ", ".join(sorted(record.subject for record in HULL[1:]))
    assert change.faults == (f"lost subjects that `hull8/1` has: {lost}",)
    assert change.failed == (HULL[1].subject,)
    assert f"* `hull8/2`: lost subjects that `hull8/1` has: {lost}" in changes_markdown((change,))


def test_a_version_that_is_there_may_not_change(base: Path, head: Path) -> None:
    (head / "hull8" / "1" / f"{HULL[0].subject}.ply").write_bytes(b"another")
    (change,) = compare_boards(base, head)

    assert change.faults == (f"is on the board already and would change: {HULL[0].subject}.ply",)


def test_a_version_may_not_be_removed(base: Path, tmp_path: Path) -> None:
    head = put(tmp_path / "other", "1", RECORDS["mexecon"])

    assert [(change.entry, change.faults) for change in compare_boards(base, head)] == [
        ("hull8/1", ("removed",)),
        ("mexecon/1", ()),
    ]


def test_versions_with_another_protocol_are_not_compared(base: Path, head: Path) -> None:
    other = replace(HULL[0].protocol, name="`other`")
    put(head, "2", tuple(replace(record, protocol=other) for record in HULL), day=2)
    (change,) = compare_boards(base, head)

    assert (change.changes, change.faults) == ({}, ())
    assert "metric protocol differs" in change.apart
    assert "cannot be compared with `hull8/1`: `these records" in changes_markdown((change,))
    assert "'other' version" in changes_markdown((change,))


def test_only_what_differs_has_to_be_verified(base: Path, head: Path) -> None:
    put(head, "2", HULL, day=2)
    put(head, "1", RECORDS["mexecon"])

    assert [entry.title for entry in changed_entries(base, head)] == ["hull8/2", "mexecon/1"]

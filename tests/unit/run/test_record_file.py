"""Records in one file come back as they were, and a file that is none is refused by its line."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from harness.core.errors import DataError
from harness.report.tables import ReportRequest, build_table
from harness.run.frames import read_record_file, write_record_file
from harness.run.store import RunStore
from tests.unit.board.boards import RECORDS, RUN

ALL = [record for records in RECORDS.values() for record in records]


def test_records_come_back_as_they_were_without_inputs(tmp_path: Path) -> None:
    write_record_file(ALL, tmp_path / "file.jsonl")

    expected = sorted(ALL, key=lambda record: (record.method_name, record.subject))
    assert read_record_file(tmp_path / "file.jsonl") == [
        replace(record, inputs={}) for record in expected
    ]


def test_the_file_does_not_depend_on_the_order_of_records(tmp_path: Path) -> None:
    write_record_file(ALL, tmp_path / "one")
    write_record_file(ALL[::-1], tmp_path / "other")

    assert (tmp_path / "one").read_bytes() == (tmp_path / "other").read_bytes()
    assert len((tmp_path / "one").read_text(encoding="utf-8").splitlines()) == len(ALL)


def test_a_table_of_some_methods_needs_no_more_of_the_others_than_whose_they_are(
    tmp_path: Path,
) -> None:
    path = tmp_path / "file.jsonl"
    write_record_file(ALL, path)
    every, wanted = read_record_file(path), (ALL[0].method_name,)
    some = read_record_file(path, wanted)

    assert [r for r in some if r.method_name in wanted] == [
        r for r in every if r.method_name in wanted
    ]
    others = [r for r in some if r.method_name not in wanted]
    assert others
    assert not any(r.metrics for r in others)
    for subjects in (None, (ALL[0].subject,)):
        request = ReportRequest(methods=wanted, subjects=subjects)
        assert build_table(some, request) == build_table(every, request)
    assert RunStore(RUN).records(wanted)[0].dataset == ALL[0].dataset


def test_a_line_that_names_no_method_is_refused_whichever_are_wanted(tmp_path: Path) -> None:
    (tmp_path / "file").write_text('{"schema": 5, "subject": "a01"}\n', encoding="utf-8")

    with pytest.raises(DataError, match="is not a record"):
        read_record_file(tmp_path / "file", ("hull8",))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "has no records"),
        ("{\n", "line 1 of .* is not valid JSON"),
        ('{"seed": 1, "seed": 2}\n', "line 1 of .* is not valid JSON.*'seed' stands twice"),
        ("[" * 100_000 + "\n", "line 1 of .* is not valid JSON"),
        ("[]\n", "line 1 of .* is not a JSON object"),
        ('{"schema": 1000}\n', "line 1 of .* is not a record of this version"),
    ],
)
def test_what_is_not_a_file_of_records_is_refused(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "file").write_text(text, encoding="utf-8")

    with pytest.raises(DataError, match=message):
        read_record_file(tmp_path / "file")


def test_a_bad_line_is_named(tmp_path: Path) -> None:
    write_record_file(ALL[:2], tmp_path / "file")
    with (tmp_path / "file").open("a", encoding="utf-8") as stream:
        stream.write("record\n")

    with pytest.raises(DataError, match="line 3 of"):
        read_record_file(tmp_path / "file")


def test_two_records_of_one_method_and_subject_are_refused(tmp_path: Path) -> None:
    write_record_file([ALL[0], ALL[0]], tmp_path / "file")

    with pytest.raises(DataError, match=f"two records of {ALL[0].method_name}"):
        read_record_file(tmp_path / "file")


def test_no_records_are_no_file(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no records"):
        write_record_file([], tmp_path / "file")
    assert not (tmp_path / "file").exists()


def test_a_file_that_is_gone_or_binary_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="cannot read records"):
        read_record_file(tmp_path / "gone")
    (tmp_path / "binary").write_bytes(b"\xff\xfe")
    with pytest.raises(DataError, match="cannot read records"):
        read_record_file(tmp_path / "binary")

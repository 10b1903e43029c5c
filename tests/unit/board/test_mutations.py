"""A record with one value changed is refused in one sentence, or tables and pages can use it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from harness.board.copying import changes_markdown, compare_boards
from harness.board.page import write_board_page
from harness.core.errors import DataError, HarnessError, is_plain
from harness.core.files.atomic import parsed_json
from harness.core.records import EDITED, Record
from harness.report.tables import FORMATS, TABLES, ReportRequest, build_table
from tests.mutations import mutated
from tests.unit.board.boards import RECORDS, put

#: Through the reader and the tables, and through pages and comparisons as well.
READ, SHOWN = 500, 20
OK, FAILED = RECORDS["hull8"][0], RECORDS["vggt"][0]
OTHERS = [record for name in ("hull8", "mexecon") for record in RECORDS[name][1:]]


def read(text: str, source: str) -> Record:
    return Record.from_document(parsed_json(text, source), source)


def texts(count: int) -> list[str]:
    """Records with numbers, and one of five without."""
    good, bad = (json.dumps(record.to_dict()) for record in (OK, FAILED))
    return [*mutated(good, count * 4 // 5), *mutated(bad, count // 5)]


def test_a_changed_record_is_refused_or_can_stand_in_every_table() -> None:
    usable = 0
    for text in texts(READ):
        try:
            record = read(text, "handed in")
        except DataError as error:
            assert str(error).count("\n") == 0
            assert is_plain(str(error))
            assert len(str(error)) < 1000
            continue
        usable += 1
        assert read(json.dumps(record.to_dict()), "again") == record
        # One table each, for the time that it takes; all of them were tried.
        table = list(TABLES)[usable % len(TABLES)]
        for form in FORMATS:
            try:
                found = build_table([record, *OTHERS], ReportRequest(table, form))
            except HarnessError:
                continue
            assert not {"\x1b", "\u202e"} & set(found)
    assert READ / 10 < usable < READ * 9 / 10


def test_one_changed_record_never_stops_a_board(tmp_path: Path) -> None:
    base = put(tmp_path / "base", "1", RECORDS["mexecon"])
    escaped = tmp_path.parent / "ESCAPED"
    shown = 0
    for number, text in enumerate(texts(SHOWN)):
        record = OK if number < SHOWN * 4 // 5 else FAILED
        head = put(tmp_path / f"head{number}", "1", RECORDS["mexecon"])
        path = head / record.method_name / "2" / f"{record.subject}.json"
        path.parent.mkdir(parents=True)
        path.write_text(text)
        told: list[str] = []
        page = write_board_page(head, tmp_path / f"page{number}", "Board", told.append)
        html = page.read_text(encoding="utf-8")
        changes = changes_markdown(compare_boards(base, head))
        assert "mexecon/1" in html
        assert f"`{record.method_name}/2`" in changes
        left_out = any(line.startswith(f"left out: {record.method_name}/2") for line in told)
        assert left_out == ("<dt>Left out</dt>" in html)
        assert left_out != (f'data-method="{record.method_name}/2"' in html)
        shown += not left_out
    assert 0 < shown < SHOWN
    assert not escaped.exists()


@pytest.mark.parametrize(
    ("name", "value"),
    [("subject", "../../ESCAPED"), ("subject", "a02"), ("method", "hull8/1")],
)
@pytest.mark.parametrize("record", [OK, FAILED], ids=["ok", "failed"])
def test_the_names_in_a_record_are_those_of_its_folder(
    tmp_path: Path, record: Record, name: str, value: str
) -> None:
    document = record.to_dict()
    document.update({name: {**document["method"], "name": value} if name == "method" else value})
    path = tmp_path / "record.json"
    path.write_text(json.dumps(document))
    with pytest.raises(DataError, match="cannot be the name of|in the place of another record"):
        Record.load(path, record.method_name, record.subject)


@pytest.mark.parametrize(
    ("field", "value", "said"),
    [
        ("seed", f"{10**400}", r"a number of \d+ bits at 'seed'"),
        ("seed", "1e999", "inf at 'seed'"),
        ("seed", "NaN", "NaN is no number in JSON"),
        ("reason", r'"\ud800"', "signs at 'reason' that cannot be shown"),
        ("reason", r'"\u001b[2J"', "signs at 'reason' that cannot be shown"),
        ("details", '{"x": ' + "[" * 40 + "]" * 40 + "}", "more than 32 levels"),
        ("files", '{"../mesh.ply": ""}', "cannot be the name of a file"),
        ("files", '{"mesh.ply": ""}', "a file mesh.ply without its sha256"),
        ("recipe", '"../photos"', "cannot be the name of a recipe"),
    ],
)
def test_what_no_record_holds_is_refused(field: str, value: str, said: str) -> None:
    text = json.dumps({**OK.to_dict(), field: "HERE"}).replace('"HERE"', value)
    with pytest.raises(DataError, match=said):
        read(text, "handed in")


def test_an_edited_record_is_told_by_every_table_and_stays_told(tmp_path: Path) -> None:
    document = json.loads(json.dumps(OK.to_dict()))
    document["metrics"]["chamfer"]["value"] -= 1.0
    edited = read(json.dumps(document), "edited")
    assert edited.warnings == (*OK.warnings, EDITED)
    for form in FORMATS:
        told = build_table([edited, *OTHERS], ReportRequest("geometry", form))
        assert ("edited" in told) == (form != "csv")
        assert "edited" not in build_table([OK, *OTHERS], ReportRequest("geometry", form))
    edited.save(tmp_path / "copy.json")
    assert Record.load(tmp_path / "copy.json", OK.method_name, OK.subject).is_edited
    del document["digest"]
    assert read(json.dumps(document), "without its digest").is_edited

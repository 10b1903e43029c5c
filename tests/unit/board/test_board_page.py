"""The leaderboard: what stands in it, that kinds of results stay apart, and how it is written."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from harness.board.page import write_board_page
from harness.core.errors import HarnessError
from harness.core.records import Record
from tests.unit.board.boards import RECORDS, put, shifted
from tests.unit.reports.page.chromium import Page, browser, find_chromium

HULL, MEXECON = RECORDS["hull8"], RECORDS["mexecon"]


@pytest.fixture
def board(tmp_path: Path) -> Path:
    """Two versions of one method and one of another, the latter with a failure or not."""
    put(tmp_path / "board", "1", HULL)
    put(tmp_path / "board", "2", tuple(shifted(r, chamfer=-0.5) for r in HULL), day=2)
    return put(tmp_path / "board", "1", MEXECON)


def written(board: Path) -> str:
    return write_board_page(board, board.parent / "page", "My <board>").read_text(encoding="utf-8")


def rows(html: str, table: str) -> list[str]:
    body = html[html.index(f'<table data-table="{table}">') :]
    return re.findall(r'<a class="method"[^>]*>(.*?)</a>', body[: body.index("</table>")])


def test_the_first_table_has_the_last_version_of_each_method(board: Path) -> None:
    html = written(board)

    assert rows(html, "geometry") == [
        f"{HULL[0].method.title} (2)",
        f"{MEXECON[0].method.title} (1)",
    ]
    assert sorted(rows(html, "versions")) == sorted(
        [
            f"{HULL[0].method.title} (1)",
            f"{HULL[0].method.title} (2)",
            f"{MEXECON[0].method.title} (1)",
        ]
    )
    assert "My &lt;board&gt;" in html


def test_numbers_lead_to_the_records_as_they_were_handed_in(board: Path) -> None:
    html = written(board)
    page = board.parent / "page"
    script = (page / "data.js").read_text().removeprefix("HarnessPage.data = ").rstrip(";\n")
    data = json.loads(script)

    for method, found in data["records"].items():
        for subject, record in found.items():
            name = method.partition("/")[0]
            shown = Record.load(page / record["file"], name, subject)
            assert shown == Record.load(board / method / f"{subject}.json", name, subject)
    (row,) = [row for row in data["tables"]["geometry"]["rows"] if "chamfer" in row][:1]
    assert row["chamfer"] == {
        record.subject: record.metrics["chamfer"].value - 0.5
        for record in HULL
        if record.status == "ok"
    }
    assert 'data-method="hull8/2"' in html


def test_parts_privileges_and_deviations_stand_on_the_page(board: Path) -> None:
    html = written(board)

    for part in MEXECON[0].method.parts:
        assert part.licence in html
    for privilege in HULL[0].method.privileges:
        assert privilege.sentence in html


def test_results_of_other_photos_have_tables_of_their_own(board: Path) -> None:
    put(board, "3", tuple(replace(record, recipe="other8") for record in HULL), day=3)
    html = written(board)

    assert rows(html, "geometry-2") == [f"{HULL[0].method.title} (3)"]
    assert f"{HULL[0].method.title} (3)" not in rows(html, "versions")
    assert "Mesh geometry: " in html
    assert "other8" in html


def test_intervals_come_with_enough_subjects(board: Path, tmp_path: Path) -> None:
    assert 'class="interval"' not in written(board)
    many = tuple(
        replace(shifted(HULL[0], chamfer=0.1 * k), subject=f"s{k}", capture=HULL[0].capture)
        for k in range(4)
    )

    assert 'class="interval"' in written(put(tmp_path / "many" / "board", "1", many))


def test_a_board_without_results_and_a_strange_folder_are_refused(
    board: Path, tmp_path: Path
) -> None:
    with pytest.raises(HarnessError, match="no results"):
        write_board_page(tmp_path / "empty", tmp_path / "page", "x")
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "note.txt").write_text("mine")
    with pytest.raises(HarnessError, match="is no page"):
        write_board_page(board, tmp_path / "mine", "x")


@pytest.fixture
def tab(tmp_path: Path) -> Iterator[Page]:
    program = find_chromium()
    if program is None:
        pytest.skip("no Chromium: install it (apt-get install chromium) or set HARNESS_CHROMIUM")
    with browser(program, tmp_path / "profile") as page:
        yield page


@pytest.mark.nightly
def test_the_leaderboard_sorts_and_explains_in_a_browser(board: Path, tab: Page) -> None:
    written(board)
    tab.open(board.parent / "page" / "index.html")
    first = "document.querySelector('table[data-table=geometry] tbody a.method').dataset.method"
    best = tab.run(first)
    tab.run("document.querySelector('th[data-column=chamfer] button').click()")

    assert tab.run(first) != best
    tab.run(f"document.querySelector('[data-method=\"{best}\"].value').click()")
    assert tab.run("document.getElementById('card').innerText").count("record") == 3
    assert tab.complaints == []
    assert [url for url in tab.requests if not url.startswith(("file:", "data:", "about:"))] == []
    links = "[...document.querySelectorAll('nav a')]"
    assert tab.run(f"{links}.filter((link) => !document.querySelector(link.hash)).length") == 0

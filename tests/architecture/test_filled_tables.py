"""Tables of the pages are what ``harness report`` makes of the records in ``docs/measured``."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def tables() -> ModuleType:
    """``docs/site/fill_tables.py``, which is not part of the package."""
    sys.path.insert(0, str(ROOT / "docs" / "site"))
    try:
        return importlib.import_module("fill_tables")
    finally:
        sys.path.pop(0)


def test_pages_have_the_tables_that_their_records_give(tables: ModuleType) -> None:
    pages = tables.pages_with_tables()

    assert {ROOT / "README.md", ROOT / "docs" / "results.md"} <= set(pages)
    for page in pages:
        text = page.read_text(encoding="utf-8")
        assert tables.filled(text) == text, "run 'python docs/site/fill_tables.py'"


def test_a_mark_that_asks_for_nothing_known_is_refused(tables: ModuleType) -> None:
    with pytest.raises(ValueError, match="--records gone"):
        tables.filled("<!-- table: --records gone -->\n<!-- end of table -->\n")


def test_text_around_a_mark_stays(tables: ModuleType) -> None:
    mark = "<!-- table: --records docs/measured/paper8.jsonl --method hull8 -->"
    page = f"before\n\n{mark}\nold\n<!-- end of table -->\n\nafter\n"
    found = tables.filled(page)

    assert found.startswith(f"before\n\n{mark}\n\nMesh geometry on avatars, 20 subjects")
    assert found.endswith("<!-- end of table -->\n\nafter\n")
    assert "| Visual hull, 8 views" in found
    assert "\nold\n" not in found
    assert tables.filled(found) == found


def test_rows_come_without_what_is_said_around_them(tables: ModuleType) -> None:
    asked = "--records docs/measured/paper8.jsonl --method hull8,mexecon+"
    found = tables.filled(f"<!-- rows: {asked} -->\n<!-- end of rows -->\n")
    rows = [line for line in found.splitlines()[1:-1] if line]

    assert len(rows) == 4
    assert all(row.startswith("|") and row.endswith("|") for row in rows)
    assert "<sup>" not in found
    assert tables.filled(found) == found


def test_every_file_of_records_is_used_by_a_page(tables: ModuleType) -> None:
    pages = "".join(page.read_text(encoding="utf-8") for page in tables.pages_with_tables())

    for file in sorted((ROOT / "docs" / "measured").iterdir()):
        # Scores under further protocols lie beside the records that they are of.
        name = file.name.replace(".protocols.json", ".jsonl")
        used = [f"--{option} docs/measured/{name} " for option in ("records", "before")]
        assert any(each in pages for each in used)

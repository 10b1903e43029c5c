"""Tables made from fixed records, byte for byte."""

import runpy
from pathlib import Path

import pytest

HERE = Path(__file__).parent
TABLES = runpy.run_path(str(HERE / "remake.py"))["golden_tables"]()


@pytest.mark.parametrize("name", TABLES)
def test_fixed_records_give_the_stored_table(name):
    stored = (HERE / name).read_text(encoding="utf-8")
    assert TABLES[name] == stored, "if this change is wanted: python tests/golden/remake.py"


def test_no_stored_table_is_left_over():
    stored = {path.name for kind in ("tex", "md", "csv", "json") for path in HERE.glob(f"*.{kind}")}
    assert stored == set(TABLES)

"""The tables that the fixed records in ``tests/golden/run`` must give.

After a wanted change of the output, run ``python tests/golden/remake.py`` and read the diff.
"""

from pathlib import Path

from harness.report.tables import FORMATS
from harness.run.store import RunStore
from reports.tables.cost import cost_table
from reports.tables.geometry import geometry_table
from reports.tables.selection import Asked

HERE = Path(__file__).parent


def spread(values):
    """Stands in for the bootstrap, so that these files do not hang on a random stream."""
    return min(values), max(values)


def golden_tables():
    """File name to text."""
    records = RunStore(HERE / "run").records()
    order = ("hull8", "mexecon", "vggt", "gt")
    tables = {
        "geometry": geometry_table(records, Asked(methods=order)),
        "geometry_intervals": geometry_table(records, Asked(methods=order, interval=spread)),
        "geometry_published": geometry_table(records, Asked(methods=order, published=True)),
        "geometry_complete": geometry_table(records, Asked(methods=("hull8", "gt"))),
        "cost": cost_table(records, Asked(methods=order, published=True)),
    }
    return {
        f"{name}.{extension}": write(table)
        for name, table in tables.items()
        for write, extension in FORMATS.values()
    }


if __name__ == "__main__":
    for name, text in golden_tables().items():
        (HERE / name).write_text(text, encoding="utf-8")

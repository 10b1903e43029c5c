"""The same table for programs: CSV and JSON, with unrounded numbers."""

import csv
import io
import json
import re
from collections.abc import Mapping

from harness.core.records import ProtocolStamp
from reports.published import PublishedBlock, PublishedValue
from reports.tables.table import Cell, Column, Row, Table

#: Text that begins so, behind whatever blanks, is calculated by spreadsheets. Numbers are no text
#: and stay what they are.
_FORMULA = re.compile(r"[\t\r\n]|[\s\u200b-\u200f\u2060\ufeff]*[=+\-@＝＋－＠]")


def to_csv(table: Table) -> str:
    """One line per method and stage with unrounded numbers; empty where there is no number.

    Every line repeats dataset, recipe and protocol, so that lines of two files put together still
    say what they are. Printed numbers have ``published`` in their first column, results that others
    published by subject ``stored``; ``notes`` says what they are. Text that begins like a formula
    has an apostrophe before it.
    """
    stream = io.StringIO()
    names = [
        f"{column.id}_{key}_{column.unit}" for column in table.all_columns for key in _keys(column)
    ]
    common = {
        "table": table.name,
        "dataset": table.dataset,
        "recipe": table.recipe,
        "protocol": _protocol_text(table.protocol),
    }
    fields = ["block", *common, "method", "title", "stage", "n", "of", *names, "notes"]
    writer = csv.DictWriter(stream, fields, restval="", lineterminator="\n")
    writer.writeheader()
    block = "stored" if table.origin else "measured"
    for row in table.rows:
        line = {"block": block, **common, "method": row.method, "title": row.title}
        count = {"n": row.n, "of": row.of, "notes": "; ".join(row.notes)}
        writer.writerow(_harmless({**line, **count, **_csv_numbers(table, row.cells)}))
        for stage in row.stages:
            numbers = _csv_numbers(table, stage.cells)
            writer.writerow(_harmless({**line, "stage": stage.name, **numbers}))
    for printed in table.published.rows if table.published else ():
        line = {"block": "published", "table": table.name, "title": printed.title}
        line["notes"] = _source(table.published)
        writer.writerow(_harmless({**line, **_csv_published(table, printed.cells)}))
    return stream.getvalue()


def _protocol_text(protocol: ProtocolStamp | None) -> str:
    """Name, version and sha; empty where nothing was measured here."""
    return f"{protocol.name}-{protocol.version}-{protocol.sha}" if protocol else ""


def _source(block: PublishedBlock | None) -> str:
    return f"{block.heading}: {block.source}. {block.note}" if block else ""


def _harmless(line: Mapping[str, object]) -> dict[str, object]:
    """The line, with text that a spreadsheet would take for a formula marked as text."""
    return {
        name: _plain_text(value) if isinstance(value, str) else value
        for name, value in line.items()
    }


def _plain_text(text: str) -> str:
    # The writer does not quote carriage returns, which would begin another line.
    return ("'" if _FORMULA.match(text) else "") + text.replace("\r", " ")


def _keys(column: Column) -> tuple[str, ...]:
    return (column.statistic, "low", "high") if column.statistic == "mean" else (column.statistic,)


def _csv_numbers(table: Table, cells: Mapping[str, Cell]) -> dict[str, object]:
    return {
        f"{column.id}_{key}_{column.unit}": value
        for column in table.all_columns
        for key, value in _cell_json(column, cells.get(column.id)).items()
        if value is not None
    }


def _csv_published(table: Table, cells: Mapping[str, PublishedValue]) -> dict[str, object]:
    # A number printed in another unit stays out of a column that names ours.
    return {
        f"{column.id}_{column.statistic}_{column.unit}": cells[column.id].value
        for column in table.columns
        if column.id in cells and cells[column.id].unit == column.unit
    }


def to_json(table: Table) -> str:
    """The table as a JSON object with unrounded numbers; null where there is none."""
    document = {
        "table": table.name,
        "title": table.title,
        "dataset": table.dataset,
        "recipe": table.recipe,
        "protocol": table.protocol.to_flat() if table.protocol else {},
        "origin": table.origin,
        "columns": {
            column.id: {
                "title": column.title,
                "unit": column.unit,
                "digits": column.digits,
                "statistic": column.statistic,
            }
            for column in table.all_columns
        },
        "rows": [_row_json(table, row) for row in table.rows],
        "ranked_on": {
            column.id: list(table.common_subjects(column))
            for column in table.columns
            if column.ranked
        },
        "remarks": list(table.remarks),
        "published": _published_json(table.published) if table.published else None,
    }
    return json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _row_json(table: Table, row: Row) -> dict[str, object]:
    best = [column.id for column in table.columns if table.is_best(row, column)]
    return {
        "method": row.method,
        "title": row.title,
        "n": row.n,
        "of": row.of,
        "metrics": _cells_json(table, row.cells),
        "best": best,
        "ranked_by": {
            column.id: mean
            for column in table.columns
            if (mean := table.common_mean(row, column)) is not None
        },
        "privileges": list(row.privileges),
        "notes": list(row.notes),
        "stages": [
            {"stage": stage.name, "metrics": _cells_json(table, stage.cells)}
            for stage in row.stages
        ],
    }


def _cells_json(table: Table, cells: Mapping[str, Cell]) -> dict[str, object]:
    return {column.id: _cell_json(column, cells.get(column.id)) for column in table.all_columns}


def _cell_json(column: Column, cell: Cell | None) -> dict[str, float | None]:
    values = (cell.value, cell.low, cell.high) if cell else (None, None, None)
    return dict(zip(_keys(column), values, strict=False))


def _published_json(block: PublishedBlock) -> dict[str, object]:
    return {
        "source": block.source,
        "note": block.note,
        "rows": [
            {
                "title": row.title,
                "metrics": {
                    column: {"text": cell.text, "value": cell.value, "unit": cell.unit}
                    for column, cell in row.cells.items()
                },
            }
            for row in block.rows
        ],
    }

"""Tables as HTML: complete without any script, sortable with the page's own."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from reports.tables.table import DASH, Cell, Column, Row, Table


def tables_html(tables: Sequence[Table]) -> str:
    """All tables, each under its own heading; the page's script makes tabs of them."""
    return "\n".join(table_html(table) for table in tables)


def table_html(table: Table) -> str:
    """One table with its caption and footnotes."""
    count = "" if table.complete else '<th scope="col" class="count">n/N</th>'
    head = "".join(_heading(column) for column in table.columns)
    bodies = "\n".join(_body(table, place) for place in range(len(table.rows)))
    return f"""\
<section class="panel" id="table-{escape(table.name)}" aria-labelledby="title-{escape(table.name)}">
<h3 id="title-{escape(table.name)}">{escape(table.title)}</h3>
<div class="scroll" tabindex="0" role="region" aria-label="{escape(table.title)}">
<table data-table="{escape(table.name)}">
<thead><tr><th scope="col" class="name">Method</th>{count}{head}</tr></thead>
{bodies}
</table>
</div>
<p class="caption">{escape(table.caption)}</p>
</section>"""


def _heading(column: Column) -> str:
    unit = f' <span class="unit">{escape(column.unit)}</span>' if column.unit != "1" else ""
    title = f"{escape(column.title)}{unit}"
    return f'<th scope="col" class="number" data-column="{escape(column.id)}">{title}</th>'


def _body(table: Table, place: int) -> str:
    """A method's rows as one group, so that its stages move with it when the table is sorted."""
    row = table.rows[place]
    cells = "".join(_cell(table, row, column) for column in table.columns)
    given = "" if row.competes else ' <span class="tag">not ranked</span>'
    name = (
        f'<th scope="row" class="name"><a class="method" href="#method-{escape(row.method)}" '
        f'data-method="{escape(row.method)}">{escape(row.title)}</a>{given}</th>'
    )
    kind = "" if row.competes else ' class="apart"'
    lines = [f"<tr>{name}{_count(table, f'{row.n}/{row.of}')}{cells}</tr>"]
    for stage in row.stages:
        numbers = "".join(_plain(column, stage.cells.get(column.id)) for column in table.columns)
        name = f'<th scope="row" class="name">{escape(stage.name)}</th>'
        lines.append(f'<tr class="stage">{name}{_count(table, "")}{numbers}</tr>')
    return f'<tbody{kind} data-row="{place}">{"".join(lines)}</tbody>'


def _count(table: Table, text: str) -> str:
    return "" if table.complete else f'<td class="count">{escape(text)}</td>'


def _cell(table: Table, row: Row, column: Column) -> str:
    cell = row.cells.get(column.id)
    if cell is None:
        return _plain(column, None)
    kinds = " best" if table.is_best(row, column) else ""
    label = escape(f"{row.title}, {column.title}: the records behind {column.text(cell.value)}")
    return (
        f'<td class="number{kinds}" data-value="{cell.value!r}">'
        f'<button type="button" class="value" data-method="{escape(row.method)}" '
        f'data-column="{escape(column.id)}" aria-label="{label}">'
        f"{escape(column.text(cell.value))}</button>{_interval(column, cell)}</td>"
    )


def _plain(column: Column, cell: Cell | None) -> str:
    if cell is None:
        return f'<td class="number">{DASH}</td>'
    return f'<td class="number">{escape(column.text(cell.value))}{_interval(column, cell)}</td>'


def _interval(column: Column, cell: Cell) -> str:
    if cell.low is None or cell.high is None:
        return ""
    ends = f"[{column.text(cell.low)}, {column.text(cell.high)}]"
    return f'<span class="interval">{escape(ends)}</span>'

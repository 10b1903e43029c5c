"""The page itself: head, viewer, tables, methods and failures, as one HTML document."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from urllib.parse import quote

from harness.core.protocols import Deviation, MethodInfo
from harness.core.records import Record
from reports.page.data_script import record_path, thumbnail_path
from reports.page.model import Fact, PageMethod, PageModel, PageSubject
from reports.tables.table import DASH, Cell, Column, Row, Table


def methods_html(methods: Sequence[PageMethod]) -> str:
    """One card for each method: parts, what it was given, deviations, notes."""
    return "\n".join(_card(method) for method in methods)


def _card(method: PageMethod) -> str:
    info = method.info
    name = f" <code>{escape(info.name)}</code>" if info.title != info.name else ""
    return f"""\
<details class="card" id="method-{escape(info.name)}" data-method="{escape(info.name)}">
<summary>{escape(info.title)}{name}</summary>
<div class="card-body">
<p class="views">{escape(_views(info))}</p>
{_given(info)}{_parts(info)}{_notes(method)}{_deviations(info.deviations)}
</div>
</details>"""


def _views(info: MethodInfo) -> str:
    if info.view_count is not None:
        return f"Uses {info.view_count} of all photos, as evenly apart as can be"
    if info.views is None:
        return "Uses all photos"
    if not info.views:
        return "Uses no photo"
    numbers = ", ".join(map(str, info.views))
    return f"Uses photo{'s' if len(info.views) > 1 else ''} {numbers}, counted from the front"


def _given(info: MethodInfo) -> str:
    if not info.privileges:
        return ""
    items = "".join(
        f"<li><strong>{escape(privilege.label)}</strong> {escape(privilege.sentence)}</li>"
        for privilege in info.privileges
    )
    return f"<h4>Given beyond pixels</h4><ul>{items}</ul>"


def _parts(info: MethodInfo) -> str:
    if not info.parts:
        return ""
    items = "".join(
        f"<li><strong>{escape(part.role)}</strong> {escape(part.name)} "
        f'<span class="licence">{escape(part.licence)}</span></li>'
        for part in info.parts
    )
    return f"<h4>Parts</h4><ul>{items}</ul>"


def _notes(method: PageMethod) -> str:
    if not method.notes:
        return ""
    return (
        "<h4>Notes</h4><ul>"
        + "".join(f"<li>{escape(note)}</li>" for note in method.notes)
        + "</ul>"
    )


def _deviations(deviations: Sequence[Deviation]) -> str:
    if not deviations:
        return ""
    items = "".join(
        f"<li><strong>{escape(one.what)}</strong> "
        f'<span class="was">{escape(one.published)}</span> → {escape(one.here)}'
        f'<br><span class="why">{escape(one.why)}</span></li>'
        for one in deviations
    )
    return f"<h4>Deviations from the publication: {len(deviations)}</h4><ul>{items}</ul>"


def failures_html(records: Sequence[Record], subjects: Sequence[str]) -> str:
    """Every record without numbers with its reason, what was never run, and every warning."""
    failed = [record for record in records if record.status != "ok"]
    doubts = [(record, text) for record in records for text in record.warnings]
    if failed:
        lines = [_line(record, record.status, record.reason) for record in failed]
        text = _list("Failed or missing", lines)
    else:
        text = f"<p>None: all {len(records)} reconstructions that were run have numbers.</p>"
    text += _not_run(records, subjects)
    if doubts:
        text += _list("Doubts", [_line(record, "warning", doubt) for record, doubt in doubts])
    return text


def _not_run(records: Sequence[Record], subjects: Sequence[str]) -> str:
    """Which methods lack a record of some subjects."""
    titles = {record.method_name: record.method.title for record in records}
    done = {(record.method_name, record.subject) for record in records}
    lines: list[str] = []
    for name, title in titles.items():
        absent = [subject for subject in subjects if (name, subject) not in done]
        if absent:
            count = f"{len(absent)} of {len(subjects)} subjects"
            lines.append(f"<li>{escape(title)}: {count} ({escape(', '.join(absent))})</li>")
    return f"<h3>Not run</h3><ul>{''.join(lines)}</ul>" if lines else ""


def _list(title: str, lines: Sequence[str]) -> str:
    return (
        f'<div class="scroll"><table class="failures"><caption>{escape(title)}</caption>'
        '<thead><tr><th scope="col">Method</th><th scope="col">Subject</th>'
        '<th scope="col">Status</th><th scope="col">Reason</th></tr></thead>'
        f"<tbody>{''.join(lines)}</tbody></table></div>"
    )


def _line(record: Record, status: str, reason: str) -> str:
    link = escape(quote(record_path(record)))
    return (
        f"<tr><td>{escape(record.method.title)}</td>"
        f'<td><a href="{link}">{escape(record.subject)}</a></td>'
        f"<td>{escape(status)}</td><td>{escape(reason)}</td></tr>"
    )


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


#: Ids of the sections that every page has.
RESULT_SECTIONS = ("results", "methods", "failures", "about")
_TITLES = {
    "surfaces": "Surfaces",
    "results": "Tables",
    "methods": "Methods",
    "failures": "Failures",
    "about": "About",
}


@dataclass(frozen=True, slots=True)
class PageFrame:
    """A document around its sections.

    Attributes:
        title: The heading.
        lead: One sentence below it.
        scripts: Their paths in the order in which they run.
        sections: Ids of the sections that the head links to.
    """

    title: str
    lead: str
    scripts: tuple[str, ...]
    sections: tuple[str, ...]

    def html(self, main: str) -> str:
        """The whole document."""
        scripts = "".join(f'<script defer src="{path}"></script>\n' for path in self.scripts)
        links = "".join(f'<a href="#{name}">{_TITLES[name]}</a>' for name in self.sections)
        return f"""\
<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>{escape(self.title)}: clothed people from photos</title>
<meta name="description" content="{escape(self.lead)}">
<link rel="icon" href="data:,">
<link rel="stylesheet" href="web/page.css">
{scripts}</head>
<body>
<a class="skip" href="#results">Skip to the tables</a>
<header class="top">
<div class="heading">
<h1>{escape(self.title)}</h1>
<p class="lead">{escape(self.lead)}</p>
</div>
<nav aria-label="Sections">
{links}
<button type="button" id="theme" aria-label="Switch between dark and light">◐</button>
</nav>
</header>
<main>
{main}
</main>
<div id="card" class="float" role="dialog" aria-label="Details" hidden></div>
</body>
</html>
"""


def results_html(tables: Sequence[Table], methods: Sequence[PageMethod]) -> str:
    """The sections of tables and of methods."""
    return f"""\
<section id="results" aria-labelledby="results-title">
<h2 id="results-title">Tables</h2>
<div class="tabs" role="tablist" aria-label="Tables" hidden></div>
{tables_html(tables)}
</section>
<section id="methods" aria-labelledby="methods-title">
<h2 id="methods-title">Methods</h2>
{methods_html(methods)}
</section>"""


def failures_section(records: Sequence[Record], subjects: Sequence[str]) -> str:
    """The section of what has no numbers."""
    return f"""\
<section id="failures" aria-labelledby="failures-title">
<h2 id="failures-title">Failures</h2>
{failures_html(records, subjects)}
</section>"""


def about_html(facts: Sequence[Fact], fine: str) -> str:
    """The last section.

    Args:
        facts: Its lines.
        fine: HTML below them.
    """
    lines = "".join(_fact(fact.label, fact.text) for fact in facts)
    return f"""\
<section id="about" aria-labelledby="about-title">
<h2 id="about-title">About</h2>
<dl class="facts">{lines}</dl>
<p class="fine">{fine}</p>
</section>"""


def _fact(label: str, text: str) -> str:
    return f"<div><dt>{escape(label)}</dt><dd>{escape(text)}</dd></div>"


#: The page's own scripts in the order in which they are loaded; three.js comes before them.
SCRIPTS = (
    "page.js",
    "decode.js",
    "shaders.js",
    "views.js",
    "viewer.js",
    "loading.js",
    "controls.js",
    "tables.js",
)

_SHADINGS = (("error", "Error"), ("clay", "Clay"), ("normals", "Normals"), ("photo", "Photo"))


def page_html(model: PageModel) -> str:
    """The document; tables, methods and failures are complete in it, before any script runs."""
    first, *others = (f"web/{name}" for name in SCRIPTS)
    frame = PageFrame(
        title=model.title,
        lead=model.lead,
        scripts=(first, "data.js", "web/three.js", *others),
        sections=("surfaces", *RESULT_SECTIONS),
    )
    credit = (
        'The 3-D view uses <a href="web/three.LICENSE.txt">three.js</a> (MIT licence). '
        "This page loads nothing from a network."
    )
    return frame.html(
        "\n".join(
            [
                _viewer(model),
                results_html(model.tables, model.methods),
                failures_section(model.records, [subject.id for subject in model.subjects]),
                about_html(model.facts, credit),
            ]
        )
    )


def _viewer(model: PageModel) -> str:
    """The frame of the viewer; the script fills it."""
    if not any(subject.surfaces for subject in model.subjects):
        return ""
    subjects = "".join(_subject_choice(subject) for subject in model.subjects)
    shadings = "".join(
        f'<label><input type="radio" name="shading" value="{value}"'
        f"{' checked' if value == 'error' else ''}><span>{text}</span></label>"
        for value, text in _SHADINGS
    )
    metrics = "".join(
        f'<option value="{escape(scalar.id)}">{escape(scalar.title)} ({escape(scalar.unit)})'
        "</option>"
        for scalar in model.scalars
    )
    return f"""\
<section id="surfaces" aria-labelledby="surfaces-title">
<h2 id="surfaces-title" class="unseen">Surfaces</h2>
<noscript><p class="notice">The surfaces need JavaScript. The tables below do not.</p></noscript>
<div class="subjects" role="radiogroup" aria-label="Subject">{subjects}</div>
<div class="stage">
<div class="panels" role="group" aria-label="Surfaces side by side"></div>
<canvas tabindex="0" role="application" aria-label="3-D view. Drag or use the arrow keys to \
turn, plus and minus to zoom, 0 to return to the front, 1 to 9 to look through a photo's \
camera."></canvas>
<div class="divider" hidden></div>
<output class="probe" hidden></output>
<p class="notice" role="status" hidden></p>
</div>
<form class="tools" autocomplete="off" aria-label="How surfaces are shown">
<fieldset class="choice"><legend>Shading</legend>{shadings}</fieldset>
<div class="scale">
<label for="metric">Colour</label><select id="metric">{metrics}</select>
<div class="bar"><div class="ramp" aria-hidden="true"></div>\
<div class="ticks" aria-hidden="true"></div></div>
<label class="slide" for="limit">Limit<input type="range" id="limit" min="0" max="1000"></label>
</div>
<fieldset class="choice"><legend>Layout</legend>
<label><input type="radio" name="layout" value="side" checked><span>Side by side</span></label>
<label><input type="radio" name="layout" value="slider"><span>Slider</span></label>
</fieldset>
<label class="toggle"><input type="checkbox" id="light" checked><span>Light</span></label>
<label class="toggle"><input type="checkbox" id="wires"><span>Wireframe</span></label>
<label class="slide" for="overlay">Photo over it<input type="range" id="overlay" min="0" \
max="100" value="0" disabled></label>
<label class="slide" for="split" hidden>Boundary<input type="range" id="split" min="0" max="100" \
value="50"></label>
<button type="button" id="front">Front</button>
</form>
<div class="photos" role="group" aria-label="Look through a photo's camera"></div>
</section>"""


def _subject_choice(subject: PageSubject) -> str:
    picture = (
        f'<img src="{escape(quote(thumbnail_path(subject.id)))}" alt="" loading="lazy">'
        if subject.views
        else ""
    )
    about = f'<span class="about">{escape(subject.description)}</span>'
    return (
        f'<label><input type="radio" name="subject" value="{escape(subject.id)}">'
        f"<span>{picture}<b>{escape(subject.id)}</b>{about}</span></label>"
    )

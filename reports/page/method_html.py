"""What a reader must know of each method, and of what went wrong, as HTML."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from urllib.parse import quote

from harness.core.protocols import Deviation, MethodInfo
from harness.core.records import Record
from reports.page.model import PageMethod


def record_path(record: Record) -> str:
    """Where a record lies, relative to the page."""
    return f"records/{record.method_name}/{record.subject}.json"


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

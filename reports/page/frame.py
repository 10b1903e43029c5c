"""What every page has: its head, the sections of tables, methods and failures, and its foot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

from harness.core.records import Record
from reports.page.method_html import failures_html, methods_html
from reports.page.model import Fact, PageMethod
from reports.page.table_html import tables_html
from reports.tables.table import Table

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

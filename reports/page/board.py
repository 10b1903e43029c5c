"""A leaderboard as one HTML document: tables, methods and failures, without surfaces."""

from __future__ import annotations

from reports.page.frame import (
    RESULT_SECTIONS,
    PageFrame,
    about_html,
    failures_section,
    results_html,
)
from reports.page.model import BoardModel

#: The page's own scripts in the order in which they are loaded; the data come after the first.
BOARD_SCRIPTS = ("page.js", "tables.js")


def board_html(model: BoardModel) -> str:
    """The document; it is complete before any script runs."""
    first, *others = (f"web/{name}" for name in BOARD_SCRIPTS)
    frame = PageFrame(model.title, model.lead, (first, "data.js", *others), RESULT_SECTIONS)
    return frame.html(
        "\n".join(
            [
                results_html(model.tables, model.methods),
                failures_section(model.records, model.subjects),
                about_html(model.facts, "This page loads nothing from a network."),
            ]
        )
    )

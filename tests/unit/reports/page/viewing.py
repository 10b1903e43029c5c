"""How tests of pages in a browser open them and read what is drawn."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.unit.reports.page.chromium import Page, find_chromium

CHROMIUM = find_chromium()
NEEDS_CHROMIUM = [
    pytest.mark.nightly,
    pytest.mark.skipif(
        CHROMIUM is None,
        reason="no Chromium: install it (apt-get install chromium) or set HARNESS_CHROMIUM",
    ),
]
#: First, middle and last colour of the error scale.
LOW, MIDDLE, HIGH = (233, 229, 220), (224, 108, 74), (52, 17, 38)
FLAT = "light=no"


def opened(tab: Page, folder: Path, address: str = "", size: tuple[int, int] = (900, 700)) -> Page:
    tab.requests.clear()
    tab.complaints.clear()
    tab.open(folder / "index.html", f"#{address}" if address else "", size)
    tab.run("HarnessPage.ready")
    return tab


def middle_of(tab: Page, panel: int) -> tuple[int, ...]:
    """The colour in the middle of a panel."""
    return pixel(
        tab, f"panels[{panel}].x + panels[{panel}].width / 2", f"panels[{panel}].height / 2"
    )


def pixel(tab: Page, x: str, y: str) -> tuple[int, ...]:
    script = (
        "(() => { const { panels, pixelAt } = HarnessPage.viewer;"
        f" return ((panels) => pixelAt({x}, {y}))(panels()); }})()"
    )
    return tuple(tab.run(script)[:3])


def near(found: tuple[int, ...], wanted: tuple[int, ...], most: int = 3) -> bool:
    return max(abs(a - b) for a, b in zip(found, wanted, strict=True)) <= most


def move(tab: Page, name: str, value: float) -> None:
    tab.run(
        f"(() => {{ const input = document.getElementById('{name}'); input.value = {value};"
        " input.dispatchEvent(new Event('input', { bubbles: true })); })()"
    )


def choose(tab: Page, name: str, value: str) -> None:
    tab.run(f"document.querySelector('input[name={name}][value={value}]').click()")


@contextmanager
def before_scripts(tab: Page, source: str) -> Iterator[None]:
    """Each page that is opened in the block runs this code first."""
    made = tab.call("Page.addScriptToEvaluateOnNewDocument", {"source": source})
    try:
        yield
    finally:
        tab.call("Page.removeScriptToEvaluateOnNewDocument", {"identifier": made["identifier"]})

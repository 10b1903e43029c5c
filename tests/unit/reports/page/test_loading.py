"""How surfaces come into a page in a headless Chromium: coarse ones first, large ones beside it."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from reports.page.data_script import surface_script
from tests.unit.reports.page.chromium import Page
from tests.unit.reports.page.pages import compact, write_page
from tests.unit.reports.page.viewing import (
    FLAT,
    HIGH,
    LOW,
    NEEDS_CHROMIUM,
    before_scripts,
    middle_of,
    near,
    opened,
)

pytestmark = NEEDS_CHROMIUM
#: A square of so many rows has more triangles than are decoded without a worker.
LARGE_CELLS = 180


@pytest.fixture(scope="module")
def large(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A page with a surface of very many triangles."""
    made = tmp_path_factory.mktemp("large") / "page"
    shutil.copytree(folder, made)
    text = surface_script("a01", "vggt", compact("vggt", LARGE_CELLS))
    (made / "surfaces" / "vggt" / "a01.js").write_text(text)
    return made


@pytest.fixture(scope="module")
def coarse(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A page on which two surfaces have a coarse form."""
    made = tmp_path_factory.mktemp("coarse") / "page"
    return write_page(made, coarse={"hull8": 2, "vggt": 1}).parent


def settled(tab: Page, faces: dict[str, int]) -> dict[str, int]:
    """What is drawn once it has as many faces as it should, or after ten seconds.

    A full surface may still be decoded when the page is ready, and on a slow machine a coarse one
    stands for it a while longer.
    """
    return tab.run(
        "(async () => { const drawn = () => HarnessPage.viewer.drawn();"
        f" const wanted = {json.dumps(faces)};"
        " const differs = () => Object.keys(wanted).some((name) => drawn()[name] !== wanted[name]);"
        " for (let k = 0; k < 200 && differs(); k++) await new Promise((r) => setTimeout(r, 50));"
        " return drawn(); })()"
    )


def test_coarse_surfaces_are_drawn_first_and_full_ones_take_their_place(
    tab: Page, coarse: Path
) -> None:
    opened(tab, coarse, "show=hull8 mexecon vggt")

    assert tab.run("HarnessPage.timings.first_faces") == {"hull8": 8, "mexecon": 50, "vggt": 2}
    full = {"hull8": 32, "mexecon": 50, "vggt": 72}
    assert settled(tab, full) == full
    assert tab.run("HarnessPage.viewer.triangles()") == {"hull8": 32, "mexecon": 50, "vggt": 72}
    assert tab.complaints == []


def test_coarse_surfaces_turn_where_software_draws(tab: Page, coarse: Path) -> None:
    opened(tab, coarse, f"show=hull8 vggt&{FLAT}")
    assert tab.run("HarnessPage.viewer.isSoftware")
    turning = "(() => { HarnessPage.viewer.turn(10, 0, 1); return HarnessPage.viewer.drawn(); })()"
    assert tab.run(turning) == {"hull8": 8, "vggt": 2}
    assert near(middle_of(tab, 0), LOW)

    full = {"hull8": 32, "vggt": 72}
    assert settled(tab, full) == full


def test_a_coarse_surface_stays_where_the_full_one_is_missing(
    tab: Page, coarse: Path, tmp_path: Path
) -> None:
    copy = tmp_path / "page"
    shutil.copytree(coarse, copy)
    (copy / "surfaces" / "vggt" / "a01.js").unlink()
    opened(tab, copy, "show=hull8 vggt")

    known = {"hull8": 32, "vggt": 2}
    assert settled(tab, known) == known
    assert "surfaces/vggt/a01.js is not there" in tab.run(
        "document.querySelector('.stage .notice').textContent"
    )


#: A browser without workers, and one that refuses them when they are started.
REFUSING = """
window.Worker = class {
  constructor() { setTimeout(() => this.onerror({ preventDefault() {} })); }
  postMessage() {}
  terminate() {}
};
"""
COUNTING = """
const OwnWorker = window.Worker;
window.answers = 0;
window.Worker = class extends OwnWorker {
  constructor(...all) { super(...all); this.addEventListener("message", () => { answers++; }); }
};
"""


@pytest.mark.parametrize(
    ("source", "answers"),
    [(COUNTING, 1), ("delete window.Worker;", None), (REFUSING, None)],
    ids=["workers", "none", "refused"],
)
def test_a_large_surface_is_decoded_with_and_without_workers(
    tab: Page, large: Path, source: str, answers: int | None
) -> None:
    with before_scripts(tab, source):
        opened(tab, large, f"show=vggt&{FLAT}")

        assert tab.run("HarnessPage.viewer.triangles()") == {"vggt": 2 * LARGE_CELLS**2}
        assert near(middle_of(tab, 0), HIGH)
        assert tab.run("window.answers ?? null") == answers

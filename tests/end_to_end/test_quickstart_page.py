"""The page that ``harness quickstart`` wrote in this checkout, where it has been run."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import pytest

from tests.unit.reports.page.chromium import browser, find_chromium

PAGE = Path(__file__).parents[2] / "runs" / "quickstart" / "page"
CHROMIUM = find_chromium()
pytestmark = pytest.mark.skipif(
    not PAGE.is_dir(), reason="no quickstart in this checkout: run 'harness quickstart'"
)


def data() -> Any:
    text = (PAGE / "data.js").read_text(encoding="utf-8")
    return json.loads(text.removeprefix("HarnessPage.data = ").removesuffix(";\n"))


def test_everything_that_it_names_is_there() -> None:
    found = data()
    names = [s["file"] for subject in found["subjects"] for s in subject["surfaces"]]
    names += [subject[key] for subject in found["subjects"] for key in ("photos", "thumbnail")]
    names += [r["file"] for records in found["records"].values() for r in records.values()]

    assert len(found["subjects"]) == 2
    assert [name for name in names if not (PAGE / unquote(name)).is_file()] == []


@pytest.mark.nightly
@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium: install it, or set HARNESS_CHROMIUM")
def test_it_opens_and_draws_without_a_network(tmp_path: Path) -> None:
    assert CHROMIUM
    first = data()["subjects"][0]
    faces = {surface["method"]: surface["faces"] for surface in first["surfaces"]}
    with browser(CHROMIUM, tmp_path / "profile") as tab:
        tab.open(PAGE / "index.html", size=(1000, 700))
        tab.run("HarnessPage.ready", limit_s=120)
        drawn = tab.run("HarnessPage.viewer.triangles()", limit_s=120)

        assert len(drawn) >= 3
        assert all(count == faces[name] for name, count in drawn.items() if name != "/photos")
        assert [a for a in tab.requests if not a.startswith(("file:", "data:", "blob:"))] == []
        assert tab.complaints == []

"""The documentation site: what its pages are made of, and that a bad link fails the build."""

from __future__ import annotations

import importlib
import subprocess
import sys
import tomllib
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

import pytest

from harness.cli.verb_list import all_verbs
from harness.core.errors import HarnessError
from tests.unit.reports.page.pages import write_page

ROOT = Path(__file__).parents[2]
SITE = ROOT / "docs" / "site"
NAVIGATION = """
[[section]]
title = "Guides"
pages = [["a", "docs/a.md", "First"], ["deep/b", "other/b.md", "Second"]]
"""
README = """# Title

A [guide](docs/a.md#good-to-know), and [code](tool.py).

## Install and start

Install.

## Use

Use.
"""
needs_sphinx = [
    pytest.mark.nightly,
    pytest.mark.skipif(
        not all(map(find_spec, ("sphinx", "myst_parser", "furo"))),
        reason="the site's programs are not there: pip install -c constraints.txt -e '.[docs]'",
    ),
]


def module(name: str, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """A module of the site's own programs."""
    monkeypatch.syspath_prepend(str(SITE))
    return importlib.import_module(name)


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A small repository with two guides."""
    files = {
        "README.md": README,
        "navigation.toml": NAVIGATION,
        "tool.py": "x = 1\n",
        "docs/a.md": "# A\n\nSee [b](../other/b.md#more) and [home](../README.md).\n\n"
        "## Good to know\n\n[Folder](../box/)\n",
        "other/b.md": "# B\n\n## More\n\n[a](../docs/a.md)\n",
        "box/inner.toml": "y = 2\n",
    }
    for name, text in files.items():
        path = tmp_path / "repository" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return tmp_path / "repository"


def built(tree: Path, *options: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "docs/site/build.py", "--root", str(tree)]
    command += ["--navigation", str(tree / "navigation.toml"), "--output", str(tree / "out")]
    return subprocess.run(
        [*command, *options], cwd=ROOT, capture_output=True, text=True, check=False
    )


def test_every_page_of_the_documents_has_its_place(monkeypatch: pytest.MonkeyPatch) -> None:
    site = module("layout", monkeypatch).load_navigation(ROOT, SITE / "navigation.toml")

    assert {file for file in site.files.values() if file.startswith("docs/")} == {
        f"docs/{path.name}" for path in (ROOT / "docs").glob("*.md")
    }


def test_a_page_without_a_place_is_refused(tree: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tree / "docs" / "c.md").write_text("# C\n")

    with pytest.raises(HarnessError, match=r"no place for pages \(got docs/c\.md"):
        module("layout", monkeypatch).load_navigation(tree, tree / "navigation.toml")


def test_links_lead_to_pages_and_to_pages_that_show_files(
    tree: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    site = module("layout", monkeypatch).load_navigation(tree, tree / "navigation.toml")
    text = "[a](../docs/a.md#x) [c](../tool.py) [f](../box/) [g](gone.md) [u](https://x.y/z.py)"
    linked, shown = site.relinked(text, "other/b.md", "deep/b")

    assert linked == (
        "[a](../a.md#x) [c](../files/tool.py.md) [f](../files/box.md) [g](../other/gone.md) "
        "[u](https://x.y/z.py)"
    )
    assert shown == ("tool.py", "box")
    assert "y = 2" in site.source_text("box")


def test_the_first_page_has_the_sections_of_the_readme(monkeypatch: pytest.MonkeyPatch) -> None:
    layout = module("layout", monkeypatch)
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    lines = (SITE / "index.md").read_text(encoding="utf-8").splitlines()
    wanted = [line.removeprefix("@readme").strip() for line in lines if line.startswith("@readme")]
    texts = [layout.readme_section(readme, heading) for heading in wanted]

    assert "](docs/comparison.png)" in texts[0]
    assert "| Method | Chamfer" in texts[0]
    assert any("harness quickstart" in text for text in texts[1:])
    assert any("harness eval" in text for text in texts[1:])
    with pytest.raises(HarnessError, match="no section 'Gone'"):
        layout.readme_section(readme, "Gone")


def test_every_command_and_package_is_in_the_reference(monkeypatch: pytest.MonkeyPatch) -> None:
    reference = module("reference", monkeypatch)
    commands = reference.commands_page()

    assert [verb for verb in all_verbs() if f"## harness {verb}\n" not in commands] == []
    assert "### harness results verify" in commands
    assert "| `--dataset` NAME | Dataset or split" in commands
    assert ".. automodule:: metrics.distance\n   :members:" in reference.package_page("metrics")
    assert {"harness.core", "harness.core.files", "reports.tables"} <= set(reference.all_packages())


def test_links_of_built_pages_are_followed_to_files_and_anchors(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    links = module("built_links", monkeypatch)
    (tmp_path / "deep").mkdir()
    (tmp_path / "deep" / "b.html").write_text('<h1 id="one">B</h1><a href="../a.html#no">a</a>')
    (tmp_path / "a.html").write_text(
        '<a href="deep/b.html#one">b</a> <a href="deep/b.html#two">b</a> <a href="#here">c</a>'
        '<p id="here"></p> <img src="gone.png"> <a href="https://x.y/z">z</a> <a href="deep">d</a>'
    )
    pages = links.page_links(tmp_path)

    assert links.broken_links(tmp_path, pages) == [
        "a.html: deep",
        "a.html: deep/b.html#two",
        "a.html: gone.png",
        "deep/b.html: ../a.html#no",
    ]
    assert links.external_links(pages) == ["https://x.y/z"]


def test_the_programs_of_the_site_are_pinned_exactly() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]

    assert all("==" in each for each in project["optional-dependencies"]["docs"])


class TestBuilt:
    """Sites that are really built."""

    pytestmark = needs_sphinx

    def test_a_site_is_built_with_a_page_of_a_run_on_its_first_page(self, tree: Path) -> None:
        write_page(tree / "page")
        done = built(tree, "--page", str(tree / "page"))

        assert done.returncode == 0, done.stderr
        first = (tree / "out" / "index.html").read_text(encoding="utf-8")
        assert 'src="quickstart/index.html"' in first
        assert 'href="a.html#good-to-know"' in first
        assert 'href="files/tool.py.html"' in first
        assert (tree / "out" / "quickstart" / "data.js").is_file()
        assert 'href="deep/b.html#more"' in (tree / "out" / "a.html").read_text(encoding="utf-8")

    @pytest.mark.parametrize(
        ("link", "complaint"),
        [("gone.md", "not found: 'gone.md'"), ("a.md#gone", "local id not found")],
    )
    def test_a_link_that_leads_nowhere_fails_the_build(
        self, tree: Path, link: str, complaint: str
    ) -> None:
        with (tree / "docs" / "a.md").open("a") as stream:
            stream.write(f"\n[broken]({link})\n")
        done = built(tree)

        assert done.returncode != 0
        assert complaint in done.stderr
        assert not (tree / "out").exists()

    def test_a_folder_with_something_else_is_left_alone(self, tree: Path) -> None:
        (tree / "out").mkdir()
        (tree / "out" / "mine.txt").write_text("mine")
        done = built(tree)

        assert (done.returncode, (tree / "out" / "mine.txt").read_text()) == (2, "mine")
        assert "is no site" in done.stderr

    def test_a_link_of_raw_html_that_leads_nowhere_fails_the_build(self, tree: Path) -> None:
        with (tree / "docs" / "a.md").open("a") as stream:
            stream.write('\n<a href="gone/index.html">broken</a>\n')
        done = built(tree)

        assert (done.returncode, (tree / "out").exists()) == (2, False)
        assert "lead nowhere (got a.html: gone/index.html)" in done.stderr

"""Build the documentation site: ``python docs/site/build.py --page runs/quickstart/page``.

Its pages are the files of docs/, parts of the README, the commands' own help and docstrings. Every
complaint of Sphinx, and every link of the built pages that leads nowhere, makes the build fail. A
folder that holds anything else than a site is left alone.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from sphinx.cmd.build import build_main

from built_links import broken_links, page_links
from harness.core.errors import HarnessError
from harness.core.files.atomic import atomic_directory
from layout import INDEX, Site, contents, load_navigation, readme_section, source_page
from reference import all_packages, commands_page, package_page, packages_page

HERE = Path(__file__).parent
#: Sphinx writes it into each site.
_MARK = "objects.inv"
_EMBEDDED = "quickstart"
_FRAME = f"""\
## What it makes

This page is written by `harness quickstart`. Turn the surfaces, change what they show, sort tables.
<a href="{_EMBEDDED}/index.html">Open it in a window of its own.</a>

<iframe class="page-frame" src="{_EMBEDDED}/index.html" title="Page of the quickstart"
loading="lazy"></iframe>
"""


@dataclass(frozen=True, slots=True)
class _Staging:
    """Writes what Sphinx reads."""

    site: Site
    folder: Path

    def write(self, page: Path | None) -> None:
        docs = self.site.root / "docs"
        shutil.copytree(
            docs, self.folder, dirs_exist_ok=True, ignore=shutil.ignore_patterns("*.md", "site")
        )
        for name, file in self.site.files.items():
            self._page(name, file, (self.site.root / file).read_text(encoding="utf-8"))
        self._page(INDEX, "README.md", self._index(page))
        written = {page for section in self.site.sections for page in section.pages}
        if "commands" in written:
            self._text("commands.md", commands_page())
        if "python" in written:
            self._text("python.rst", packages_page())
            for package in all_packages():
                self._text(f"python/{package}.rst", package_page(package))

    def _index(self, page: Path | None) -> str:
        readme = (self.site.root / "README.md").read_text(encoding="utf-8")
        parts: list[str] = []
        for line in (HERE / "index.md").read_text(encoding="utf-8").splitlines():
            if line.startswith("@readme"):
                parts.append(readme_section(readme, line.removeprefix("@readme").strip()))
            elif line == "@page":
                parts.append(_FRAME if page else "")
            else:
                parts.append(line)
        return "\n".join([*parts, "", contents(self.site.sections)])

    def _page(self, name: str, file: str, text: str) -> None:
        linked, shown = self.site.relinked(text, file, name)
        self._text(f"{name}.md", linked)
        for each in shown:
            self._text(f"{source_page(each)}.md", self.site.source_text(each))

    def _text(self, name: str, text: str) -> None:
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


def build(site: Site, output: Path, page: Path | None) -> None:
    """Build a site.

    Args:
        site: Its pages.
        output: The site's folder; an older site there is replaced.
        page: A page of a run that the first page shows; None for no page.

    Raises:
        HarnessError: Sphinx complained, a link leads nowhere, ``output`` holds something else, or
            ``page`` is no page.
    """
    if page is not None and not (page / "index.html").is_file():
        raise HarnessError(f"{page} is no page", hint="'harness report --page' writes one")
    if output.exists() and any(output.iterdir()) and not (output / _MARK).is_file():
        raise HarnessError(f"{output} is not empty and is no site", hint="Name a new folder")
    with tempfile.TemporaryDirectory() as temporary, atomic_directory(output) as made:
        source, trees = Path(temporary) / "source", Path(temporary) / "trees"
        _Staging(site, source).write(page)
        options = ["-q", "-W", "-b", "html", "-c", str(HERE), "-d", str(trees)]
        if build_main([*options, str(source), str(made)]):
            raise HarnessError("the site was not built", hint="Sphinx says above what is wrong")
        if page is not None:
            shutil.copytree(page, made / _EMBEDDED)
        if broken := broken_links(made, page_links(made)):
            raise HarnessError(
                "links of the site lead nowhere", got=", ".join(broken), hint="Mend the pages"
            )


def main() -> int:
    """Build from the command line."""
    parser = argparse.ArgumentParser(description="Build the documentation site.")
    parser.add_argument("--page", type=Path, help="page of a run to show on the first page")
    parser.add_argument("--output", type=Path, default=Path("build/site"), help="folder to write")
    parser.add_argument("--root", type=Path, default=HERE.parents[1], help="the repository")
    parser.add_argument("--navigation", type=Path, default=HERE / "navigation.toml")
    arguments = parser.parse_args()
    try:
        site = load_navigation(arguments.root, arguments.navigation)
        build(site, arguments.output, arguments.page)
    except HarnessError as error:
        print(f"build: {error}", file=sys.stderr)
        return error.exit_code
    print(arguments.output / "index.html")
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""Links of a built site: ``python docs/site/built_links.py build/site`` lists those to elsewhere.

Sphinx checks the links of its sources. This checks what a browser is given: every file, picture,
frame and anchor, those of raw HTML and of generated pages included.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from html.parser import HTMLParser
from pathlib import Path
from posixpath import join, normpath
from urllib.parse import unquote, urlsplit

#: Attributes that name what a browser loads or goes to.
_LINKS = ("href", "src", "poster")


@dataclass(slots=True)
class PageLinks:
    """What a page links to, and the anchors that it has."""

    targets: set[str] = field(default_factory=set[str])
    anchors: set[str] = field(default_factory=set[str])


class _Reader(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.found = PageLinks()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if value and name in _LINKS:
                self.found.targets.add(value)
            if value and (name == "id" or (tag == "a" and name == "name")):
                self.found.anchors.add(value)


def page_links(folder: Path) -> dict[str, PageLinks]:
    """Links and anchors of every HTML file under a folder, by path relative to it."""
    found: dict[str, PageLinks] = {}
    for path in sorted(folder.rglob("*.html")):
        reader = _Reader()
        reader.feed(path.read_text(encoding="utf-8"))
        found[path.relative_to(folder).as_posix()] = reader.found
    return found


def broken_links(folder: Path, pages: Mapping[str, PageLinks]) -> list[str]:
    """``page: link`` for each link within a site whose file or anchor is not there."""
    return [
        f"{page}: {target}"
        for page, links in pages.items()
        for target in sorted(links.targets)
        if not _is_external(target) and not _is_there(folder, pages, page, target)
    ]


def external_links(pages: Mapping[str, PageLinks]) -> list[str]:
    """Every address of another site, once."""
    return sorted(
        {each for links in pages.values() for each in links.targets if _is_external(each)}
    )


def _is_external(target: str) -> bool:
    parts = urlsplit(target)
    return bool(parts.scheme or parts.netloc)


def _is_there(folder: Path, pages: Mapping[str, PageLinks], page: str, target: str) -> bool:
    parts = urlsplit(target)
    name = normpath(join(page, "..", unquote(parts.path))) if parts.path else page
    path = folder / name
    if path.is_dir():
        name = normpath(join(name, "index.html"))
    if not (folder / name).is_file():
        return False
    # Pages of a run choose what they show by their own fragments.
    has_anchors = name in pages and not parts.fragment.startswith("/")
    anchor = unquote(parts.fragment)
    return not anchor or not has_anchors or anchor in pages[name].anchors


def main() -> int:
    """List external links; 1 where a link within the site is broken."""
    folder = Path(sys.argv[1])
    pages = page_links(folder)
    broken = broken_links(folder, pages)
    print("\n".join(external_links(pages)))
    print("\n".join(broken), file=sys.stderr)
    return bool(broken)


if __name__ == "__main__":
    sys.exit(main())

"""Pages of the site out of files of the repository: where each goes, and where its links lead."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from posixpath import join, normpath, relpath

from harness.core.errors import HarnessError

#: The first page.
INDEX = "index"
#: Where pages that show other files of the repository go.
_SOURCES = "files"
_LINK = re.compile(r"(?<=\]\()([^)\s#]+)(#[^)\s]*)?(?=\))")
#: How code of a file is coloured, by suffix.
_LANGUAGES = {
    ".py": "python",
    ".toml": "toml",
    ".yaml": "yaml",
    ".yml": "yaml",
    ".cff": "yaml",
    ".json": "json",
    # Notes and READMEs that are no pages.
    ".md": "md",
}


@dataclass(frozen=True, slots=True)
class Section:
    """Pages under one heading of the navigation.

    Attributes:
        title: The heading.
        pages: Titles in the navigation by page, in order.
    """

    title: str
    pages: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Site:
    """What pages there are, and which file of the repository each of them is.

    Attributes:
        root: The repository.
        sections: The navigation.
        files: By page, its file relative to ``root``; pages that code writes are not in it.
    """

    root: Path
    sections: tuple[Section, ...]
    files: Mapping[str, str]

    def relinked(self, text: str, file: str, page: str) -> tuple[str, tuple[str, ...]]:
        """A file's text for a page, and the files that the site must show for its links.

        A link to a file that is a page becomes one to that page. A link to another text file or to
        a folder becomes one to a page that shows it. Pictures and links that lead nowhere stay as
        they are; Sphinx complains of the latter.

        Args:
            text: Markdown.
            file: Where it is from, relative to the repository.
            page: The page that it goes on.
        """
        pages = {name: page for page, name in self.files.items()} | {"README.md": INDEX}
        shown: dict[str, None] = {}

        def target(match: re.Match[str]) -> str:
            link, place = match[1], match[2] or ""
            if re.match(r"[a-z]+:", link):
                return link + place
            there = normpath(join(file, "..", link))
            if there in pages:
                return _from(page, f"{pages[there]}.md") + place
            if not _is_shown(self.root / there):
                # Pictures of docs/ lie beside the pages.
                return _from(page, there.removeprefix("docs/")) + place
            # A file that is shown has no headings to lead to.
            shown[there] = None
            return _from(page, f"{source_page(there)}.md")

        return _LINK.sub(target, text), tuple(shown)

    def source_text(self, file: str) -> str:
        """The page that shows a file, or all files of a folder."""
        path = self.root / file
        parts = [f"---\norphan: true\n---\n\n# {file}\n"]
        for each in sorted(_code_in(path)) if path.is_dir() else [path]:
            code = each.read_text(encoding="utf-8")
            if path.is_dir():
                parts.append(f"## {each.relative_to(path).as_posix()}\n")
            parts.append(f"``````{_LANGUAGES.get(each.suffix, 'text')}\n{code}\n``````\n")
        return "\n".join(parts)


def load_navigation(root: Path, path: Path) -> Site:
    """The site that a ``navigation.toml`` describes.

    Raises:
        HarnessError: a file that is not there, or a page of ``docs/`` without a place.
    """
    document = tomllib.loads(path.read_text(encoding="utf-8"))
    sections: list[Section] = []
    files: dict[str, str] = {}
    for section in document["section"]:
        titles = {page: title for page, _, title in section["pages"]}
        sections.append(Section(section["title"], titles))
        files |= {page: file for page, file, _ in section["pages"] if file}
    if absent := [file for file in files.values() if not (root / file).is_file()]:
        raise HarnessError(f"{path} names files that are not there", got=", ".join(absent))
    own = {page.relative_to(root).as_posix() for page in (root / "docs").glob("*.md")}
    if forgotten := sorted(own - set(files.values())):
        raise HarnessError(
            f"{path} has no place for pages", got=", ".join(forgotten), hint="Add them to a section"
        )
    return Site(root, tuple(sections), files)


def readme_section(text: str, heading: str) -> str:
    """What stands under a heading of the README; all before its first one where it is empty.

    Raises:
        HarnessError: there is no such heading.
    """
    parts = re.split(r"^## (.+)$", text, flags=re.MULTILINE)
    sections = {"": parts[0]} | dict(zip(parts[1::2], parts[2::2], strict=True))
    if heading not in sections:
        raise HarnessError(
            f"README.md has no section '{heading}'", expected=", ".join(filter(None, sections))
        )
    return sections[heading].strip() + "\n"


def source_page(file: str) -> str:
    """The page that shows a file of the repository."""
    return f"{_SOURCES}/{file}"


def contents(sections: Sequence[Section]) -> str:
    """The first page's lists of all others, which become the navigation."""
    return "\n".join(
        f"```{{toctree}}\n:hidden:\n:caption: {section.title}\n\n"
        + "\n".join(f"{title} <{page}>" for page, title in section.pages.items())
        + "\n```\n"
        for section in sections
    )


def _from(page: str, target: str) -> str:
    return relpath(target, normpath(join(page, "..")))


def _is_shown(path: Path) -> bool:
    return path.is_dir() or (path.is_file() and path.suffix in _LANGUAGES)


def _code_in(folder: Path) -> Iterator[Path]:
    return (path for path in folder.rglob("*") if path.suffix in _LANGUAGES and path.is_file())

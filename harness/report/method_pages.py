"""The description of a method, as text for a terminal and as Markdown for the documentation."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping, Sequence

from harness.core.protocols import Deviation, MethodInfo

_WIDTH = 100


def text_page(info: MethodInfo) -> str:
    """A method's views, parts, privileges, settings and deviations, for a terminal."""
    lines = [f"{info.name}: {info.title}", "", f"Views: {_views(info)}"]
    if info.needs_perspective:
        lines += [f"No orthographic photos: {info.needs_perspective}"]
    lines += ["", "Parts"]
    lines += [f"  {role}: {text}" for role, text in _parts(info)]
    lines += ["", "Privileges (what it is given beyond pixels)"]
    for privilege in info.privileges:
        lines += [f"  {privilege.label}", *_indented("", privilege.sentence)]
    lines += ["", "Settings (--set NAME=VALUE)"]
    lines += [f"  {path} = {value}" for path, value in _settings(info.parameters)]
    if info.deviations:
        lines += ["", f"Deviations from the publication ({len(info.deviations)})"]
        for deviation in info.deviations:
            lines += [
                f"  {deviation.what}",
                *_indented("published", deviation.published),
                *_indented("here", deviation.here),
                *_indented("why", deviation.why),
            ]
    else:
        lines += ["", "Deviations: none listed, because the method carries no publication's name"]
    return "\n".join(lines)


def markdown_pages(infos: Sequence[MethodInfo]) -> str:
    """All methods as one Markdown document: what they see, then each deviation once."""
    lines = [
        "# Methods",
        "",
        "Written by `harness methods docs`; `harness methods show NAME` prints one with its "
        "parts and settings.",
        "",
        "| name | title | views | given beyond pixels | deviations |",
        "|---|---|---|---|---:|",
    ]
    of: dict[Deviation, list[str]] = {}
    for info in infos:
        given = ", ".join(privilege.label for privilege in info.privileges)
        cells = (info.title, _views(info), given, str(len(info.deviations)))
        lines.append(f"| `{info.name}` | {' | '.join(cells)} |")
        for deviation in info.deviations:
            of.setdefault(deviation, []).append(f"`{info.name}`")
    lines += ["", "## Deviations from the publications", "", *_deviations(of)]
    return "\n".join(lines) + "\n"


def _deviations(of: Mapping[Deviation, Sequence[str]]) -> Iterator[str]:
    """A table for each set of methods, so that what they share is said once."""
    groups: dict[tuple[str, ...], list[Deviation]] = {}
    for deviation, names in of.items():
        groups.setdefault(tuple(names), []).append(deviation)
    for names, deviations in groups.items():
        yield f"### Of {', '.join(names)}"
        yield ""
        yield "| deviation | published | here | why |"
        yield "|---|---|---|---|"
        for entry in deviations:
            yield f"| {entry.what} | {entry.published} | {entry.here} | {entry.why} |"
        yield ""


def _views(info: MethodInfo) -> str:
    if info.view_count is not None:
        return f"{info.view_count} of all, as evenly apart as can be"
    if info.views is None:
        return "all"
    return ", ".join(str(view) for view in info.views)


def _parts(info: MethodInfo) -> Iterator[tuple[str, str]]:
    for part in info.parts:
        sha = f", sha256 {part.sha256[:12]}" if part.sha256 else ""
        yield part.role, f"{part.name} ({part.licence}{sha})"


def _settings(parameters: Mapping[str, object], prefix: str = "") -> Iterator[tuple[str, object]]:
    """Every setting by its full name."""
    for name, value in parameters.items():
        if isinstance(value, Mapping):
            nested = {str(key): entry for key, entry in value.items()}
            yield from _settings(nested, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def _indented(label: str, text: str) -> list[str]:
    first = f"    {label:10}" if label else "    "
    return textwrap.wrap(text, _WIDTH, initial_indent=first, subsequent_indent=" " * len(first))

"""``harness methods``: what there is to run, what each is given, and how it differs from print."""

import textwrap
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated

import typer

from harness.cli.display import deliver, print_json
from harness.cli.options import Json, Parts, Set, WorkspacePath, parsed_settings
from harness.cli.verb_list import verb_group
from harness.core.protocols import Deviation, MethodInfo
from harness.run.added_methods import AddedMethods
from harness.run.method_choice import OPEN, ChosenMethod, catalogued_methods, parsed_parts
from harness.run.workspace import Workspace

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
    if len(info.views) > 2 and info.views == tuple(range(len(info.views))):
        return f"0 to {info.views[-1]}"
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


app = verb_group("methods")


@app.command("list")
def list_methods(workspace: WorkspacePath = None, as_json: Json = False) -> None:
    """List every method with its title, how many views it uses, and what it is given."""
    catalogued = catalogued_methods(AddedMethods.of(Workspace.default(workspace)))
    infos = {method.name: method.info for method in catalogued.usable}
    failures = {name: str(error) for name, error in catalogued.failures.items()}
    missing = {name: str(error) for name, error in catalogued.missing.items()}
    if as_json:
        found = {name: info.to_dict() for name, info in infos.items()}
        print_json({"methods": found, "unusable": failures, "missing": missing})
        return
    for name, info in infos.items():
        count = "all" if info.views is None else str(len(info.views))
        given = ", ".join(privilege.label for privilege in info.privileges)
        print(f"{name:18} {info.title:42} views {count:4} given: {given or 'pixels alone'}")
    for name, why in missing.items():
        print(f"{name:18} missing: {why}")
    for name, why in failures.items():
        print(f"{name:18} cannot be used: {why}")


@app.command("show")
def show(
    name: Annotated[
        str,
        typer.Argument(
            metavar="METHOD", help="Name of a method; 'harness methods list' names them."
        ),
    ],
    settings: Set = None,
    parts: Parts = OPEN,
    workspace: WorkspacePath = None,
    as_json: Json = False,
) -> None:
    """Show a method's views, parts, privileges and settings, and how it differs from its paper."""
    added = AddedMethods.of(Workspace.default(workspace))
    chosen = ChosenMethod.of(
        name, parsed_settings(settings), parts=parsed_parts(parts), added=added
    )
    info = chosen.info
    if as_json:
        print_json(info.to_dict())
    else:
        print(text_page(info))


@app.command("add")
def add(
    path: Annotated[
        Path,
        typer.Argument(metavar="FILE", help="The method's method.toml, or the folder with it."),
    ],
    workspace: WorkspacePath = None,
    as_json: Json = False,
) -> None:
    """Add a method that runs in an environment of its own to the workspace.

    It stays where it is. From then on 'harness eval' runs it by its name. All files in its folder,
    and all that is installed in its environment, count in its records.
    """
    method = AddedMethods.of(Workspace.default(workspace)).add(path)
    info = method.info
    if as_json:
        print_json({"folder": str(method.file.folder), **info.to_dict()})
        return
    print(f"{info.name}: {info.title}, from {method.file.folder}")
    print(f"environment: {method.environment().text}")
    print(f"Next: harness eval --method {info.name}")


@app.command("remove")
def remove(
    name: Annotated[str, typer.Argument(metavar="METHOD", help="Name of a method that was added.")],
    workspace: WorkspacePath = None,
) -> None:
    """Take a method that was added from the workspace; its folder and its records stay."""
    folder = AddedMethods.of(Workspace.default(workspace)).remove(name)
    print(f"{name} is no method of the workspace any more; {folder} stays")


@app.command("docs")
def docs(
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", metavar="FILE", help="Markdown file to write. Default: print it."
        ),
    ] = None,
) -> None:
    """Write one Markdown page that describes all methods."""
    deliver(markdown_pages([method.info for method in catalogued_methods().usable]), output)

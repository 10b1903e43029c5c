"""``harness methods``: what there is to run, what each is given, and how it differs from print."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from harness.cli.display import deliver, print_json
from harness.cli.options import Json, Parts, Set, WorkspacePath, parsed_settings
from harness.cli.verb_list import verb_group
from harness.report.method_pages import markdown_pages, text_page
from harness.run.added_methods import AddedMethods
from harness.run.method_choice import OPEN, ChosenMethod, catalogued_methods, parsed_parts
from harness.run.workspace import Workspace

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

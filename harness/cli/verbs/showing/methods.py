"""``harness methods``: what there is to run, what each is given, and how it differs from print."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from harness.cli.options import Json, Set, parsed_settings
from harness.cli.output import deliver, print_json
from harness.cli.verb_list import verb_group
from harness.pipeline.report.method_pages import markdown_pages, text_page
from harness.pipeline.run.chosen_method import ChosenMethod, catalogued_methods

__all__ = ["app"]

app = verb_group("methods")


@app.command("list")
def list_methods(as_json: Json = False) -> None:
    """List every method with its title, how many views it uses, and what it is given."""
    catalogued = catalogued_methods()
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
    as_json: Json = False,
) -> None:
    """Show a method's views, parts, privileges and settings, and how it differs from its paper."""
    info = ChosenMethod.of(name, parsed_settings(settings)).info
    if as_json:
        print_json(info.to_dict())
    else:
        print(text_page(info))


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

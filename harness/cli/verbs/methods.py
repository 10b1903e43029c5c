"""``harness methods``: what there is to run, what each is given, and how it differs from print."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from harness.cli.options import Json, Set, parsed_settings

__all__ = ["app"]

app = typer.Typer(
    help="List methods, and show one with its views, parts, privileges, settings and deviations.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


@app.command("list")
def list_methods(as_json: Json = False) -> None:
    """List every method with its title, how many views it uses, and what it is given."""
    from harness.pipeline.run.chosen_method import catalogued_methods

    catalogued = catalogued_methods()
    infos = {method.name: method.info for method in catalogued.usable}
    failures = {name: str(error) for name, error in catalogued.failures.items()}
    if as_json:
        found = {name: info.to_dict() for name, info in infos.items()}
        print(json.dumps({"methods": found, "unusable": failures}, indent=2))
        return
    for name, info in infos.items():
        count = "all" if info.views is None else str(len(info.views))
        given = ", ".join(privilege.label for privilege in info.privileges)
        print(f"{name:14} {info.title:42} views {count:4} given: {given or 'pixels alone'}")
    for name, why in failures.items():
        print(f"{name:14} cannot be used: {why}")


@app.command("show")
def show(
    name: Annotated[str, typer.Argument(help="A method's name.")],
    settings: Set = None,
    as_json: Json = False,
) -> None:
    """Show one method: views, parts, privileges, settings, and every deviation from print."""
    from harness.pipeline.report.method_pages import text_page
    from harness.pipeline.run.chosen_method import ChosenMethod

    info = ChosenMethod.of(name, parsed_settings(settings)).info
    print(json.dumps(info.to_dict(), indent=2) if as_json else text_page(info))


@app.command("docs")
def docs(
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Markdown file. Default: print it.")
    ] = None,
) -> None:
    """Write the documentation page of all methods as Markdown."""
    from harness.core.files.atomic import write_text
    from harness.pipeline.report.method_pages import markdown_pages
    from harness.pipeline.run.chosen_method import catalogued_methods

    page = markdown_pages([method.info for method in catalogued_methods().usable])
    if output is None:
        print(page, end="")
    else:
        write_text(output, page)

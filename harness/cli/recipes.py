"""``harness recipes``: methods of others, what each needs, and where the user has it."""

import subprocess
from pathlib import Path
from typing import Annotated

import typer

from harness.cli.display import print_json
from harness.cli.options import Json
from harness.cli.verb_list import verb_group
from harness.core.errors import HarnessError, MissingPart
from harness.core.typed_json import to_json
from methods.foreign.recipes import Recipe, recipe_names

app = verb_group("recipes")
Name = Annotated[
    str, typer.Argument(metavar="NAME", help="A recipe; 'harness recipes list' names them.")
]


@app.command("list")
def list_recipes(as_json: Json = False) -> None:
    """List every recipe: its row, what it answers with, its licence, and whether it can run."""
    found = [_state(Recipe.of(name)) for name in recipe_names()]
    if as_json:
        print_json(found)
        return
    for each in found:
        print(f"{each['name']:16} {each['row']:16} {each['result']:10} {each['licence']}")
        print(f"{'':16} {each['missing'] or 'installed'}")


@app.command("show")
def show(name: Name, as_json: Json = False) -> None:
    """Show what a recipe needs: source, packages, downloads, what has to be accepted."""
    recipe = Recipe.of(name)
    if as_json:
        print_json({**_state(recipe), "needs": to_json(recipe.needs)})
        return
    needs = recipe.needs
    print(f"{recipe.name}: {recipe.method.title}, row {recipe.method.name}")
    print(f"    licence   {recipe.method.licence}")
    print(f"    source    {needs.source} {needs.commit}".rstrip())
    print(f"    packages  {recipe.method.folder / needs.environment}")
    if needs.network:
        print(f"    weights   {needs.network}, {needs.network_licence}")
    for each in needs.downloads:
        print(f"    download  {each.what}: {each.get}")
        print(f"              sha256 {each.sha256 or 'not published; noted when installed'}")
    if needs.gated:
        print(f"    accept    {needs.gated}")
    if needs.gpu_gib:
        print(f"    GPU       {needs.gpu_gib:g} GiB")
    print(f"    not tried {needs.untested}")
    print(f"    state     {_state(recipe)['missing'] or 'installed'}")


@app.command("install")
def install(
    name: Name,
    python: Annotated[
        Path | None, typer.Option("--python", metavar="FILE", help="Its Python interpreter.")
    ] = None,
    checkout: Annotated[
        Path | None,
        typer.Option("--checkout", metavar="DIR", help="Its source, with its data."),
    ] = None,
    weights: Annotated[
        Path | None,
        typer.Option("--weights", metavar="PATH", help="Its weights, file or folder."),
    ] = None,
    run: Annotated[
        bool, typer.Option("--run", help="Get the source and make the environment now.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Note what you have of a recipe, with its sums, and say what is missing.

    Nothing is copied. Weights, and what has to be accepted, are never downloaded. The exit code is
    4 while something is missing.
    """
    recipe = Recipe.of(name)
    if run:
        _carry_out(recipe)
        made = recipe.place / "env/bin/python"
        python = python or (made if made.is_file() else None)
        checkout = checkout or (recipe.place / "checkout" if recipe.needs.checkout else None)
    if python or checkout or weights:
        recipe.note(python, checkout, weights)
    try:
        recipe.require()
    except MissingPart as error:
        if not as_json:
            for words in recipe.steps():
                print(" ".join(words))
            print(f"or: {recipe.command} --run")
            for each in recipe.needs.downloads:
                print(f"then get {each.what}: {each.get}")
        if not (recipe.place / "installed.json").is_file():
            error = _first(recipe, error)
        raise error from None
    if as_json:
        print_json(_state(recipe))
    else:
        print(f"{recipe.name} is installed. Next: harness eval --method {recipe.method.name}")


def _first(recipe: Recipe, error: MissingPart) -> MissingPart:
    """What to run once the commands above have been run."""
    needs = recipe.needs
    options = ["--python PYTHON"] + ["--checkout DIR"] * bool(needs.checkout)
    options += ["--weights PATH"] * bool(needs.network)
    return MissingPart(error.what, hint=f"Run: {recipe.command} {' '.join(options)}")


def _carry_out(recipe: Recipe) -> None:
    recipe.place.mkdir(parents=True, exist_ok=True)
    for words in recipe.steps():
        print(" ".join(words), flush=True)
        try:
            status = subprocess.run(words, check=False).returncode
        except OSError as error:
            raise MissingPart(f"{words[0]} is not installed", got=error.strerror or "") from error
        if status:
            raise HarnessError(
                f"'{' '.join(words[:3])}' ended with exit status {status}",
                hint=f"Mend it, delete {recipe.place}, and run it again",
            )


def _state(recipe: Recipe) -> dict[str, str]:
    try:
        recipe.require()
        missing = ""
    except HarnessError as error:
        missing = str(error)
    method = recipe.method
    return {
        "name": recipe.name,
        "row": method.name,
        "result": method.result,
        "licence": method.licence,
        "missing": missing,
    }

"""``harness weights``: the networks that estimate normals, shipped and your own."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from harness.cli.options import Json

__all__ = ["app"]

app = typer.Typer(
    help="List, import and verify normal networks.", no_args_is_help=True, rich_markup_mode=None
)
_MARKS = {"ok": "ok", "missing": "MISSING", "corrupt": "CORRUPT"}


@app.command("list")
def list_networks(as_json: Json = False) -> None:
    """The networks that are there: size, licence, training set, sum, and where."""
    from methods.normals import installed

    places = (installed.shipped_place(), installed.imported_place())
    networks = [network for place in places for network in installed.listed(place)]
    if as_json:
        print(json.dumps([network.to_dict() for network in networks], indent=2))
        return
    for network in networks:
        print(
            f"{network.name:16} {network.bytes / 2**20:6.1f} MiB  {network.sha256[:12]}  "
            f"{network.place.title:8}  {network.licence}, "
            f"{network.training_set or 'training set not said'}"
        )
    if not networks:
        print(f"no network is shipped, and none in {installed.imported_place().folder}")


@app.command("import")
def import_network(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="An ONNX file.")],
    name: Annotated[
        str, typer.Option("--name", help="How it will be asked for. Default: the file's name.")
    ] = "",
    replace: Annotated[
        bool, typer.Option("--replace", help="Take the place of another one of that name.")
    ] = False,
    ship: Annotated[
        bool, typer.Option("--ship", help="Into this checkout's package, to be shipped with it.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Check a network, copy it to your own folder and enter its sum.

    The folder is HARNESS_WEIGHTS, or mexecon-harness/weights below your data folder.
    """
    from methods.normals import installed

    place = installed.shipped_place() if ship else installed.imported_place()
    network = installed.import_file(file, name or file.stem, place, replace=replace)
    if as_json:
        print(json.dumps(network.to_dict(), indent=2))
        return
    print(f"{network.name}: {network.licence}, sha256 {network.sha256[:12]}, at {network.path}")
    onnx = f"surface.normals=onnx --set surface.normals_model={network.name}"
    chosen = "surface.normals=open" if ship else onnx
    print(f"Next: harness eval --method econ --set {chosen}")


@app.command("verify")
def verify(
    names: Annotated[
        list[str] | None, typer.Argument(metavar="[NAME]...", help="Default: all.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Compare files with their sums; exit 1 if one is missing or another one."""
    from methods.normals import installed

    checks = installed.check(names or ())
    if as_json:
        print(json.dumps([check.to_dict() for check in checks], indent=2))
    else:
        for check in checks:
            network = check.network
            print(f"{_MARKS[check.state]:8} {network.name:16} {network.place.title:8} {check.note}")
        if not checks:
            print("no network to verify")
    if any(check.state != "ok" for check in checks):
        raise typer.Exit(1)

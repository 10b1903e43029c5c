"""``harness weights``: the networks that estimate normals, shipped and your own."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from harness.cli.options import Json
from harness.cli.output import print_json
from harness.cli.verb_list import verb_group
from methods.normals import installed

__all__ = ["app"]

app = verb_group("weights")
_MARKS = {"ok": "ok", "missing": "MISSING", "corrupt": "CORRUPT"}


@app.command("list")
def list_networks(as_json: Json = False) -> None:
    """List the networks that are there: size, licence, training set, checksum and place."""
    places = (installed.shipped_place(), installed.imported_place())
    networks = [network for place in places for network in installed.listed(place)]
    if as_json:
        print_json([network.to_dict() for network in networks])
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
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Network to import, an ONNX file.")],
    name: Annotated[
        str,
        typer.Option(
            "--name",
            metavar="NAME",
            help="Name by which settings choose the network. Default: the file's name.",
        ),
    ] = "",
    replace: Annotated[
        bool, typer.Option("--replace", help="Replace an imported network of the same name.")
    ] = False,
    ship: Annotated[
        bool,
        typer.Option(
            "--ship",
            help="Import into this source checkout's package, so that it is installed with it.",
        ),
    ] = False,
    as_json: Json = False,
) -> None:
    """Check a network, copy it to your own folder, and note its checksum.

    The folder is the one that HARNESS_WEIGHTS names, or else mexecon-harness/weights below your
    data folder.
    """
    place = installed.shipped_place() if ship else installed.imported_place()
    network = installed.import_file(file, name or file.stem, place, replace=replace)
    if as_json:
        print_json(network.to_dict())
        return
    print(f"{network.name}: {network.licence}, sha256 {network.sha256[:12]}, at {network.path}")
    onnx = f"surface.normals=onnx --set surface.normals_model={network.name}"
    chosen = "surface.normals=open" if ship else onnx
    print(f"Next: harness eval --method econ --set {chosen}")


@app.command("verify")
def verify(
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="[NAME]...", help="Networks to verify. Default: all."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Compare the networks' files with their checksums.

    The exit code is 1 when a file is missing or is not the one that was imported.
    """
    checks = installed.check(names or ())
    if as_json:
        print_json([check.to_dict() for check in checks])
    else:
        for check in checks:
            network = check.network
            print(f"{_MARKS[check.state]:8} {network.name:16} {network.place.title:8} {check.note}")
        if not checks:
            print("no network to verify")
    if any(check.state != "ok" for check in checks):
        raise typer.Exit(1)

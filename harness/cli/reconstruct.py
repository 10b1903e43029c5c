"""``harness reconstruct``: a mesh, a body and a sheet of a person in photos."""

from pathlib import Path
from typing import Annotated

import typer

from harness.cli import options as opt
from harness.cli.display import print_json, shown_progress
from harness.cli.options import limit_s, parsed_settings, split_names
from harness.cli.verb_list import verb_group
from harness.core.typed_json import to_json
from harness.data.manifest import load_manifest
from harness.photos.one_photo import ASSUMED_HEIGHT_M
from harness.photos.reconstruct import Assumptions, Reconstructed, ReconstructRequest, reconstruct
from harness.run.added_methods import AddedMethods
from harness.run.method_choice import chosen_methods
from harness.run.workspace import Workspace

app = verb_group("reconstruct")

What = Annotated[
    str,
    typer.Argument(
        metavar="CAPTURE",
        help="Name of an imported capture, a folder of photos or with a capture.json, or a photo.",
    ),
]
Output = Annotated[
    Path | None,
    typer.Option(
        "--output", "-o", metavar="DIR", help="Folder for results. Default: the capture's name."
    ),
]
Field = Annotated[
    float | None,
    typer.Option(
        "--fov",
        metavar="DEGREES",
        help="Field of view of photos without cameras, along their longer side. Default: as their "
        "files tell; else 50 for one photo, and for several it is found.",
    ),
]
Height = Annotated[
    float | None,
    typer.Option(
        "--height",
        metavar="METRES",
        help="How high the person in the photos is. "
        f"Default for one photo: {ASSUMED_HEIGHT_M:g}, which is assumed.",
    ),
]
Mask = Annotated[
    Path | None,
    typer.Option(
        "--mask", metavar="PATH", help="Mask of one photo, or folder of masks, white on black."
    ),
]
Name = Annotated[
    str,
    typer.Option(
        "--name", metavar="NAME", help="Name of the capture that a photo or a folder becomes."
    ),
]


@app.command()
def reconstruct_photos(
    what: What,
    method: opt.MethodsToRun = "",
    output: Output = None,
    field: Field = None,
    height: Height = None,
    mask: Mask = None,
    name: Name = "",
    settings: opt.Set = None,
    seed: opt.Seed = 0,
    timeout: opt.Timeout = 3600.0,
    workspace: opt.WorkspacePath = None,
    manifest: opt.ManifestPath = None,
    as_json: opt.Json = False,
) -> None:
    """Reconstruct a person from photos.

    The method is mexecon+ by default, and econ for one photo. Each method's folder gets the mesh
    with colours (PLY, GLB, OBJ), the fitted body, a sheet of pictures and the figures. Cameras of a
    folder of photos are those of a file in it, or found from the photos and --height; of one photo,
    camera and size are assumed. All of it is said. The exit code is 1 when a method failed.
    """
    place = Workspace.default(workspace)
    added = AddedMethods.of(place)
    names = split_names(method) or (("econ",) if Path(what).is_file() else ("mexecon+",))
    request = ReconstructRequest(
        what=what,
        methods=chosen_methods(names, parsed_settings(settings), added=added),
        output=output,
        manifest=load_manifest(manifest),
        workspace=place,
        assumed=Assumptions(field, height, mask),
        name=name,
        seed=seed,
        timeout_s=limit_s(timeout),
    )
    with shown_progress(quiet=as_json) as progress:
        done = reconstruct(request, progress)
    if as_json:
        print_json(to_json(done))
    else:
        _show(done)
    if not done.all_ok:
        raise typer.Exit(1)


def _show(done: Reconstructed) -> None:
    for line in done.notes:
        print(f"  {line}")
    for line in done.warnings:
        print(f"  warning: {line}")
    for outcome in done.outcomes:
        if outcome.result is None:
            print(f"{outcome.method}: no mesh: {outcome.failure}")
            continue
        iou = outcome.result.silhouette_iou
        print(
            f"{outcome.method}: {outcome.result.folder} (silhouettes: IoU "
            f"{sum(iou) / len(iou):.3f} in the mean, {min(iou):.3f} in the worst photo)"
        )

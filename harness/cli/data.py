"""``harness data``: what is measured on, and whether it is there."""

from pathlib import Path
from typing import Annotated

import typer

from harness.cli import options as opt
from harness.cli.display import print_json, print_outcomes, shown_progress
from harness.cli.options import split_names
from harness.cli.verb_list import verb_group
from harness.data.manifest import load_manifest
from harness.run.add_dataset import add_dataset
from harness.run.captures import make_avatars, show_avatar
from harness.run.inventory import check_tree, overview
from harness.run.scan_rules import UNSTATED_LICENCE, Added, AddRequest
from harness.run.sources import Source
from harness.run.workspace import Workspace

app = verb_group("data")
_MARKS = {"present": "ok", "missing": "MISSING", "corrupt": "CORRUPT"}

Scale = Annotated[
    str,
    typer.Option(
        "--scale",
        metavar="RULE",
        help="What the files' units are: metres, cm, mm, height=1.75 (metres, for every scan), "
        "units (kept as they are), or fit where there are SMPL-X fits.",
    ),
]
Facing = Annotated[
    str,
    typer.Option(
        "--facing",
        metavar="WHERE",
        help="Where people look once they stand: +z, -z, +x, -x, degrees from +z towards +x, "
        "ID=DEGREES,... for each, or fit where there are SMPL-X fits.",
    ),
]
Up = Annotated[
    str,
    typer.Option(
        "--up",
        metavar="AXIS",
        help="Which axis of the files points up, such as +y or +z. Default: +y for GLB files and "
        "for trees as THuman's, which say so.",
    ),
]
Licence = Annotated[
    str,
    typer.Option(
        "--licence",
        metavar="TEXT",
        help=f"Licence of the scans or photos. Default: {UNSTATED_LICENCE}.",
    ),
]

Copy = Annotated[
    bool,
    typer.Option("--copy", help="Convert a tree as THuman's, too, and do not read it in place."),
]
DropHidden = Annotated[
    bool,
    typer.Option(
        "--drop-hidden",
        help="Leave out what no ray from outside reaches, as a body under its clothes: the truth "
        "is then the outer surface.",
    ),
]

Frame = Annotated[
    int | None,
    typer.Option(
        "--frame",
        metavar="N",
        help="Which frame of each sequence of a data set of the field. Default: the first.",
    ),
]
SkipBad = Annotated[
    bool, typer.Option("--skip-bad", help="Leave out subjects that cannot be used.")
]
DatasetName = Annotated[
    str, typer.Argument(metavar="DATASET", help="Dataset or split, as in the manifest.")
]


@app.command("list")
def list_datasets(
    workspace: opt.WorkspacePath = None,
    manifest: opt.ManifestPath = None,
    as_json: opt.Json = False,
) -> None:
    """List the datasets, splits, recipes and protocols of the manifest."""
    listing = overview(load_manifest(manifest), Workspace.default(workspace))
    if as_json:
        print_json(listing)
        return
    for kind, entries in listing.items():
        by = " with 'harness data add NAME DIR'" if kind == "addable" else ""
        print(f"{kind}{by}:")
        for name, text in entries.items():
            print(f"  {name:20} {text}")


@app.command("check")
def check_dataset(
    dataset: DatasetName,
    subjects: opt.Subjects = "",
    workspace: opt.WorkspacePath = None,
    manifest: opt.ManifestPath = None,
    as_json: opt.Json = False,
) -> None:
    """List the files that a dataset needs, and which of them are present, missing or corrupt.

    Of scans of your own, a table says how much of each no ray from outside reaches, and whether it
    is watertight. The exit code is 1 when a file is missing or corrupt.
    """
    tree = check_tree(
        load_manifest(manifest), Workspace.default(workspace), dataset, split_names(subjects)
    )
    if as_json:
        print_json(tree.to_dict())
    else:
        print(tree.heading)
        for entry in tree.files:
            note = f"   {entry.note}" if entry.note else ""
            print(f"  {_MARKS[entry.state]:8} {entry.path}{note}")
        for row in tree.surfaces:
            print(row)
        print(tree.summary)
    if not tree.complete:
        raise typer.Exit(1)


@app.command("add")
def add(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the new dataset.")],
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder with scans or captures.")],
    scale: Scale = "",
    facing: Facing = "",
    up: Up = "",
    title: Annotated[
        str, typer.Option("--title", metavar="TEXT", help="Title in tables. Default: NAME.")
    ] = "",
    licence: Licence = "",
    subjects: opt.Subjects = "",
    grey: Annotated[
        bool, typer.Option("--grey", help="Make scans grey that have no colours.")
    ] = False,
    copy: Copy = False,
    drop_hidden: DropHidden = False,
    frame: Frame = None,
    skip_bad: SkipBad = False,
    replace: Annotated[
        bool, typer.Option("--replace", help="Replace an entry that this command wrote.")
    ] = False,
    workspace: opt.WorkspacePath = None,
    manifest: opt.ManifestPath = None,
    as_json: opt.Json = False,
) -> None:
    """Add a folder of scans or captures to the manifest, after a check of every subject.

    Layouts: a tree as THuman's, mesh files (OBJ, PLY, GLB) side by side or each in a folder, and
    captures. Under the name of a data set of the field, such as cape or customhumans, layout, units
    and splits are known. The exit code is 1 when a subject cannot be used; nothing is added then.
    """
    request = AddRequest(
        name=name,
        folder=folder,
        workspace=Workspace.default(workspace),
        manifest=manifest,
        subjects=split_names(subjects),
        scale=scale,
        facing=facing,
        up=up,
        title=title,
        licence=licence,
        grey=grey,
        copy=copy,
        drop_hidden=drop_hidden,
        replace=replace,
        skip_bad=skip_bad,
        frame=frame,
    )
    with shown_progress(quiet=as_json) as progress:
        added = add_dataset(request, progress)
    if as_json:
        print_json(added)
    else:
        _print_added(added)
    if not added.written:
        raise typer.Exit(1)


def _print_added(added: Added) -> None:
    print(f"{added.name}: {added.layout}; {added.rules}")
    for each in added.subjects:
        print(
            f"  {'FAILED' if each.failure else 'ok':8} {each.subject}: {each.failure or each.note}"
        )
        for warning in each.warnings:
            print(f"           warning: {warning}")
    for note in added.notes:
        print(f"  {note}")
    if not added.written:
        print(f"Nothing was added: {len(added.failed)} of {len(added.subjects)} subjects cannot be "
              "used. Mend them, or leave them out with --skip-bad")  # fmt: skip
        return
    if added.failed:
        print(f"Left out: {', '.join(each.subject for each in added.failed)}")
    new = ", which is new: a copy of the installed manifest" if added.created else ""
    print(f"Added '{added.name}' to {added.manifest}{new}")
    print(f"Next: harness data check {added.name}")
    protocol = f" --protocol {added.protocol}" if added.protocol else ""
    print(f"      harness eval --method hull8 --dataset {added.name}{protocol}")


@app.command("show")
def show(
    subject: Annotated[
        str, typer.Argument(metavar="SUBJECT", help="Id of a generated subject, such as a01.")
    ],
    dataset: opt.Dataset = "avatars",
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", metavar="FILE", help="PNG file to write. Default: SUBJECT.png."
        ),
    ] = None,
    reason: opt.Reason = "",
    workspace: opt.WorkspacePath = None,
    manifest: opt.ManifestPath = None,
) -> None:
    """Draw a generated subject: eight views, its bare geometry, and the body under the clothes."""
    checked = load_manifest(manifest)
    recipe = next(iter(checked.recipes))
    source = Source.select(checked, Workspace.default(workspace), dataset, (subject,), recipe)
    print(show_avatar(source, output or Path(f"{subject}.png"), shown_progress(), reason))


@app.command("make")
def make(
    dataset: DatasetName,
    subjects: opt.Subjects = "",
    jobs: opt.Jobs = 1,
    workspace: opt.WorkspacePath = None,
    manifest: opt.ManifestPath = None,
    as_json: opt.Json = False,
) -> None:
    """Make the subjects of a generated dataset; those that are there and current are kept."""
    checked = load_manifest(manifest)
    place, recipe = Workspace.default(workspace), next(iter(checked.recipes))
    source = Source.select(checked, place, dataset, split_names(subjects), recipe)
    with shown_progress(quiet=as_json) as progress:
        outcomes = make_avatars(source, jobs, progress)
    print_outcomes(outcomes, as_json=as_json)

"""``harness parts``: what a user may bring, what of it is there, and its import."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from harness.cli import options as opt
from harness.cli.display import print_json
from harness.cli.options import split_names
from harness.cli.verb_list import verb_group
from harness.core.errors import HarnessError, did_you_mean
from harness.core.typed_json import to_json
from harness.data.manifest import load_manifest
from harness.run.calibration import CalibrationRequest, calibrate_smplx, forget_smplx
from harness.run.workspace import Workspace
from methods.body.models.smplx_part import SMPLX
from methods.body.smplx_offsets import (
    SmplxOffsets,
    offsets_file,
    offsets_part,
    stored_offsets,
)
from methods.parts.kind import ImportOptions, PartCheck, PartKind, State, all_kinds, part_kind

app = verb_group("parts")
_MARKS = {State.OK: "ok", State.MISSING: "MISSING", State.CORRUPT: "CORRUPT"}


@app.command("list")
def list_parts(as_json: opt.Json = False) -> None:
    """List every kind of part: what it is for, its licence, where to get it, and what is there."""
    if as_json:
        print_json([_document(kind) for kind in all_kinds()])
        return
    for kind in all_kinds():
        about, parts = kind.about, kind.installed()
        print(f"{about.name}: {about.role}, {about.purpose}")
        print(f"    licence  {about.licence}")
        print(f"    source   {about.source}")
        print(f"    files    {', '.join(about.files)}")
        for part in parts:
            size = f"{part.bytes / 2**20:.1f} MiB"
            notes = [part.name, size, f"sha256 {part.sha256[:12]}", part.place, part.licence]
            print(f"    present  {', '.join([*notes, part.note] if part.note else notes)}")
        if not parts:
            print(f"    missing  {about.command}")
        if parts and about.name == SMPLX.about.name:
            offsets = offsets_part()
            note = "" if offsets.sha256 else "; measure them with: harness parts calibrate smplx"
            print(f"    offsets  {offsets.role} {offsets.name}{note}")


@app.command("import")
def import_part(
    kind: Annotated[
        str,
        typer.Argument(metavar="KIND", help="Kind of part; 'harness parts list' names them."),
    ],
    file: Annotated[Path, typer.Argument(metavar="FILE", help="File to import.")],
    name: Annotated[
        str,
        typer.Option(
            "--name",
            metavar="NAME",
            help="Name by which settings choose the part, for kinds that may have several.",
        ),
    ] = "",
    recipe: Annotated[
        str,
        typer.Option(
            "--recipe",
            metavar="NAME",
            help="Which public network the file is: david for normals-onnx; u2net, isnet or "
            "birefnet for masks-onnx.",
        ),
    ] = "",
    replace: Annotated[
        bool, typer.Option("--replace", help="Replace an imported part of the same name.")
    ] = False,
    python: Annotated[
        Path | None,
        typer.Option(
            "--python",
            metavar="FILE",
            help="Python interpreter that runs the part, for kinds that need packages of their "
            "own.",
        ),
    ] = None,
    as_json: opt.Json = False,
) -> None:
    """Check a file, convert it where it has to be, and keep it with its checksum and licence.

    Parts are kept in your own folder: the one that HARNESS_PARTS names, or else
    mexecon-harness/parts below your data folder; networks of the kind normals-onnx in
    HARNESS_WEIGHTS, or mexecon-harness/weights.
    """
    chosen = part_kind(kind)
    options = ImportOptions(name=name, recipe=recipe, python=python, replace=replace)
    part = chosen.add(file, options)
    if as_json:
        print_json(part.to_dict())
        return
    print(f"{part.name}: {part.title}, {part.licence}, sha256 {part.sha256[:12]}, at {part.path}")
    print(f"Next: {chosen.usage(part)}")


@app.command("verify")
def verify(
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[KIND|KIND/NAME]...", help="Parts to verify. Default: all that are there."
        ),
    ] = None,
    as_json: opt.Json = False,
) -> None:
    """Compare the files of the parts with their checksums.

    The exit code is 1 when a file is missing or is not the one that was imported.
    """
    checks = _checks(names or [])
    if as_json:
        print_json([check.to_dict() for check in checks])
    else:
        for check in checks:
            part = check.part
            print(f"{_MARKS[check.state]:8} {part.label:28} {part.place:8} {check.note}")
        if not checks:
            print("no part to verify")
    if any(check.state != State.OK for check in checks):
        raise typer.Exit(1)


@app.command("calibrate")
def calibrate(
    kind: Annotated[
        str, typer.Argument(metavar="KIND", help="Kind of part; only smplx has landmark offsets.")
    ],
    dataset: opt.Dataset = "thuman21",
    subjects: opt.Subjects = "",
    recipe: opt.Recipe = "paper8",
    model: Annotated[
        str,
        typer.Option(
            "--model", metavar="NAME", help="Imported model to fit. Default: the neutral one."
        ),
    ] = "",
    replace: Annotated[
        bool, typer.Option("--replace", help="Replace offsets that were measured before.")
    ] = False,
    forget: Annotated[
        bool,
        typer.Option("--forget", help="Delete the offsets, so that all are zero, as published."),
    ] = False,
    workspace: opt.WorkspacePath = None,
    manifest: opt.ManifestPath = None,
    as_json: opt.Json = False,
) -> None:
    """Measure where MediaPipe marks people, relative to SMPL-X's points of the same names.

    It takes scans of THuman that the manifest does not list, since those are tested on: the bodies
    of their fits are known. By default these are the first 36 with a fit. Photos are rendered,
    people are detected, bodies are fitted. Every later fit of SMPL-X uses the offsets, and its
    records name them.
    """
    if kind != SMPLX.about.name:
        raise HarnessError(
            f"parts of the kind '{kind}' have nothing to calibrate", expected=SMPLX.about.name
        )
    if forget:
        told = forget_smplx()
        if as_json:
            print_json({"done": told})
        else:
            print(told)
        return
    request = CalibrationRequest(
        manifest=load_manifest(manifest),
        workspace=Workspace.default(workspace),
        dataset=dataset,
        subjects=split_names(subjects),
        recipe=recipe,
        model=model,
        replace=replace,
    )
    found = calibrate_smplx(request, lambda line: print(line, file=sys.stderr, flush=True))
    if as_json:
        print_json(to_json(found))
    else:
        _show_offsets(found)


def _show_offsets(found: SmplxOffsets) -> None:
    print("landmark   offset x, y, z (mm)      spread (mm)")
    for each in found.measured:
        x, y, z = each.offset_mm
        print(f"{each.landmark:8} {x:8.1f} {y:8.1f} {z:8.1f} {each.spread_mm:12.1f}")
    print(f"{found.title}, kept at {offsets_file()}")
    print("Next: harness eval --method mexecon8 --set body.model=smplx")


def _document(kind: PartKind) -> dict[str, object]:
    parts = [part.to_dict() for part in kind.installed()]
    document = {**kind.about.to_dict(), "state": "present" if parts else "missing", "parts": parts}
    if kind.about.name == SMPLX.about.name:
        measured = stored_offsets()
        document["offsets"] = to_json(measured) if measured else None
    return document


def _checks(names: list[str]) -> list[PartCheck]:
    """The parts of some kinds or labels, or all, against their sums."""
    found = [(kind, part) for kind in all_kinds() for part in kind.installed()]
    known = {part.kind for _, part in found} | {part.label for _, part in found}
    for name in names:
        if name not in known:
            raise HarnessError(f"no part '{name}' is there", hint=did_you_mean(name, known))
    return [
        kind.check(part)
        for kind, part in found
        if not names or part.kind in names or part.label in names
    ]

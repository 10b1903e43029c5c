"""``harness results``: hand results in, score them again, and put them on a board."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from harness.board.copying import (
    changed_entries,
    changes_markdown,
    compare_boards,
    export_results,
    merge_entry,
    withheld,
)
from harness.board.entries import Entry, entries_in
from harness.board.page import write_board_page
from harness.board.verify import NO_RECORD, Truths, Verification, verify_entry
from harness.cli import options as opt
from harness.cli.display import print_json, shown_progress
from harness.cli.options import split_names
from harness.cli.verb_list import verb_group
from harness.core.errors import HarnessError, did_you_mean
from harness.core.records import Record
from harness.core.typed_json import to_json
from harness.data.manifest import load_manifest
from harness.report.tables import in_order, scores_of
from harness.run.frames import write_record_file
from harness.run.store import RunStore
from harness.run.workspace import Workspace

app = verb_group("results")

Submission = Annotated[
    Path, typer.Argument(metavar="FOLDER", help="Results as 'harness results export' writes them.")
]
Board = Annotated[
    Path, typer.Argument(metavar="BOARD", help="Folder of the board, which has the same form.")
]
Target = Annotated[Path, typer.Argument(metavar="FOLDER", help="Folder to write.")]
Version = Annotated[
    str,
    typer.Option("--version", metavar="TEXT", help="What you call this version of the method."),
]
Complete = Annotated[
    str,
    typer.Option(
        "--dataset",
        metavar="NAME",
        help="Dataset or split of which no subject may be missing. Default: the records' dataset.",
    ),
]
Since = Annotated[
    Path | None,
    typer.Option(
        "--since",
        metavar="BOARD",
        help="Only results that this board does not have, or has with other files.",
    ),
]


@app.command()
def export(
    folder: Target,
    version: Version,
    run: opt.Run = None,
    method: opt.MethodsToShow = "",
    subjects: opt.Subjects = "",
    workspace: opt.WorkspacePath = None,
    manifest: opt.ManifestPath = None,
) -> None:
    """Write records and meshes of a run as results that can be handed in.

    A method that is given the scan hands it back. Where the dataset's licence does not let it be
    passed on, such a method is left out, and refused if --method names it.
    """
    store = RunStore.existing(Workspace.default(workspace), run)
    found = _chosen(store, method, subjects)
    scans = withheld(found, load_manifest(manifest))
    for name, why in scans.items():
        what = f"the meshes of {name} are scans that may not be passed on ({why})"
        if name in split_names(method):
            raise HarnessError(what, hint="Leave it out of --method")
        print(f"left out: {what}", file=sys.stderr)
    kept = [record for record in found if record.method_name not in scans]
    for entry in export_results(store, kept, version, folder):
        print(f"{entry.directory}: {len(entry.subjects())} subjects")


@app.command()
def records(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="File to write, or to replace.")],
    run: opt.Run = None,
    method: opt.MethodsToShow = "",
    subjects: opt.Subjects = "",
    workspace: opt.WorkspacePath = None,
) -> None:
    """Write the records of a run into one file, without meshes.

    'harness report --records FILE' makes tables from it. Scores under further protocols go into a
    file beside it.
    """
    store = RunStore.existing(Workspace.default(workspace), run)
    found = _chosen(store, method, subjects)
    write_record_file(found, file)
    if (scores := scores_of(store, found)).cells:
        scores.save(file)
    print(f"{file}: {len(found)} records")


@app.command()
def verify(
    folder: Submission,
    dataset: Complete = "",
    method: opt.MethodsToShow = "",
    since: Since = None,
    reason: opt.Reason = "",
    workspace: opt.WorkspacePath = None,
    manifest: opt.ManifestPath = None,
    as_json: opt.Json = False,
) -> None:
    """Score the meshes of results again, and compare.

    The exit code is 1 when a subject is missing, a mesh is another one, or a number differs.
    """
    truths = Truths(load_manifest(manifest), Workspace.default(workspace), dataset, reason)
    entries = entries_in(folder, split_names(method))
    if since is not None:
        new = changed_entries(since, folder)
        entries = tuple(entry for entry in entries if entry in new)
    with shown_progress(quiet=as_json) as progress:
        found = [verify_entry(entry, truths, progress) for entry in entries]
    if as_json:
        print_json([to_json(one) for one in found])
    else:
        for one in found:
            _print(one)
        if not found:
            print("Nothing is new")
    if any(one.findings for one in found):
        raise typer.Exit(1)


@app.command()
def merge(
    folder: Submission,
    board: Board,
    dataset: Complete = "",
    method: opt.MethodsToShow = "",
    reason: opt.Reason = "",
    workspace: opt.WorkspacePath = None,
    manifest: opt.ManifestPath = None,
) -> None:
    """Verify results, put them on a board, and say what changes.

    The exit code is 1 when something is wrong with some of them, which stay away.
    """
    truths = Truths(load_manifest(manifest), Workspace.default(workspace), dataset, reason)
    with shown_progress() as progress:
        faulty = False
        for entry in entries_in(folder, split_names(method)):
            found = verify_entry(entry, truths, progress)
            if found.findings:
                faulty = True
                _print(found)
                print(f"{entry.title} does not go on the board")
                continue
            print(merge_entry(entry, found, Entry(board, entry.method, entry.version)))
    if faulty:
        raise typer.Exit(1)


@app.command()
def compare(
    base: Annotated[Path, typer.Argument(metavar="BASE", help="Board as it is.")],
    head: Annotated[Path, typer.Argument(metavar="HEAD", help="Board as it would be.")],
    as_json: opt.Json = False,
) -> None:
    """Say in Markdown what one board changes in comparison with another.

    The exit code is 1 when a new version lacks subjects that the method's last version has, or when
    a version that is there already is changed or removed.
    """
    changes = compare_boards(base, head)
    if as_json:
        print_json([to_json(change) for change in changes])
    else:
        print(changes_markdown(changes), end="")
    if any(change.faults for change in changes):
        raise typer.Exit(1)


@app.command()
def page(
    board: Board,
    folder: Annotated[
        Path,
        typer.Option("--output", "-o", metavar="FOLDER", help="Page to write, or to replace."),
    ],
    title: Annotated[
        str, typer.Option("--title", metavar="TEXT", help="Heading of the page.")
    ] = "Leaderboard",
) -> None:
    """Write a leaderboard as a page of files that opens without a network."""
    print(write_board_page(board, folder, title, lambda line: print(line, file=sys.stderr)))


def _chosen(store: RunStore, method: str, subjects: str) -> list[Record]:
    """The records of a run that options name; all, where they name none.

    Raises:
        HarnessError: a method or subject without a record.
    """
    chosen, records = split_names(subjects), in_order(store.records(), split_names(method))
    known = {record.subject for record in records}
    for subject in chosen:
        if subject not in known:
            hint = did_you_mean(subject, known)
            raise HarnessError(f"no record of subject '{subject}'", hint=hint)
    return [record for record in records if not chosen or record.subject in chosen]


def _print(found: Verification) -> None:
    for finding in found.findings:
        print(f"WRONG  {found.entry}{', ' if finding.subject else ': '}{finding}")
    if any(finding.what == NO_RECORD for finding in found.findings):
        print("  --dataset names a split that has to be complete instead of its dataset")
    text = f"{found.entry}: {len(found.scored)} meshes scored again, {len(found.failed)} failed"
    print(f"{text}, {len(found.findings)} findings")
    if found.unproven:
        print(f"  not proven by a mesh: {', '.join(found.unproven)}")

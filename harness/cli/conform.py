"""``harness conform``: whether a method keeps the contract."""

from pathlib import Path
from typing import Annotated

import typer

from harness.board.conform import ConformRequest, conform
from harness.board.conform_trial import Certificate
from harness.cli import options as opt
from harness.cli.display import print_json, shown_progress
from harness.cli.options import limit_s, parsed_settings, split_names
from harness.cli.verb_list import verb_group
from harness.core.errors import HarnessError
from harness.data.manifest import load_manifest
from harness.run.added_methods import AddedMethods
from harness.run.method_choice import chosen_methods
from harness.run.sources import Source
from harness.run.workspace import Workspace

app = verb_group("conform")


@app.command()
def conform_method(
    method: Annotated[
        str, typer.Argument(metavar="METHOD", help="The method; 'harness methods list' names them.")
    ],
    dataset: opt.Dataset = "avatars",
    subject: Annotated[
        str,
        typer.Option("--subject", metavar="ID", help="Subject to try it on. Default: the first."),
    ] = "",
    recipe: opt.Recipe = "quick8",
    settings: opt.Set = None,
    seed: opt.Seed = 0,
    timeout: opt.Timeout = 3600.0,
    memory_mib: Annotated[
        float | None,
        typer.Option("--memory", min=1.0, metavar="MIB", help="Most memory that a trial may use."),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="Where the certificate goes. Default: certificates/METHOD.json in the workspace.",
        ),
    ] = None,
    workspace: opt.WorkspacePath = None,
    manifest: opt.ManifestPath = None,
    as_json: opt.Json = False,
) -> None:
    """Try a method, and certify that it keeps the contract.

    It is run three times or more: whether the mesh is in metres, stands where the subject stands,
    with +Y up, facing +Z, not mirrored, wound outward and closed; whether the same seed gives the
    same mesh, and whether photos that it does not declare, other names and another folder change
    it; and whether something of it stays when it is killed. The exit code is 1 when an answer is
    no.
    """
    place = Workspace.default(workspace)
    source = Source.select(load_manifest(manifest), place, dataset, split_names(subject), recipe)
    (chosen,) = chosen_methods((method,), parsed_settings(settings), added=AddedMethods.of(place))
    if source.is_imported:
        raise HarnessError(
            f"dataset '{dataset}' has no scans to compare with",
            hint="Try the method on a dataset of scans, such as avatars",
        )
    request = ConformRequest(
        source.only(source.subjects[0]), chosen, seed, limit_s(timeout), memory_mib
    )
    with shown_progress(quiet=as_json) as progress:
        certificate = conform(request, progress)
    path = output or place.root / "certificates" / f"{certificate.method}.json"
    certificate.save(path)
    if as_json:
        print_json(certificate.to_dict())
    else:
        _show(certificate, path)
    if not certificate.conforms:
        raise typer.Exit(1)


def _show(certificate: Certificate, path: Path) -> None:
    tried = f"{certificate.subject} of {certificate.dataset}, photos {certificate.recipe}"
    print(f"{certificate.method}: {certificate.title}, tried on {tried}")
    for check in certificate.checks:
        print(f"  {check.line}")
    if certificate.conforms:
        print(f"It conforms. Certificate: {path}")
    else:
        print(f"It does not conform: {', '.join(certificate.failed)}. Report: {path}")

"""``harness doctor``: what is usable here, and how to install the rest."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated

import typer

from harness.cli.options import Json, ManifestPath, WorkspacePath
from harness.cli.output import print_json
from harness.cli.verb_list import verb_group
from harness.data.manifest import load_manifest
from harness.pipeline.doctor import Finding, examine
from harness.pipeline.executors.locks import probe_locks
from harness.pipeline.inputs.workspace import Workspace

app = verb_group("doctor")

#: How long a machine waits for the other, seconds.
_PROBE_S = 60.0


@app.command()
def doctor(
    workspace: WorkspacePath = None,
    manifest: ManifestPath = None,
    lock_probe: Annotated[
        bool,
        typer.Option(
            "--lock-probe",
            help="Check instead whether locks in the workspace reach other machines. Run it on two "
            "machines within a minute; the exit code is 1 unless one keeps the other out.",
        ),
    ] = False,
    as_json: Json = False,
) -> None:
    """Check what is installed, and show how to install the rest.

    The exit code is 1 when something is missing without which 'harness quickstart' cannot run.
    """
    if lock_probe:
        _probe(Workspace.default(workspace), as_json=as_json)
        return
    findings: list[Finding] = []
    for finding in examine(load_manifest(manifest), Workspace.default(workspace)):
        findings.append(finding)
        if not as_json:
            mark = "ok" if finding.usable else "MISSING" if finding.needed else "-"
            print(f"{mark:8} {finding.kind:9} {finding.name:18} {finding.note}")
            if not finding.usable and finding.next_step:
                print(f"{'':33} -> {finding.next_step}")
    if as_json:
        print_json(findings)
    if any(finding.needed and not finding.usable for finding in findings):
        raise typer.Exit(1)


def _probe(workspace: Workspace, *, as_json: bool) -> None:
    """Whether locks reach another machine on which the same command runs now."""
    found = probe_locks(workspace.root, _PROBE_S)
    if as_json:
        print_json(asdict(found))
    elif found.works is None:
        print(f"no other machine ran the same command on {workspace.root} within {_PROBE_S:g} s")
    elif found.works:
        print(f"locks in {workspace.root} reach {found.other}: one machine kept the other out")
    else:
        print(f"locks in {workspace.root} do not reach {found.other}: both machines had one lock")
    if not found.works:
        raise typer.Exit(1)

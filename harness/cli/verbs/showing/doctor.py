"""``harness doctor``: what is usable here, and how to install the rest."""

from __future__ import annotations

import typer

from harness.cli.options import Json, ManifestPath, WorkspacePath
from harness.cli.output import print_json
from harness.cli.verb_list import verb_group
from harness.data.manifest import load_manifest
from harness.pipeline.doctor import Finding, examine
from harness.pipeline.inputs.workspace import Workspace

__all__ = ["app"]

app = verb_group("doctor")


@app.command()
def doctor(
    workspace: WorkspacePath = None, manifest: ManifestPath = None, as_json: Json = False
) -> None:
    """Check what is installed, and show how to install the rest.

    The exit code is 1 when something is missing without which 'harness quickstart' cannot run.
    """
    findings: list[Finding] = []
    for finding in examine(load_manifest(manifest), Workspace.default(workspace)):
        findings.append(finding)
        if not as_json:
            mark = "ok" if finding.usable else "MISSING" if finding.needed else "-"
            print(f"{mark:8} {finding.kind:9} {finding.name:18} {finding.note}")
            if not finding.usable and finding.next_step:
                print(f"{'':33} -> {finding.next_step}")
    if as_json:
        print_json([finding.to_dict() for finding in findings])
    if any(finding.needed and not finding.usable for finding in findings):
        raise typer.Exit(1)

"""``harness doctor``: what is usable here, and what to do about the rest."""

from __future__ import annotations

import json

import typer

from harness.cli.options import Json, ManifestPath, WorkspacePath

__all__ = ["doctor"]


def doctor(
    workspace: WorkspacePath = None, manifest: ManifestPath = None, as_json: Json = False
) -> None:
    """Say what is installed and usable, and the next step for each thing that is not."""
    from harness.data.manifest import load_manifest
    from harness.pipeline.doctor import examine
    from harness.pipeline.inputs.workspace import Workspace

    findings = []
    for finding in examine(load_manifest(manifest), Workspace.default(workspace)):
        findings.append(finding)
        if not as_json:
            mark = "ok" if finding.usable else "MISSING" if finding.needed else "-"
            print(f"{mark:8} {finding.kind:9} {finding.name:14} {finding.note}")
            if not finding.usable and finding.next_step:
                print(f"{'':33} -> {finding.next_step}")
    if as_json:
        print(json.dumps([finding.to_dict() for finding in findings], indent=2))
    if any(finding.needed and not finding.usable for finding in findings):
        raise typer.Exit(1)

"""Options that several verbs share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from harness.core.errors import HarnessError

__all__ = [
    "Dataset",
    "Jobs",
    "Json",
    "ManifestPath",
    "Protocol",
    "Reason",
    "Recipe",
    "Run",
    "Set",
    "Subjects",
    "Timeout",
    "WorkspacePath",
    "limit_s",
    "parsed_settings",
    "split_names",
]

WorkspacePath = Annotated[
    Path | None,
    typer.Option(
        "--workspace", help="Folder of data/, captures/ and runs/.", envvar="HARNESS_WORKSPACE"
    ),
]
ManifestPath = Annotated[
    Path | None, typer.Option("--manifest", help="Another data_manifest.yaml.")
]
Dataset = Annotated[str, typer.Option("--dataset", help="Dataset or split of the manifest.")]
Subjects = Annotated[
    str, typer.Option("--subjects", help="Only these: a01,a04 or t00001..t00020. Default: all.")
]
Recipe = Annotated[str, typer.Option("--recipe", help="Render recipe of the manifest.")]
Protocol = Annotated[str, typer.Option("--protocol", help="Metric protocol of the manifest.")]
Run = Annotated[str | None, typer.Option("--run", help="Run folder. Default: the last one.")]
Jobs = Annotated[int, typer.Option("--jobs", min=1, help="Subjects worked on at once.")]
Reason = Annotated[
    str, typer.Option("--reason", help="Why sealed subjects are looked at; it is logged.")
]
Timeout = Annotated[
    float,
    typer.Option(
        "--timeout",
        min=0.0,
        metavar="SECONDS",
        help="Longest time for one subject's photos, or one reconstruction; 0 is no limit.",
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON and nothing else.")]


Set = Annotated[
    list[str] | None,
    typer.Option(
        "--set", help="A method's setting, NAME=VALUE; 'harness methods show' lists them."
    ),
]


def parsed_settings(texts: list[str] | None) -> dict[str, str]:
    """What ``--set`` was given, by name.

    Raises:
        HarnessError: a text without an equals sign.
    """
    pairs = {}
    for text in texts or []:
        name, separator, value = text.partition("=")
        if not separator:
            raise HarnessError(
                f"--set {text}", expected="NAME=VALUE", hint="Like --set hull.voxel_m=0.005"
            )
        pairs[name.strip()] = value.strip()
    return pairs


def limit_s(timeout: float) -> float | None:
    """The seconds of ``--timeout``; None, which is no limit, for 0."""
    return timeout or None


def split_names(text: str) -> tuple[str, ...]:
    """The names in a comma-separated option; ``t00001..t00020`` stands for twenty of them.

    Raises:
        HarnessError: something that is no name.
    """
    from harness.core.files.names import checked_name
    from harness.data.manifest import subject_range

    names = [name.strip() for name in text.split(",") if name.strip()]
    found = [single for name in names for single in subject_range(name) or (name,)]
    return tuple(checked_name("method or subject", name) for name in found)

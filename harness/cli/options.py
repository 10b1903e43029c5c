"""Options that several verbs share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from harness.core.errors import HarnessError
from harness.data.manifest import listed_names


def _some(context: typer.Context, parameter: typer.CallbackParam, value: str) -> str:
    """The value; a list that is given and empty, as of a shell's unset variable, means nothing."""
    source = context.get_parameter_source(parameter.name or "")
    if source is not None and source.name == "COMMANDLINE" and not value.strip(" ,"):
        name = parameter.opts[0]
        needed = parameter.required or parameter.default
        hint = "Name some" if needed else f"Name some, or leave {name} out for all"
        raise HarnessError(f"{name} names nothing", hint=hint)
    return value


WorkspacePath = Annotated[
    Path | None,
    typer.Option(
        "--workspace",
        metavar="FOLDER",
        help="Folder that holds data/, captures/ and runs/. Default: the current folder.",
        envvar="HARNESS_WORKSPACE",
    ),
]
ManifestPath = Annotated[
    Path | None,
    typer.Option(
        "--manifest",
        metavar="FILE",
        help="File that defines datasets, recipes and protocols. Default: data_manifest.yaml in "
        "the current folder, or the one that is installed.",
    ),
]
Dataset = Annotated[
    str, typer.Option("--dataset", metavar="NAME", help="Dataset or split, as in the manifest.")
]
MethodsToRun = Annotated[
    str,
    typer.Option(
        "--method",
        metavar="NAMES",
        help="Methods to run, comma-separated; 'harness methods list' names them.",
        callback=_some,
    ),
]
MethodsToShow = Annotated[
    str,
    typer.Option(
        "--method",
        metavar="NAMES",
        help="Methods to show, comma-separated, in this order. Default: all.",
        callback=_some,
    ),
]
Parts = Annotated[
    str,
    typer.Option(
        "--parts",
        metavar="CHOICE",
        help="Parts to run with: open; paper, which are those that you imported; or pairs such as "
        "normals=econ,body=smplx,start=pixie,completion=ifnet.",
    ),
]
Seed = Annotated[
    int,
    typer.Option("--seed", metavar="N", min=0, help="Random seed, from which all others derive."),
]
Subjects = Annotated[
    str,
    typer.Option(
        "--subjects",
        metavar="IDS",
        help="Subjects to use, such as a01,a04 or t00001..t00020. Default: all.",
        callback=_some,
    ),
]
Recipe = Annotated[
    str,
    typer.Option(
        "--recipe",
        metavar="NAME",
        help="Recipe for the photos (cameras, size, renderer), as in the manifest.",
    ),
]
Protocol = Annotated[
    str,
    typer.Option(
        "--protocol",
        metavar="NAME",
        help="Metric protocol of the manifest, or of the field, such as econ; several with commas, "
        "or all.",
    ),
]
Run = Annotated[
    str | None,
    typer.Option("--run", metavar="NAME", help="Run to read, below runs/. Default: the latest."),
]
Jobs = Annotated[
    int, typer.Option("--jobs", metavar="N", min=1, help="Number of subjects run in parallel.")
]
Reason = Annotated[
    str,
    typer.Option(
        "--reason",
        metavar="TEXT",
        help="Reason for looking at sealed subjects; required for these only, and logged.",
    ),
]
Timeout = Annotated[
    float,
    typer.Option(
        "--timeout",
        min=0.0,
        metavar="SECONDS",
        help="Longest time for the photos of one subject, and for one reconstruction; 0 means no "
        "limit.",
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON and nothing else.")]
Set = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="Change a setting of the method; may be repeated. 'harness methods show METHOD' "
        "lists the settings.",
    ),
]


def parsed_settings(
    texts: list[str] | None, option: str = "--set", example: str = "hull.voxel_m=0.005"
) -> dict[str, str]:
    """The values given with an option, by name.

    Raises:
        HarnessError: a text without an equals sign.
    """
    pairs: dict[str, str] = {}
    for text in texts or []:
        name, separator, value = text.partition("=")
        if not separator:
            raise HarnessError(
                f"{option} {text}", expected="NAME=VALUE", hint=f"For example {option} {example}"
            )
        pairs[name.strip()] = value.strip()
    return pairs


def limit_s(timeout: float) -> float | None:
    """The seconds of ``--timeout``; None, which means no limit, for 0."""
    return timeout or None


def split_names(text: str) -> tuple[str, ...]:
    """The names in a comma-separated option, each once; ``t00001..t00020`` stands for twenty.

    Raises:
        HarnessError: something that is no name.
    """
    return listed_names(text)

"""Options that several verbs share."""

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from harness.core.errors import HarnessError
from harness.core.files.names import listed_names
from harness.run.ray_cluster import RayCluster
from harness.run.slurm import Slurm
from harness.run.task import Executor, Grant
from harness.run.workspace import Workspace


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
SplitName = Annotated[
    str,
    typer.Option(
        "--split",
        metavar="NAME",
        help="Only the subjects of a split of the dataset, such as a publication's; "
        "'harness data list' names them.",
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


class ExecutorName(StrEnum):
    """Where work is carried out."""

    LOCAL = "local"
    RAY = "ray"
    SLURM = "slurm"


ExecutorOption = Annotated[
    ExecutorName,
    typer.Option(
        "--executor",
        help="Where the work is carried out: in processes of this machine, on a Ray cluster, or as "
        "Slurm array jobs. The last two need a workspace that all machines see.",
    ),
]
RayAddress = Annotated[
    str,
    typer.Option(
        "--ray-address",
        metavar="ADDRESS",
        help="With --executor ray: 'auto' for the cluster that this machine belongs to, or "
        "HOST:6379. Default: start one on this machine.",
    ),
]
SlurmOptions = Annotated[
    list[str] | None,
    typer.Option(
        "--slurm",
        metavar="NAME=VALUE",
        help="With --executor slurm: an option of sbatch, such as partition=NAME, account=NAME or "
        "array_parallelism=50; may be repeated. cluster=local tries the same jobs on this machine.",
    ),
]
Cell = Annotated[
    list[str] | None,
    typer.Option(
        "--cell",
        metavar="NAME=VALUE",
        help="On a cluster, what each reconstruction and each rendering may use: cpus=4 (cores "
        "and threads), gpus=1 (reconstructions alone; on Ray also a share such as 0.5), "
        "memory=8 (GiB that have to be free); may be repeated. Default: cpus=1.",
    ),
]


@dataclass(frozen=True, slots=True)
class Where:
    """What a user said about where work is carried out.

    Attributes:
        name: Kind of executor.
        cell: What each task may use on a cluster, as texts of the form NAME=VALUE.
        ray_address: As ``RayCluster.address``.
        slurm: Texts of the form NAME=VALUE.
        timeout: Longest time for one task, seconds; 0 is no limit.
    """

    name: ExecutorName
    cell: list[str] | None = None
    ray_address: str = ""
    slurm: list[str] | None = None
    timeout: float = 0.0

    def executor(self, workspace: Workspace, jobs: int) -> Executor | None:
        """The executor, or None for this machine.

        Raises:
            HarnessError: an option that this executor does not have.
            MissingPart: a package or program that it needs is not installed.
        """
        self._require(ExecutorName.RAY, "--ray-address", bool(self.ray_address))
        self._require(ExecutorName.SLURM, "--slurm", bool(self.slurm))
        grant = _grant(self.cell)
        if self.name is ExecutorName.LOCAL:
            if self.cell:
                raise HarnessError(
                    "--cell is for clusters",
                    got="--executor local",
                    hint="Give --executor ray or slurm with it, or leave it out",
                )
            return None
        if jobs != 1:
            raise HarnessError(
                "--jobs is for this machine alone: a cluster works on as much as it has room for",
                hint="Leave --jobs out",
            )
        if self.name is ExecutorName.RAY:
            ray = RayCluster(self.ray_address, grant)
            ray.require_usable()
            return ray
        options = parsed_settings(self.slurm, "--slurm", "partition=gpu")
        slurm = Slurm(
            folder=workspace.runs / ".slurm",
            grant=grant,
            timeout_s=limit_s(self.timeout),
            cluster="local" if options.pop("cluster", "slurm") == "local" else "slurm",
            options=options,
        )
        slurm.require_usable()
        return slurm

    def _require(self, name: ExecutorName, option: str, is_given: bool) -> None:
        if is_given and self.name is not name:
            raise HarnessError(
                f"{option} is for --executor {name}",
                got=f"--executor {self.name}",
                hint=f"Give --executor {name}, or leave {option} out",
            )


def _grant(texts: list[str] | None) -> Grant:
    """What ``--cell`` says.

    Raises:
        HarnessError: a name or a value that it cannot have.
    """
    given = parsed_settings(texts, "--cell", "cpus=4")
    try:
        grant = Grant(
            int(given.pop("cpus", "1")),
            float(given.pop("gpus", "0")),
            float(given.pop("memory", "0")),
        )
    except ValueError as error:
        raise HarnessError("--cell has a value that is no number", got=str(error)) from error
    if given:
        raise HarnessError(f"--cell has no '{next(iter(given))}'", expected="cpus, gpus or memory")
    return grant

"""The options that say where a command's work is carried out."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated

import typer

from harness.cli.options import limit_s, parsed_settings
from harness.core.errors import HarnessError
from harness.pipeline.executors.grants import Grant
from harness.pipeline.executors.ray_cluster import RayCluster
from harness.pipeline.executors.slurm import Slurm
from harness.pipeline.executors.task import Executor
from harness.pipeline.inputs.workspace import Workspace


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

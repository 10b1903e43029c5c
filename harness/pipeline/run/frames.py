"""A run as a pandas frame, read or made: ``harness.read_run`` and ``harness.evaluate``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from harness.core.errors import DataError
from harness.data.manifest import listed_names, load_manifest
from harness.pipeline.foreign.added_methods import AddedMethods
from harness.pipeline.inputs.part_choice import OPEN, parsed_parts
from harness.pipeline.inputs.sources import Source
from harness.pipeline.inputs.workspace import Workspace
from harness.pipeline.progress import Progress, Silent
from harness.pipeline.run.chosen_method import chosen_methods
from harness.pipeline.run.evaluate import evaluate as carry_out
from harness.pipeline.run.plan import EvalRequest
from harness.pipeline.run.record_file import read_record_file
from harness.pipeline.run.store import RunStore
from reports.tables.frame import frame

if TYPE_CHECKING:
    import pandas as pd


def read_run(folder: str | Path) -> pd.DataFrame:
    """The records of a run, one row per method and subject and one column per metric.

    Failed and missing subjects are rows, too, with their ``status`` and ``reason`` and NaN for each
    number. ``attrs["units"]`` names the unit of each column.

    Args:
        folder: A run's folder, such as ``runs/main``; or a file of ``harness results records``.

    Raises:
        DataError: no records there, or one that cannot be read; none is skipped.
    """
    path = Path(folder)
    if path.suffix == ".jsonl" or path.is_file():
        return frame(read_record_file(path))
    records = RunStore(path).records()
    if not records:
        raise DataError(
            f"there are no records in {path}",
            expected="a run's folder, such as runs/main, or a .jsonl file of records",
            got="a folder without them" if path.is_dir() else "no folder",
            hint="'harness eval' makes a run, and says where",
        )
    return frame(records)


def evaluate(  # noqa: PLR0913 - the options of the command
    methods: str | Sequence[str],
    dataset: str = "avatars",
    subjects: str | Sequence[str] = (),
    recipe: str = "paper8",
    protocol: str = "mexecon",
    run: str = "main",
    *,
    settings: Mapping[str, str] | None = None,
    row: str = "",
    parts: str = OPEN,
    seed: int = 0,
    jobs: int = 1,
    reason: str = "",
    timeout_s: float | None = 3600.0,
    workspace: str | Path | None = None,
    manifest: str | Path | None = None,
    progress: Progress | None = None,
) -> pd.DataFrame:
    """Run methods on subjects, score what they make, and return their rows as ``read_run`` does.

    It is ``harness eval``: photos that are missing are made, records that are there and current are
    kept, and the same call continues what was stopped. A failed subject is a row with its reason.

    Args:
        methods: Names in a sequence, or with commas.
        dataset: A dataset or split of the manifest.
        subjects: Ids in a sequence, or with commas; all of the dataset where none is named.
        recipe: How subjects are photographed.
        protocol: How meshes become numbers.
        run: Folder below ``runs/`` of the workspace.
        settings: What ``--set`` changes, by name, such as ``{"hull.voxel_m": "0.005"}``.
        row: What the records of one method with other settings are called.
        parts: ``open``, ``paper``, or pairs such as ``normals=econ``.
        seed: Root of all randomness.
        jobs: Subjects at once.
        reason: Why sealed subjects are looked at.
        timeout_s: Longest time for a subject's photos, and for a reconstruction; None for any.
        workspace: Folder of ``data/``, ``captures/`` and ``runs/``; by default that of commands.
        manifest: File with datasets, recipes and protocols; by default that of commands.
        progress: Told of what is done, with ``expect``, ``done`` and ``say``.

    Raises:
        HarnessError: an unknown name, a part that is not installed, or a contradiction.
    """
    checked, place = load_manifest(manifest), Workspace.default(workspace)
    texts = {name: str(value) for name, value in (settings or {}).items()}
    chosen = parsed_parts(parts), AddedMethods.of(place)
    request = EvalRequest(
        source=Source.select(checked, place, dataset, listed_names(subjects), recipe),
        methods=chosen_methods(listed_names(methods), texts, row, *chosen),
        protocol=checked.protocol(protocol),
        store=RunStore(place.run(run)),
        seed=seed,
        jobs=jobs,
        reason=reason,
        timeout_s=timeout_s,
    )
    return frame(carry_out(request, progress or Silent()).records)

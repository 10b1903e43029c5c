"""A run as a pandas frame, read or made: ``harness.read_run`` and ``harness.evaluate``."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from harness.core.errors import DataError
from harness.core.files.atomic import parsed_json, write_text
from harness.core.files.names import listed_names
from harness.core.records import Record
from harness.data.manifest import load_manifest
from harness.run.added_methods import AddedMethods
from harness.run.evaluate import evaluate as carry_out
from harness.run.method_choice import OPEN, chosen_methods, parsed_parts
from harness.run.plan import EvalRequest
from harness.run.progress import Progress, Silent
from harness.run.sources import Source
from harness.run.store import RunStore
from harness.run.workspace import Workspace
from reports.tables.selection import frame

if TYPE_CHECKING:
    import pandas as pd


_REMAKE = "Write it with 'harness results records FILE --run NAME'"


def write_record_file(records: Sequence[Record], path: Path) -> None:
    """Write records atomically, in the order of their methods' names and subjects.

    Their ``inputs`` are left out: they are half of a record, no table uses them, and the key that
    they gave stays.

    Raises:
        DataError: no records, a full disk or a missing right.
    """
    if not records:
        raise DataError(
            f"there are no records to write to {path}",
            hint="See what the run has with 'harness report', and check --method and --subjects",
        )
    ordered = sorted(records, key=lambda record: (record.method_name, record.subject))
    lines = (
        json.dumps(
            replace(record, inputs={}).to_dict(),
            separators=(",", ":"),
            sort_keys=True,
            allow_nan=False,
        )
        for record in ordered
    )
    write_text(path, "".join(f"{line}\n" for line in lines))


def read_record_file(path: Path, whole: Collection[str] = ()) -> list[Record]:
    """The records in a file that ``write_record_file`` wrote.

    ``whole`` is as ``Record.from_document`` has it.

    Raises:
        DataError: no such file, a line that is no record, or two records of one method and subject.
    """
    try:
        lines = path.read_text(encoding="utf-8").removesuffix("\n").split("\n")
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(f"cannot read records from {path}", got=str(error), hint=_REMAKE) from error
    if lines == [""]:
        raise DataError(f"{path} has no records", hint=_REMAKE)
    return list(_records(tuple(lines), path, frozenset(whole)))


@lru_cache(maxsize=2)  # many tables are made of one file
def _records(lines: tuple[str, ...], path: Path, whole: Collection[str]) -> tuple[Record, ...]:
    records: dict[tuple[str, str], Record] = {}
    for number, line in enumerate(lines, 1):
        source = f"line {number} of {path}"
        record = Record.from_document(parsed_json(line, source), source, whole)
        cell = (record.method_name, record.subject)
        if cell in records:
            raise DataError(
                f"{path} has two records of {cell[0]} on {cell[1]}",
                expected="one record of each method and subject",
                hint=_REMAKE,
            )
        records[cell] = record
    return tuple(records.values())


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

"""The records of a run in one file, one on each line: all that tables need, without meshes.

The file is JSON Lines: UTF-8, each line a record as ``record.json`` has it, without what its key
was made of (``inputs``), ordered by method and subject. It is small enough for a repository, and a
changed record changes one line.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from harness.core.errors import DataError
from harness.core.files.atomic import parsed_json, write_text
from harness.core.records import Record

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


def read_record_file(path: Path) -> list[Record]:
    """The records in a file that ``write_record_file`` wrote.

    Raises:
        DataError: no such file, a line that is no record, or two records of one method and subject.
    """
    try:
        lines = path.read_text(encoding="utf-8").removesuffix("\n").split("\n")
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(f"cannot read records from {path}", got=str(error), hint=_REMAKE) from error
    if lines == [""]:
        raise DataError(f"{path} has no records", hint=_REMAKE)
    records: dict[tuple[str, str], Record] = {}
    for number, line in enumerate(lines, 1):
        source = f"line {number} of {path}"
        record = Record.from_document(parsed_json(line, source), source)
        cell = (record.method_name, record.subject)
        if cell in records:
            raise DataError(
                f"{path} has two records of {cell[0]} on {cell[1]}",
                expected="one record of each method and subject",
                hint=_REMAKE,
            )
        records[cell] = record
    return list(records.values())

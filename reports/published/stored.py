"""The results by subject that the authors published, as records.

``PROVENANCE.md`` beside this file says where they come from, what is missing, and where their means
differ from the printed table.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from pathlib import Path

from harness.core.errors import DataError
from harness.core.metric_catalog import METRICS
from harness.core.protocols import MethodInfo
from harness.core.records import CaptureStamp, ProtocolStamp, Record
from harness.core.results import MetricValue

#: Printed title by method, which is also the name of its file.
STORED_METHODS: Mapping[str, str] = {
    "econ": "ECON",
    "mexecon2": "2-view MExECON",
    "mexecon8": "8-view MExECON",
    "vggt8": "8-view VGGT",
}
#: The subjects that the paper names.
SUBJECTS = (
    "0004", "0006", "0007", "0019", "0021", "0023", "0053", "0054", "0055", "0057",
    "0070", "0071", "0072", "0074", "0081", "0083", "0120", "0170", "0181", "0445",
)  # fmt: skip

_METRIC_OF = {
    "Chamfer (mm)": "chamfer",
    "P2S Accuracy (mm)": "p2s_accuracy",
    "P2S Completeness (mm)": "p2s_completeness",
    "Normal Error (deg)": "normal_error",
}
_AVERAGE = "AVERAGE"
#: Points on each mesh in the authors' evaluator.
_SAMPLES = 30_000
_ABSENT = "not among the results published by subject"


def stored_records() -> list[Record]:
    """One record per method and subject of the paper; a subject that is in no file is missing.

    Values are as published, in mm and degrees; their standard error is not known.

    Raises:
        DataError: a file is not whole.
    """
    return [
        _record(method, subject, values.get(subject, {}))
        for method in STORED_METHODS
        for values in (_by_subject(method),)
        for subject in SUBJECTS
    ]


def stored_averages(method: str) -> Mapping[str, float]:
    """The average that the authors stored below a method's results, by metric."""
    return _by_subject(method)[_AVERAGE]


def _by_subject(method: str) -> dict[str, dict[str, float]]:
    """By subject, and for the average: value by metric."""
    path = Path(__file__).with_name(f"{method}.csv")
    try:
        with path.open(encoding="utf-8", newline="") as stream:
            found = {
                line["Subject"]: {name: float(line[title]) for title, name in _METRIC_OF.items()}
                for line in csv.DictReader(stream)
            }
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise DataError(
            f"{path} does not hold published results",
            expected=f"columns Subject, {', '.join(_METRIC_OF)}",
            got=f"{type(error).__name__}: {error}",
            hint="Install the package again",
        ) from error
    unknown = set(found) - {*SUBJECTS, _AVERAGE}
    if unknown or _AVERAGE not in found:
        raise DataError(
            f"{path} does not hold published results",
            expected=f"subjects of the paper, and {_AVERAGE}",
            got=", ".join(sorted(unknown)) or f"no {_AVERAGE}",
            hint="Install the package again",
        )
    return found


def _record(method: str, subject: str, values: Mapping[str, float]) -> Record:
    return Record(
        key="",
        method=MethodInfo(method, STORED_METHODS[method]),
        dataset="THuman 2.1",
        subject=subject,
        recipe="of the authors",
        protocol=ProtocolStamp("of the authors", version=None, sha=""),
        capture=CaptureStamp(),
        seed=0,
        status="ok" if values else "missing",
        reason="" if values else _ABSENT,
        metrics={
            name: MetricValue(value, METRICS[name].unit, _SAMPLES, standard_error=math.nan)
            for name, value in values.items()
        },
    )

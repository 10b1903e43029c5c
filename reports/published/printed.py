"""The numbers printed in the MExECON paper, as data with their source."""

import csv
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from harness.core.errors import DataError
from harness.core.metric_catalog import METRICS
from harness.core.protocols import MethodInfo
from harness.core.records import CaptureStamp, MetricValue, ProtocolStamp, Record


@dataclass(frozen=True, slots=True)
class PublishedValue:
    """A number as printed, and as a value with its unit."""

    text: str
    value: float
    unit: str


@dataclass(frozen=True, slots=True)
class PublishedRow:
    """One line of a printed table, by our column ids."""

    title: str
    cells: Mapping[str, PublishedValue]


@dataclass(frozen=True, slots=True)
class PublishedBlock:
    """A printed table.

    Attributes:
        source: Where it is printed.
        note: What it was measured on, and what is known to disagree.
        columns: Headings by column id, with the unit where the numbers are printed bare.
        rows: In printed order.
        heading: What stands above the rows where they are shown below others.
    """

    source: str
    note: str
    columns: Mapping[str, str]
    rows: tuple[PublishedRow, ...]
    heading: str = "Published, not measured here"


#: What a published millimetre very likely is.
UNIT_NOTE = (
    "A published mm is very likely a thousandth of a scan unit and not a real millimetre: in the "
    "authors' public example the scan of subject 0021 stands in its own units, 0.82 of them high, "
    "so that 1 mm of the print is about 2 mm of a real person"
)

_PAPER = (
    "Uğur et al., MExECON: Multi-view Extended Explicit Clothed humans Optimized via Normal "
    "integration"
)


def _rows(units: Mapping[str, str], lines: Mapping[str, str]) -> tuple[PublishedRow, ...]:
    return tuple(
        PublishedRow(
            title,
            {
                column: PublishedValue(text, float(text), unit)
                for (column, unit), text in zip(units.items(), line.split(), strict=True)
            },
        )
        for title, line in lines.items()
    )


_GEOMETRY = PublishedBlock(
    source=f"{_PAPER}, geometry table",
    note="20 subjects of THuman 2.1, photos rendered by the authors. The results by subject that "
    "they published cover 18 subjects (VGGT 17); their means agree with the print to 0.02, except "
    "for the normal error of 8-view MExECON (34.86) and for VGGT (Chamfer 23.69, P2S completeness "
    f"19.45). {UNIT_NOTE}",
    columns={
        "chamfer": "Chamfer (mm)",
        "p2s_accuracy": "P2S Acc. (mm)",
        "p2s_completeness": "P2S Comp. (mm)",
        "normal_error": "Normal (deg)",
    },
    rows=_rows(
        {"chamfer": "mm", "p2s_accuracy": "mm", "p2s_completeness": "mm", "normal_error": "deg"},
        {
            "ECON": "40.56 39.52 37.21 45.79",
            "2-view MExECON": "32.76 29.72 31.18 44.03",
            "8-view MExECON": "23.12 21.26 22.84 39.54",
            "8-view VGGT": "23.87 22.21 19.84 41.38",
        },
    ),
)

_JMBO = PublishedBlock(
    source=f"{_PAPER}, JMBO ablation table",
    note="Loss terms of the body fit, per image over 8 views, mean over 20 subjects of THuman 2.1",
    columns={
        "silhouette_loss": "Silhouette loss",
        "landmark_loss": "Landmark loss",
        "normal_loss": "Normal loss",
        "total_loss": "Total loss",
    },
    rows=_rows(
        dict.fromkeys(("silhouette_loss", "landmark_loss", "normal_loss", "total_loss"), "1"),
        {
            "Front-view SMPL-X": "0.103 1.259 0.013 0.229",
            "Multi-view avg. SMPL-X": "0.092 0.169 0.012 0.113",
            "JMBO SMPL-X": "0.041 0.153 0.008 0.059",
        },
    ),
)


def _cost(time_text: str, time_s: float, memory_gb: int) -> dict[str, PublishedValue]:
    return {
        "wall_s": PublishedValue(time_text, time_s, "s"),
        "peak_gpu_mib": PublishedValue(f"{memory_gb} GB", float(memory_gb), "GB"),
    }


_COST = PublishedBlock(
    source=f"{_PAPER}, cost table",
    note="Approximate, for one subject, on one NVIDIA A100 40 GB",
    columns={"wall_s": "Computation time", "peak_gpu_mib": "Peak GPU memory"},
    rows=(
        PublishedRow("ECON", _cost("45 sec.", 45.0, 8)),
        PublishedRow("2-view MExECON", _cost("1 min.", 60.0, 12)),
        PublishedRow("8-view MExECON", _cost("2.5 min.", 150.0, 24)),
        PublishedRow("8-view VGGT", _cost("5 sec.", 5.0, 14)),
    ),
)

#: The paper's tables by name.
PUBLISHED: Mapping[str, PublishedBlock] = {"geometry": _GEOMETRY, "cost": _COST, "jmbo": _JMBO}


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

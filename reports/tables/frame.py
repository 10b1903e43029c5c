"""Records as a pandas frame, for questions that no table here answers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from harness.core.records import Record

if TYPE_CHECKING:
    import pandas as pd


def frame(records: Sequence[Record]) -> pd.DataFrame:
    """One row per method and subject, one column per metric; NaN where there is no number.

    Failed and missing subjects are rows too, with their ``reason``: ``dropna`` is the reader's
    choice. ``frame.attrs["units"]`` names each column's unit. Before them stand what the numbers
    are of: ``method``, ``title``, ``subject``, ``status``, ``reason``, ``dataset``, ``recipe``,
    ``scale_rule``, ``protocol``, ``seed``; after them what they cost: ``wall_s``, ``peak_rss_mib``.

    Args:
        records: Records of one run or several; the reader decides what may be compared.
    """
    import pandas as pd

    metrics = dict.fromkeys(name for record in records for name in record.metrics)
    units = {name: value.unit for record in records for name, value in record.metrics.items()}
    rows = [
        {
            "method": record.method_name,
            "title": record.method.title,
            "subject": record.subject,
            "status": record.status,
            "reason": record.reason,
            "dataset": record.dataset,
            "recipe": record.recipe,
            "scale_rule": record.scale_rule,
            "protocol": record.protocol.name,
            "seed": record.seed,
            **{name: _value(record, name) for name in metrics},
            "wall_s": sum(stage.wall_s for stage in record.stages) if record.stages else None,
            "peak_rss_mib": max((stage.peak_rss_mib for stage in record.stages), default=None),
        }
        for record in records
    ]
    made = pd.DataFrame(rows)
    made = made.astype(dict.fromkeys([*metrics, "wall_s", "peak_rss_mib"], float) if rows else {})
    made.attrs["units"] = {**units, "wall_s": "s", "peak_rss_mib": "MiB"}
    return made


def _value(record: Record, metric: str) -> float | None:
    return record.metrics[metric].value if metric in record.metrics else None

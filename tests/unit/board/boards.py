"""Small boards out of the golden records, with bytes in place of meshes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from harness.core.records import Record
from harness.run.store import RunStore

RUN = Path(__file__).parents[2] / "golden" / "run"
RECORDS: dict[str, tuple[Record, ...]] = {
    name: tuple(record for record in RunStore(RUN).records() if record.method_name == name)
    for name in ("hull8", "mexecon", "vggt", "gt")
}


def shifted(record: Record, **by: float) -> Record:
    """A record with other numbers."""
    metrics = {
        name: replace(value, value=value.value + by.get(name, 0.0))
        for name, value in record.metrics.items()
    }
    return replace(record, metrics=metrics)


def put(root: Path, version: str, records: tuple[Record, ...], day: int = 1) -> Path:
    """Results of one version on a board; ``root``."""
    for record in records:
        folder = root / record.method_name / version
        made = replace(record, created_utc=f"2026-01-{day:02d}T00:00:00+00:00")
        made.save(folder / f"{record.subject}.json")
        if record.status == "ok":
            (folder / f"{record.subject}.ply").write_bytes(version.encode())
    return root

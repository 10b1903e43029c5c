"""What one reconstruction scores under further protocols than its record's, as a file beside it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from harness.core.files.atomic import read_json, write_json, write_text
from harness.core.protocol_stages import UNALIGNED, Aligned
from harness.core.records import MetricValue, ProtocolStamp
from harness.core.typed_json import from_json, to_json

#: Beside ``record.json``.
PROTOCOLS_FILE = "protocols.json"


@dataclass(frozen=True, slots=True)
class ProtocolScore:
    """The numbers of one mesh under one protocol, or why there are none."""

    protocol: ProtocolStamp
    """Which."""
    mesh: str
    """sha256 of the mesh that was measured."""
    alignment: Aligned = UNALIGNED
    """What was done to it first."""
    metrics: Mapping[str, MetricValue] = field(default_factory=dict[str, MetricValue])
    """By key of the protocol's summary; empty where it cannot measure the mesh."""
    reason: str = ""
    """Why not, or why numbers that it asks for are lacking; empty if none is."""


@dataclass(frozen=True, slots=True)
class ProtocolScores:
    """The numbers of one mesh under several protocols."""

    scores: tuple[ProtocolScore, ...] = ()
    """One of each."""

    @classmethod
    def beside(cls, record_folder: Path, mesh: str) -> ProtocolScores:
        """Those of a mesh, as filed in its cell's folder; of another mesh none.

        Raises:
            DataError: a file that holds something else.
        """
        path = record_folder / PROTOCOLS_FILE
        if not path.is_file():
            return cls()
        found = from_json(cls, read_json(path), path, "a file of scores by protocol")
        return cls(tuple(score for score in found.scores if score.mesh == mesh))

    def save(self, record_folder: Path) -> None:
        """Write the file, atomically."""
        write_json(record_folder / PROTOCOLS_FILE, to_json(self))


@dataclass(frozen=True, slots=True)
class RunScores:
    """What the meshes of a run score under further protocols."""

    cells: Mapping[str, ProtocolScores]
    """By method and subject, such as ``hull8/a01``."""

    @classmethod
    def beside(cls, records: Path) -> RunScores:
        """Those in the file beside a file of records.

        Raises:
            DataError: there is none, or it holds something else.
        """
        path = records.with_suffix(f".{PROTOCOLS_FILE}")
        return from_json(cls, read_json(path), path, "a file of scores by protocol")

    def save(self, records: Path) -> None:
        """Write the file, atomically."""
        text = json.dumps(to_json(self), separators=(",", ":"), sort_keys=True)
        write_text(records.with_suffix(f".{PROTOCOLS_FILE}"), f"{text}\n")

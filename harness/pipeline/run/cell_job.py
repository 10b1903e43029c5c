"""A planned cell, as it travels to the worker process that carries it out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from harness.core.settings import MetricProtocol
from harness.pipeline.foreign.added_methods import AddedMethods
from harness.pipeline.inputs.sources import Source
from harness.pipeline.run.chosen_method import ChosenMethod
from harness.pipeline.run.record_inputs import Inputs


@dataclass(frozen=True, slots=True, eq=False)
class CellJob:
    """One method on one subject, as it was planned.

    Attributes:
        source: The dataset and the recipe, with this subject alone.
        method: The method with its settings.
        protocol: How the result is scored.
        seed: Root seed of the run.
        inputs: What the record is made from; its key is the record's.
        folder: Receives mesh, body and normals.
        keep: Whether intermediate results stay.
        share: Whether work that was made for another method before is taken over.
    """

    source: Source
    method: ChosenMethod
    protocol: MetricProtocol
    seed: int
    inputs: Inputs
    folder: Path
    keep: bool
    share: bool = True

    @property
    def subject(self) -> str:
        """The subject's id."""
        return self.source.subjects[0]

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values; method and protocol go by name."""
        return {
            "source": self.source.to_dict(),
            "method": self.method.name,
            "row": "" if self.method.row == self.method.name else self.method.row,
            "settings": dict(self.method.settings),
            "protocol": self.protocol.name,
            "seed": self.seed,
            "inputs": self.inputs.to_dict(),
            "folder": str(self.folder),
            "keep": self.keep,
            "share": self.share,
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> CellJob:
        """The job behind ``to_dict``, with method and protocol resolved in this process.

        Raises:
            HarnessError: the manifest is gone, or names in it or in the catalogue are.
            MissingPart: the method, or one of its parts, is not installed.
        """
        source = Source.from_dict(values["source"])
        return cls(
            source=source,
            method=ChosenMethod.of(
                values["method"],
                values["settings"],
                values["row"],
                added=AddedMethods.of(source.workspace),
            ),
            protocol=source.manifest.protocol(values["protocol"]),
            seed=values["seed"],
            inputs=Inputs.from_dict(values["inputs"]),
            folder=Path(values["folder"]),
            keep=values["keep"],
            share=values["share"],
        )

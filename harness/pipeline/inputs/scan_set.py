"""The true surfaces of a dataset's subjects, without any photos."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from harness.core.artifacts import Scan
from harness.core.mesh import Mesh
from harness.data.manifest import Dataset, Manifest
from harness.data.subjects import load_subject
from harness.pipeline.inputs.workspace import Workspace


@dataclass(frozen=True, slots=True)
class ScanSet:
    """Some subjects of a dataset, to be measured against.

    Attributes:
        name: The dataset's name, never a split's.
        dataset: Its entry in the manifest.
        root: The dataset's folder.
        subjects: Ids of the subjects.
    """

    name: str
    dataset: Dataset
    root: Path
    subjects: tuple[str, ...]

    @classmethod
    def select(
        cls, manifest: Manifest, workspace: Workspace, name: str, subjects: tuple[str, ...]
    ) -> ScanSet:
        """The scans of a dataset or split; of all its subjects where none is named.

        Raises:
            HarnessError: an unknown dataset, split or subject.
            MissingPart: the dataset's folder is not set.
        """
        resolved, dataset, chosen = manifest.select(name, subjects)
        return cls(resolved, dataset, manifest.root(resolved, workspace.root), chosen)

    def load(self, subject: str) -> tuple[Scan, Mesh]:
        """The subject's scan and its textured mesh in world metres.

        Raises:
            DataError: it does not exist, or cannot be read.
        """
        return load_subject(self.name, self.dataset, self.root, subject)

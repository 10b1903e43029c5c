"""Who makes the subjects of generated datasets: packages, found by entry points.

A package registers a ``Generator`` under ``harness.datasets``. If it has a ``dataset``, the name of
the entry point is that of a new dataset; a manifest may also name it as a dataset's ``generator``.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol

from harness.core.errors import HarnessError
from harness.core.missing import not_installed
from harness.core.process.registry import Registry

#: The generator of a dataset that names none, and the module that has it.
AVATARS, _AVATARS_MODULE = "avatars", "clothed_avatars"

GENERATORS = Registry("generator of subjects", {}, group="harness.datasets")


class Generator(Protocol):
    """Makes subjects from their ids alone.

    Attributes:
        version: Changes whenever what it makes does.
        dataset: A manifest's entry of its own dataset without ``kind`` and ``root``, or empty.
    """

    version: int
    dataset: Mapping[str, Any]

    def make(self, subject: str, directory: Path, scan_noise_mm: float) -> None:
        """Write a subject into a folder of its own: ``<subject>.obj`` with material and texture.

        Args:
            subject: Its id.
            directory: The folder, which does not exist, or holds what was made before.
            scan_noise_mm: Standard deviation of bumps such as a scanner leaves.

        Raises:
            HarnessError: no such subject, or it cannot be made.
        """
        ...

    def is_current(self, subject: str, directory: Path, scan_noise_mm: float) -> bool:
        """Whether the folder holds what ``make`` would write now."""
        ...

    def sheet(self, subject: str, directory: Path) -> Any:
        """A picture of a subject for a person to judge: (H, W, 3), 8-bit sRGB."""
        ...

    def is_for_training(self, subject: str) -> bool:
        """Whether networks may be trained on a subject, which is no test subject then."""
        ...


def generator(name: str) -> Generator:
    """The generator of a name.

    Raises:
        MissingPart: its package is not installed, or lacks something itself.
        HarnessError: nobody registered the name.
    """
    if name == AVATARS and not is_installed(name):
        raise not_installed(_AVATARS_MODULE, "making generated avatars")
    return GENERATORS.resolve(name)


def is_installed(name: str) -> bool:
    """Whether a package registered the generator of a name."""
    return name in GENERATORS.targets()


def brought_datasets() -> tuple[dict[str, dict[str, Any]], dict[str, HarnessError]]:
    """Manifest entries of the datasets that packages bring, and why others cannot be used."""
    entries: dict[str, dict[str, Any]] = {}
    broken: dict[str, HarnessError] = {}
    for name in GENERATORS:
        if name == AVATARS:
            continue
        try:
            entry = GENERATORS.resolve(name).dataset
        except HarnessError as error:
            broken[name] = error
            continue
        if entry:
            placed = {"kind": "generated", "generator": name, "root": f"data/{name}"}
            entries[name] = {"scale": "metres", "facing": "+z", **entry, **placed}
    return entries, broken

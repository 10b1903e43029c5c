"""What the manifest offers and what of it is on this machine."""

from dataclasses import asdict, dataclass
from pathlib import Path

from harness.core.errors import MissingPart
from harness.data.field_sets import field_names, field_set
from harness.data.manifest import Dataset, Manifest
from harness.data.subjects import check_files
from harness.data.thuman import FileCheck
from harness.run.sources import IMPORTED, imported_state, imported_subjects
from harness.run.workspace import Workspace


def overview(manifest: Manifest, workspace: Workspace) -> dict[str, dict[str, str]]:
    """One line for every dataset, split, recipe and protocol, by kind and name.

    ``addable`` are the data sets of the field, which ``harness data add NAME DIR`` takes.
    """
    datasets = {}
    for name, dataset in manifest.datasets.items():
        try:
            root = manifest.root(name, workspace.root)
            if dataset.kind == "captures":
                count = len(imported_subjects(workspace, name))
                datasets[name] = f"{dataset.title} ({dataset.licence}): {count} in {root}"
                continue
            there = sum(
                (root / "model" / subject).is_dir() or (root / subject).is_dir()
                for subject in dataset.subjects
            )
            state = f"{there} of {len(dataset.subjects)} subjects in {root}"
        except MissingPart as error:
            state = f"not set up: {error.hint}"
        datasets[name] = f"{dataset.title} ({dataset.licence}): {state}"
    datasets |= {name: f"cannot be used: {error}" for name, error in manifest.unusable.items()}
    return {
        "datasets": datasets,
        "splits": {
            **{
                name: f"{len(split.subjects)} subjects of {split.dataset}"
                for name, split in manifest.splits.items()
            },
            **_published(manifest),
        },
        "addable": {
            name: f"{field.title}: {field.source}"
            for name in field_names()
            if (field := field_set(name))
        },
        "recipes": {
            name: f"{recipe.rig.views} views, {recipe.width} x {recipe.height}, {recipe.renderer}"
            for name, recipe in manifest.recipes.items()
        },
        "protocols": {
            name: f"version {rule.version}, {rule.samples} {rule.sampling} samples a mesh, "
            f"Chamfer {rule.chamfer}"
            for name, rule in manifest.protocols.items()
        },
    }


def _published(manifest: Manifest) -> dict[str, str]:
    """The splits of publications, of the datasets that are in the manifest."""
    return {
        f"{dataset} --split {name}": f"ids not known here: from {split.unknown}"
        if split.unknown
        else split.by
        for dataset, entry in manifest.datasets.items()
        if (field := field_set(entry.field))
        for name, split in field.splits.items()
    }


@dataclass(frozen=True, slots=True)
class Tree:
    """A dataset's expected files.

    Attributes:
        heading: What is shown.
        files: Every expected file with its state.
        summary: What to do next.
    """

    heading: str
    files: tuple[FileCheck, ...]
    summary: str

    @property
    def complete(self) -> bool:
        """Whether every expected file is there and whole."""
        return all(entry.state == "present" for entry in self.files)

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values."""
        return {**asdict(self), "complete": self.complete}

    @property
    def surfaces(self) -> tuple[str, ...]:
        """A table of the user's scans: hidden area and open edges of each, and of all."""
        found = [entry.surface for entry in self.files if entry.surface]
        if not found:
            return ()
        rows = [(each.subject, f"{each.hidden:.1%}", str(each.open_edges)) for each in found]
        shares = sorted(each.hidden for each in found)
        closed = sum(each.open_edges == 0 for each in found)
        whole = (f"{len(found)} scans", f"{shares[len(shares) // 2]:.1%} in the middle, "
                 f"{shares[-1]:.1%} at most", f"{closed} watertight")  # fmt: skip
        return tuple(
            f"  {name:24} {hidden:>8}  {edges}"
            for name, hidden, edges in (("scan", "hidden", "open edges"), *rows, whole)
        )


def check_tree(
    manifest: Manifest, workspace: Workspace, name: str, subjects: tuple[str, ...]
) -> Tree:
    """The expected tree of a dataset or split, compared with what is on disk.

    A dataset whose folder is not set is shown whole, as missing.
    """
    resolved, dataset, chosen = manifest.select(name, subjects)
    if dataset.kind == "captures":
        return _imported_tree(dataset, workspace, resolved, chosen)
    try:
        root = manifest.root(resolved, workspace.root)
        hint = f"Root: {root}"
    except MissingPart as error:
        root, hint = Path(dataset.root), error.hint
    files = tuple(
        entry for subject in chosen for entry in check_files(dataset, root, subject, dataset.sha256)
    )
    wrong = [entry for entry in files if entry.state != "present"]
    if not wrong:
        summary = f"All {len(files)} files of {len(chosen)} subjects are there"
    elif dataset.kind == "generated":
        summary = f"{len(wrong)} of {len(files)} files to be made: harness data make {name}"
    else:
        summary = f"{len(wrong)} of {len(files)} files missing or corrupt. {hint}"
    return Tree(f"{dataset.title} ({dataset.licence}), below {root}", files, summary)


def _imported_tree(
    dataset: Dataset, workspace: Workspace, name: str, subjects: tuple[str, ...]
) -> Tree:
    """The imported captures of a dataset, with what is wrong with each."""
    found: list[FileCheck] = []
    for subject in subjects or imported_subjects(workspace, name):
        directory = workspace.capture(name, subject, IMPORTED)
        state, why = imported_state(directory)
        there = (directory / "capture.json").is_file()
        kind = "present" if state == "cached" else "corrupt" if there else "missing"
        found.append(FileCheck(str(directory.relative_to(workspace.root)), kind, why))
    wrong = sum(entry.state != "present" for entry in found)
    summary = (
        f"{wrong} of {len(found)} captures missing or damaged: import them again"
        if wrong
        else f"{len(found)} captures; 'harness capture import' adds more"
    )
    return Tree(f"{dataset.title} ({dataset.licence})", tuple(found), summary)

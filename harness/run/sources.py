"""Scans and captures on demand: avatars are made, photos rendered, and both kept by content."""

from __future__ import annotations

import functools
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.core.artifacts import Capture, Scan
from harness.core.errors import DataError, HarnessError, did_you_mean
from harness.core.files.atomic import atomic_path, exclusive_lock
from harness.core.files.hashing import content_hash, file_sha256
from harness.core.files.names import checked_name, listed_names, suffix_of
from harness.core.files.npz import read_array_npz
from harness.core.files.pickles import read_array_pickle
from harness.core.mesh import Mesh
from harness.core.process.source_digest import SourceTree, listed_differences
from harness.core.process.threads import StepReport
from harness.core.settings import RenderRecipe
from harness.data.generators import Generator, generator, is_installed
from harness.data.manifest import Dataset, Manifest, load_manifest
from harness.data.subjects import fit_of, load_subject, locate_subject
from harness.files.mesh_files import load_mesh
from harness.geometry.surface import SurfaceIndex
from harness.run.uncalibrated import estimate_inputs, estimated_capture
from harness.run.workspace import Workspace
from methods.body.models.thuman_body import fitted_body, male_model
from methods.cameras.values import STEPS
from renderers.capture import CaptureInputs, capture

#: A body is within a few centimetres of its clothes; the first fits of THuman 2.1 were not. Metres
#: of a body, which is what units divided by the fit's scale are.
_MOST_OFF_M = 0.05
_OFF, _MADE_OF = "off_scan_m", "made_of"


def with_fitted_body(scan: Scan, fit: Path | None, folder: Path) -> Scan:
    """The scan with the body of its fit, where it has no body and the model is imported.

    Args:
        scan: As located.
        fit: Its ``smplx_param.pkl``, if there is one.
        folder: Where bodies are kept.

    Raises:
        DataError: the fit or the model cannot be read.
        MissingPart: the package ``smplx`` is not installed, while the model is imported.
    """
    model = male_model() if scan.body_path is None and fit is not None else None
    if fit is None or model is None:
        return scan
    path = folder / scan.dataset / f"{scan.subject}.npz"
    code = SourceTree.installed().digest([__name__], [SourceTree.__module__]).to_dict()
    mesh = scan.sha256[scan.mesh_path.name]
    key = content_hash({"code": code, "mesh": mesh, "fit": file_sha256(fit), "model": model[1]})
    with exclusive_lock(path.with_suffix(".lock")):
        if _key(path) != key:
            made = _made(scan, fit, model[0])
            with atomic_path(path) as partial, partial.open("wb") as file:
                np.savez_compressed(file, **made, **{_MADE_OF: np.array(key)})
    off_m = float(read_array_npz(path, (_OFF,))[_OFF])
    if off_m > _MOST_OFF_M:
        warning = (
            f"the fit is {1000 * off_m:.0f} mm off the scan on average, and is not taken as its "
            "true body"
        )
        return replace(scan, warnings=(*scan.warnings, warning))
    # The body alone decides scores; what it was made of is in the file's own key.
    return replace(scan, body_path=path, truth_sha256={"fitted body": key, **scan.truth_sha256})


def _key(path: Path) -> str:
    return str(read_array_npz(path, (_MADE_OF,))[_MADE_OF]) if path.is_file() else ""


def _made(scan: Scan, fit: Path, model_file: Path) -> Mapping[str, NDArray[Any]]:
    values = read_array_pickle(fit)
    vertices, joints, names = fitted_body(values, model_file)
    _, distance = SurfaceIndex(load_mesh(scan.mesh_path)).closest(vertices)
    off_m = float(distance.mean()) / float(values["scale"].item())
    return {
        "vertices": vertices,
        "joints": joints,
        "joint_names": np.array(names),
        _OFF: np.array(off_m),
    }


#: The dataset that imported captures are in, and what stands in the place of their recipe.
CAPTURES, IMPORTED = "captures", "imported"


def imported_subjects(workspace: Workspace, dataset: str = CAPTURES) -> tuple[str, ...]:
    """The names of all imported captures, in order."""
    folder = workspace.root / "captures" / checked_name("dataset", dataset)
    return tuple(sorted(path.parent.parent.name for path in folder.glob(f"*/{IMPORTED}/*.json")
                        if path.name == "capture.json"))  # fmt: skip


def captures_below(folder: Path) -> str:
    """A hint that names the folders of a folder which hold captures; empty where none does."""
    found = sorted(path.parent.name for path in folder.glob("*/capture.json"))
    return f"Name one of its folders: {', '.join(found)}" if found else ""


def imported_state(directory: Path) -> tuple[str, str]:
    """``cached`` or ``missing``, and why, of an imported capture.

    No code makes it stale: its pictures are what they were at the import.
    """
    if not (directory / "capture.json").is_file():
        return "missing", "import it with 'harness capture import'"
    try:
        damage = Capture.load(directory).damage()
    except DataError as error:
        return "missing", str(error)
    return ("missing", f"{damage}: import it again") if damage else ("cached", "")


def imported_capture(workspace: Workspace, subject: str) -> Capture:
    """An imported capture by its name, with views counted from the front.

    Raises:
        DataError: there is none of that name, or it is damaged.
    """
    directory = workspace.capture(CAPTURES, subject, IMPORTED)
    state, why = imported_state(directory)
    if state != "cached":
        known = imported_subjects(workspace)
        hint = "" if subject in known else did_you_mean(subject, known)
        raise DataError(f"imported capture '{subject}' cannot be used: {why}", hint=hint)
    return Capture.load(directory).from_front()


def name_for(path: Path) -> str:
    """A name for what is imported from a file or folder: its own, without what no name may have."""
    words = re.sub(r"[^A-Za-z0-9_-]+", "-", path.resolve().stem).strip("-")
    return checked_name("capture", words[:40] or "photos")


@dataclass(frozen=True, slots=True)
class Source:
    """The subjects of a dataset and the recipe by which they are photographed.

    Attributes:
        manifest_path: The manifest that defines all names below.
        workspace: Where data and captures lie.
        name: Dataset's name, never a split's.
        subjects: Ids.
        recipe: How they are photographed; None for imported photos.
        suffix: What names say of how cameras are known, as in ``CAMERAS``.
    """

    manifest_path: Path
    workspace: Workspace
    name: str
    subjects: tuple[str, ...]
    recipe: RenderRecipe | None
    suffix: str = ""

    @classmethod
    def select(
        cls,
        manifest: Manifest,
        workspace: Workspace,
        dataset: str,
        subjects: tuple[str, ...],
        recipe: str,
    ) -> Source:
        """The source behind what a user named: dataset or split, some subjects, a recipe.

        Imported photos are as they are, whatever the recipe. A recipe's name with one of the
        suffixes of ``CAMERAS`` is that recipe with its cameras withheld and estimated.
        """
        name, found, chosen = manifest.select(dataset, subjects)
        if found.kind == "captures":
            if suffix := suffix_of(recipe):
                raise HarnessError(
                    f"imported photos with cameras {suffix.strip('-')}",
                    hint="How the cameras of imported photos are known is said at their import",
                )
            imported = chosen or imported_subjects(workspace, name)
            return cls(manifest.path.resolve(), workspace, name, imported, None)
        suffix = suffix_of(recipe)
        rule = manifest.recipe(recipe.removesuffix(suffix))
        return cls(manifest.path.resolve(), workspace, name, chosen, rule, suffix)

    @property
    def manifest(self) -> Manifest:
        """The checked manifest, read once per process."""
        return _manifest(self.manifest_path)

    def root(self) -> Path:
        """The dataset's folder."""
        return self.manifest.root(self.name, self.workspace.root)

    @property
    def is_generated(self) -> bool:
        """Whether the subjects are made here."""
        return self.manifest.datasets[self.name].kind == "generated"

    @property
    def generator(self) -> Generator:
        """Who makes the subjects.

        Raises:
            MissingPart: its package is not installed.
        """
        return generator(self._generator_name)

    @property
    def _generator_name(self) -> str:
        return self.manifest.datasets[self.name].generator

    @property
    def is_imported(self) -> bool:
        """Whether the subjects are imported photos, without scans."""
        return self.manifest.datasets[self.name].kind == "captures"

    @property
    def recipe_name(self) -> str:
        """The name of the recipe, or what stands in its place for imported photos."""
        return IMPORTED if self.recipe is None else self.recipe.name + self.suffix

    @property
    def calibrated(self) -> Source:
        """The same with the cameras that its recipe gives."""
        return replace(self, suffix="")

    @property
    def render_recipe(self) -> RenderRecipe:
        """The recipe.

        Raises:
            HarnessError: imported photos have none.
        """
        if self.recipe is None:
            raise HarnessError(
                f"dataset '{self.name}' is of imported photos, which cannot be rendered",
                hint="Name a dataset of scans; 'harness data list' lists them",
            )
        return self.recipe

    @property
    def views_to_render(self) -> int:
        """Photos of a subject whose photos are missing."""
        return 0 if self.recipe is None else self.recipe.rig.views

    @property
    def camera_steps(self) -> int:
        """Steps towards the cameras of such a subject, where they are estimated."""
        return STEPS if self.suffix else 0

    @property
    def scale_rule(self) -> str:
        """What turns the scans' units into metres, as written in the manifest."""
        return self.manifest.datasets[self.name].scale

    def identity_of(self, subject: str) -> str:
        """Which person a subject is; empty where the manifest does not say."""
        return self.manifest.datasets[self.name].person_of(subject)

    @property
    def _scan_noise_mm(self) -> float:
        return self.manifest.datasets[self.name].scan_noise_mm

    def avatar_directory(self, subject: str) -> Path:
        """Folder of a generated subject."""
        return self.root() / "model" / subject

    def avatar_is_current(self, subject: str) -> bool:
        """Whether a generated subject is there as its generator would make it now.

        Where the generator is not installed, a subject that is there is taken as it is.
        """
        directory = self.avatar_directory(subject)
        if (directory / f"{subject}.obj").is_file() and not is_installed(self._generator_name):
            return True
        return self.generator.is_current(subject, directory, self._scan_noise_mm)

    def make_avatar(self, subject: str) -> bool:
        """Make a generated subject unless it is there already; whether it was made now."""
        directory = self.avatar_directory(subject)
        with exclusive_lock(directory.parent / f".{subject}.lock"):
            if self.avatar_is_current(subject):
                return False
            self.generator.make(subject, directory, self._scan_noise_mm)
        return True

    def locate(self, subject: str) -> Scan:
        """The subject's scan, hashed but not read.

        Raises:
            DataError: it is not there.
        """
        self._require_scans()
        dataset = self.manifest.datasets[self.name]
        return self._with_body(locate_subject(self.name, dataset, self.root(), subject))

    def load(self, subject: str) -> tuple[Scan, Mesh]:
        """The subject's scan and its textured mesh in world metres.

        Raises:
            DataError: it is not there, or cannot be read.
        """
        self._require_scans()
        dataset = self.manifest.datasets[self.name]
        scan, mesh = load_subject(self.name, dataset, self.root(), subject)
        return self._with_body(scan), mesh

    def _with_body(self, scan: Scan) -> Scan:
        fit = fit_of(self.manifest.datasets[self.name], self.root(), scan.subject)
        return with_fitted_body(scan, fit, self.workspace.fitted_bodies) if fit else scan

    def scan_of(self, subject: str) -> Scan | None:
        """The subject's scan as ``locate`` has it; None for imported photos."""
        return None if self.is_imported else self.locate(subject)

    def _require_scans(self) -> None:
        if self.is_imported:
            raise DataError(
                f"dataset '{self.name}' is of imported photos, which have no scan",
                hint="Name a dataset of scans; 'harness data list' lists them",
            )

    def capture_directory(self, subject: str) -> Path:
        """Where the subject's photos under this recipe lie."""
        return self.workspace.capture(self.name, subject, self.recipe_name)

    def capture(self, subject: str) -> Capture:
        """The subject's photos as methods and figures see them: counted from the front.

        Raises:
            DataError: they are missing or damaged.
        """
        return Capture.load(self.capture_directory(subject)).from_front()

    def capture_state(self, subject: str) -> tuple[str, str]:
        """``cached``, ``stale`` or ``missing``, and why, without rendering anything.

        Raises:
            DataError: there is no scan.
        """
        if self.is_imported:
            return imported_state(self.capture_directory(subject))
        if waits := self._waits(subject):
            return waits
        directory = self.capture_directory(subject)
        if not (directory / "capture.json").is_file():
            return "missing", "cameras not estimated yet" if self.suffix else "not rendered yet"
        try:
            found = Capture.load(directory)
        except DataError as error:
            return "stale", str(error)
        before: Mapping[str, object] = found.provenance.get("inputs", {})
        now = self._inputs(subject, before)
        if found.key != content_hash(now):
            return "stale", f"changed: {listed_differences(before, now)}"
        damage = found.damage()
        return ("stale", damage) if damage else ("cached", "")

    def _waits(self, subject: str) -> tuple[str, str] | None:
        """The state of what photos are made from, where that is not there."""
        if self.suffix:
            state = self.calibrated.capture_state(subject)
            return None if state[0] == "cached" else state
        if self.is_generated and not self.avatar_is_current(subject):
            return "missing", "avatar has to be made"
        return None

    def _inputs(self, subject: str, before: Mapping[str, object]) -> dict[str, object]:
        """What the subject's photos would be made from now, on the device of those before."""
        if self.suffix:
            photos = Capture.load(self.calibrated.capture_directory(subject))
            return estimate_inputs(photos, self.suffix)
        # Photos of another device are as good, but not the same: theirs is part of their key.
        device = str(before.get("device", ""))
        return CaptureInputs.of(self.locate(subject), self.render_recipe, device).to_dict()

    def ensure_capture(self, subject: str, report: StepReport) -> Capture:
        """The subject's photos, rendered now if they are not there or stale.

        Raises:
            HarnessError: the avatar, the scan, the renderer or the proof of the cameras failed.
        """
        if self.is_imported:
            return self.imported(subject)
        if self.suffix:
            return self._ensure_estimate(subject, report)
        if self.is_generated:
            self.make_avatar(subject)
        directory, recipe = self.capture_directory(subject), self.render_recipe
        with exclusive_lock(directory.parent / f".{recipe.name}.lock"):
            if self.capture_state(subject)[0] != "cached":
                scan, mesh = self.load(subject)
                capture(scan, mesh, recipe, directory, report, self._exact_photos(subject))
            return Capture.load(directory)

    def _ensure_estimate(self, subject: str, report: StepReport) -> Capture:
        photos = self.calibrated.ensure_capture(subject, report)
        directory = self.capture_directory(subject)
        with exclusive_lock(directory.parent / f".{self.recipe_name}.lock"):
            if self.capture_state(subject)[0] != "cached":
                _, mesh = self.load(subject)
                estimated_capture(photos, mesh, self.recipe_name, directory, report)
            return Capture.load(directory)

    def imported(self, subject: str) -> Capture:
        """A subject's imported photos.

        Raises:
            DataError: they are not there, or damaged.
        """
        state, why = self.capture_state(subject)
        if state != "cached":
            raise DataError(f"imported photos of '{subject}' cannot be used: {why}")
        return Capture.load(self.capture_directory(subject))

    def _exact_photos(self, subject: str) -> Capture | None:
        """Photos of another recipe that this one only adds a camera's faults to, if current."""
        for recipe in self.manifest.recipes.values():
            other = replace(self, recipe=recipe)
            if (
                recipe.is_exact_of(self.render_recipe)
                and other.capture_state(subject)[0] == "cached"
            ):
                return Capture.load(other.capture_directory(subject))
        return None

    def only(self, subject: str) -> Source:
        """The same source with one of its subjects."""
        return replace(self, subjects=(subject,))


def refuse_both(subjects: str, split: str) -> None:
    """Refuse ``--subjects`` beside ``--split``.

    Raises:
        HarnessError: both are given.
    """
    if split and subjects:
        raise HarnessError("--split and --subjects both name subjects", hint="Leave one out")


def chosen_source(
    manifest: Manifest, place: Workspace, of: tuple[str, str], subjects: str, recipe: str
) -> Source:
    """As ``Source.select``, of a dataset and a split of it, or of subjects in a list with commas.

    Raises:
        HarnessError: as there, both are given, or the dataset has no such split.
    """
    dataset, split = of
    refuse_both(subjects, split)
    chosen = manifest.split(dataset, split) if split else listed_names(subjects)
    return Source.select(manifest, place, dataset, chosen, recipe)


@functools.lru_cache(maxsize=4)
def _manifest(path: Path) -> Manifest:
    if not path.is_file():
        raise HarnessError(f"the manifest {path} is gone")
    return load_manifest(path)


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

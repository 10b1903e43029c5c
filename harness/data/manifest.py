"""The manifest: datasets, splits, rigs, render recipes and metric protocols, checked by pydantic.

An error names the file, the line and the key, and suggests the nearest valid one.
"""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from harness.core.errors import DataError, HarnessError, MissingPart, did_you_mean
from harness.core.field_protocols import FIELD_PROTOCOLS
from harness.core.files.names import NAME_RULE, is_name, subject_range
from harness.core.rigs import RingRig
from harness.core.settings import MetricProtocol, RenderRecipe
from harness.core.units import UNITS_RULE
from harness.data.field_sets import field_set
from harness.data.generators import AVATARS, brought_datasets
from harness.data.yaml_text import read_yaml

#: Licences that let everybody pass the data on.
SHAREABLE = ("CC0-1.0", "CC-BY-4.0", "CC-BY-SA-4.0", "PDDL-1.0")
_SCALE_RULE = re.compile(rf"fit|metres|{UNITS_RULE}|height=\d+(\.\d+)?")
_MOST_SHOWN = 40
#: Least and greatest of what settings may be: beyond lies no photo and no measurement.
_BOUNDS = {"width": (1, 8192), "height": (1, 8192), "views": (1, 360), "samples": (1, 10_000_000)}
_UNKNOWN_KEY = ("extra_forbidden", "unexpected_keyword_argument")
_VARIABLE = re.compile(r"\$\{(\w+)\}")


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


def _scale_rule(value: object) -> object:
    if not isinstance(value, str) or not _SCALE_RULE.fullmatch(value):
        raise ValueError("expected 'fit', 'metres', 'units' or 'height=<metres>'")
    return value


class SubjectClass(_Strict):
    """What kind of subject it is."""

    clothing: str
    pose: str


class Dataset(_Strict):
    """Subjects in THuman's layout, with the explicit rule that turns their units into metres.

    A dataset of kind ``captures`` has photos and no scans: its subjects are what was imported.

    Attributes:
        title: Name in tables.
        kind: ``generated`` is made here; ``thuman`` is the user's own licensed copy; ``scans`` are
            others of the user's, without fits; ``captures`` are imported photos without scans.
        licence: Licence of the scans.
        root: Folder; ``${VARIABLE}`` is taken from the environment, relative paths from the
            workspace.
        scale: ``metres``, ``fit`` (units divided by the SMPL-X fit's scale), ``height=1.75``, or
            ``units``: the scan keeps its own units, origin and axes, and 1 unit counts as 1 m.
        facing: Where subjects face in their files: ``+z``, ``fit`` (the fit's global orientation)
            or the yaw in degrees by subject. They are turned to +Z; under the scale ``units`` they
            are not, and it only decides which view is the front.
        hidden: ``dropped`` if ``harness data add --drop-hidden`` left out what no outside ray
            reaches, such as a body under its clothes: the truth is the outer surface.
        subjects: Ids, in the order of tables; in the file also a mapping from id to its classes, or
            a range such as ``t00001..t01000``.
        classes: What kind of subject each is, where the file says so.
        identity: Which person each subject is, where several are of one or a method may have been
            trained on others of them; in the file also the dataset whose subjects of the same
            ids they are.
        generator: For generated subjects: who makes them, an entry point of ``harness.datasets``.
        scan_noise_mm: For generated subjects: standard deviation of bumps such as a scanner leaves.
        sealed: Kept for the last test: looking at it needs a reason and is logged.
        source: Where the user gets the data.
        sha256: Expected checksums by path below the root.
        field: For a data set of the field: the name of its description, which has its splits.
        splits: Subjects of those splits that a file of the data set lists.
    """

    title: str
    kind: Literal["generated", "thuman", "scans", "captures"]
    licence: str
    root: str
    scale: Annotated[str, BeforeValidator(_scale_rule)]
    facing: Literal["+z", "fit"] | dict[str, float]
    hidden: Literal["kept", "dropped"] = "kept"
    subjects: tuple[str, ...] = ()
    classes: dict[str, SubjectClass] = Field(default_factory=dict)
    identity: dict[str, str] = Field(default_factory=dict)
    generator: str = AVATARS
    scan_noise_mm: float = Field(default=0.0, ge=0.0, le=5.0)
    sealed: bool = False
    source: str = ""
    sha256: dict[str, str] = Field(default_factory=dict)
    field: str = ""
    splits: dict[str, tuple[str, ...]] = Field(default_factory=dict)

    @property
    def may_be_passed_on(self) -> bool:
        """Whether everybody may pass scans and photos on: ``licence`` is in ``SHAREABLE``."""
        return self.licence in SHAREABLE

    def person_of(self, subject: str) -> str:
        """Which person a subject is; empty where neither this nor the field's description says."""
        described = field_set(self.field) if self.field else None
        return self.identity.get(subject) or (described.person_of(subject) if described else "")

    @model_validator(mode="before")
    @classmethod
    def _listed(cls, raw: Any) -> Any:
        subjects = raw.get("subjects") if isinstance(raw, dict) else None
        if isinstance(subjects, dict):
            raw = {**raw, "subjects": tuple(subjects), "classes": subjects}
        if isinstance(subjects, str):
            raw = {**raw, "subjects": subject_range(subjects) or (subjects,)}
        if isinstance(raw, dict) and isinstance(home := raw.get("identity"), str):
            raw = {**raw, "identity": {each: f"{home}/{each}" for each in raw.get("subjects", ())}}
        return raw

    @model_validator(mode="after")
    def _only_generated_scans_take_noise(self) -> Dataset:
        if self.scan_noise_mm and self.kind != "generated":
            raise ValueError("scan_noise_mm is for datasets of kind 'generated' only")
        return self

    @model_validator(mode="after")
    def _subjects_are_distinct(self) -> Dataset:
        repeated = sorted(name for name, count in Counter(self.subjects).items() if count > 1)
        if self.kind == "captures":
            if self.subjects:
                raise ValueError("subjects of kind 'captures' are what was imported, not listed")
            return self
        if not self.subjects or repeated:
            raise ValueError(
                f"subjects are empty or repeated: {', '.join(repeated) or 'none given'}"
            )
        return self


class Split(_Strict):
    """A named subset of a dataset's subjects."""

    dataset: str
    subjects: tuple[str, ...]


class _Document(_Strict):
    """The file as it stands."""

    # ``schema`` would shadow a method of pydantic's.
    schema_version: Literal[1] = Field(alias="schema")
    datasets: dict[str, Dataset]
    splits: dict[str, Split] = Field(default_factory=dict)
    rigs: dict[str, RingRig]
    recipes: dict[str, dict[str, Any]]
    protocols: dict[str, dict[str, Any]]


class _Recipe(_Strict):
    value: RenderRecipe


class _Protocol(_Strict):
    value: MetricProtocol


class Manifest:
    """A checked manifest; every look-up of an unknown name says which is nearest."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lines, raw = read_yaml(path)
        if not isinstance(raw, dict):
            raise DataError(
                f"{path} is no manifest",
                expected="names with values: schema, datasets, recipes, protocols",
                got="nothing" if raw is None else type(raw).__name__,
            )
        document = self._validate(_Document, raw, ())
        self._check_names(document)
        brought, self.unusable = brought_datasets()
        self.datasets: dict[str, Dataset] = {
            **document.datasets,
            **{
                name: self._validate(Dataset, entry, ("harness.datasets", name))
                for name, entry in brought.items()
                if name not in document.datasets
            },
        }
        self.splits: dict[str, Split] = document.splits
        self.recipes: dict[str, RenderRecipe] = {}
        for name, values in document.recipes.items():
            rig = values.get("rig")
            if rig not in document.rigs:
                self._fail(
                    ("recipes", name, "rig"),
                    f"unknown rig '{rig}'",
                    did_you_mean(str(rig), document.rigs),
                )
            value = {"value": {**values, "name": name, "rig": document.rigs[rig]}}
            self.recipes[name] = self._validate(_Recipe, value, ("recipes", name)).value
            self._check_bounds(("recipes", name), self.recipes[name].to_dict())
            self._check_bounds(("rigs", str(rig)), asdict(document.rigs[rig]))
        self.protocols: dict[str, MetricProtocol] = {
            name: self._validate(
                _Protocol, {"value": {**values, "name": name}}, ("protocols", name)
            ).value
            for name, values in document.protocols.items()
        }
        for name, protocol in self.protocols.items():
            self._check_bounds(("protocols", name), protocol.to_dict())
        # The field's are known everywhere; one of the same name in the file is another.
        self.protocols = {
            **self.protocols,
            **{
                name: known for name, known in FIELD_PROTOCOLS.items() if name not in self.protocols
            },
        }
        self._check_splits()

    def _check_names(self, document: _Document) -> None:
        for section in ("datasets", "splits", "rigs", "recipes", "protocols"):
            for name in getattr(document, section):
                if not is_name(name):
                    self._fail((section, name), f"{name[:40]!r} is no name: {NAME_RULE}", "")
        for name, dataset in document.datasets.items():
            for subject in dataset.subjects:
                if not is_name(subject):
                    what = f"{subject[:40]!r} is no name: {NAME_RULE}"
                    self._fail(("datasets", name, "subjects"), what, "")

    def _check_bounds(self, location: tuple[str, ...], values: Mapping[str, object]) -> None:
        for name, (low, high) in _BOUNDS.items():
            value = values.get(name, low)
            if not isinstance(value, int) or not low <= value <= high:
                self._fail((*location, name), f"{name} is {value}, not {low} to {high}", "")

    def _check_splits(self) -> None:
        for name, split in self.splits.items():
            if name in self.datasets:
                self._fail(("splits", name), "a split has the name of a dataset", "Rename it")
            if split.dataset not in self.datasets:
                hint = did_you_mean(split.dataset, self.datasets)
                self._fail(("splits", name, "dataset"), f"unknown dataset '{split.dataset}'", hint)
            known = self.datasets[split.dataset].subjects
            for subject in split.subjects:
                if subject not in known:
                    hint = did_you_mean(subject, known)
                    self._fail(("splits", name, "subjects"), f"unknown subject '{subject}'", hint)

    def _validate(self, model: type[Any], raw: object, prefix: tuple[str, ...]) -> Any:
        try:
            return model.model_validate(raw)
        except ValidationError as error:
            # A misspelt key is also a missing one: the spelling is the cause.
            first = min(
                error.errors(include_url=False), key=lambda e: e["type"] not in _UNKNOWN_KEY
            )
            location = (*prefix, *(str(part) for part in first["loc"] if part != "value"))
            if first["type"] in _UNKNOWN_KEY:
                known = _valid_keys(model, location[len(prefix) :])
                self._fail(
                    location, f"unknown key '{location[-1]}'", did_you_mean(location[-1], known)
                )
            message = first["msg"].removeprefix("Value error, ")
            self._fail(location, f"{location[-1] if location else 'file'}: {message}", "")

    def _fail(self, location: Sequence[str], what: str, hint: str) -> None:
        line = next(
            (
                self._lines[tuple(location[:n])]
                for n in range(len(location), -1, -1)
                if tuple(location[:n]) in self._lines
            ),
            1,
        )
        place = ".".join(part[:_MOST_SHOWN] for part in location)
        raise DataError(f"{self.path}, line {line}, {_plain(place)}: {_plain(what)}", hint=hint)

    def select(
        self, name: str, subjects: Sequence[str] = ()
    ) -> tuple[str, Dataset, tuple[str, ...]]:
        """Dataset name, dataset and subject ids behind a dataset's or split's name.

        Args:
            name: A dataset or a split.
            subjects: Only these of its subjects, in this order; all when empty. Which subjects a
                dataset of imported captures has is not known here: they are taken as they are.
        """
        if name in self.splits:
            split = self.splits[name]
            dataset_name, available = split.dataset, split.subjects
        elif name in self.datasets:
            dataset_name, available = name, self.datasets[name].subjects
        elif name in self.unusable:
            raise self.unusable[name]
        else:
            known = [*self.datasets, *self.splits]
            raise HarnessError(f"unknown dataset '{name}'", hint=did_you_mean(name, known))
        for subject in subjects:
            if subject not in available and self.datasets[dataset_name].kind != "captures":
                raise HarnessError(
                    f"dataset '{name}' has no subject '{subject}'",
                    hint=did_you_mean(subject, available),
                )
        return dataset_name, self.datasets[dataset_name], tuple(subjects) or available

    def split(self, dataset: str, name: str) -> tuple[str, ...]:
        """The subjects of a split: a named subset of the manifest, or one of a publication.

        Args:
            dataset: Name of the dataset.
            name: Of the split.

        Raises:
            HarnessError: the dataset has no such split, its ids are not known, or not all of its
                subjects are there.
        """
        resolved, found, _ = self.select(dataset)
        if (own := self.splits.get(name)) and own.dataset == resolved:
            return own.subjects
        if found.field and (described := field_set(found.field)):
            stored = found.splits.get(name, ())
            return described.subjects_of(name, resolved, found.subjects, stored)
        known = [each for each, split in self.splits.items() if split.dataset == resolved]
        raise HarnessError(
            f"dataset '{dataset}' has no split '{name}'", hint=did_you_mean(name, known)
        )

    def recipe(self, name: str) -> RenderRecipe:
        """A render recipe by name."""
        if name not in self.recipes:
            raise HarnessError(f"unknown recipe '{name}'", hint=did_you_mean(name, self.recipes))
        return self.recipes[name]

    def protocol(self, name: str) -> MetricProtocol:
        """A metric protocol by name."""
        if name not in self.protocols:
            raise HarnessError(
                f"unknown protocol '{name}'", hint=did_you_mean(name, self.protocols)
            )
        return self.protocols[name]

    def protocols_of(self, text: str) -> tuple[MetricProtocol, ...]:
        """The metric protocols of a list of names, or ``all``, each once."""
        names = self.protocols if text == "all" else (name.strip() for name in text.split(","))
        return tuple(self.protocol(name) for name in dict.fromkeys(names))

    def root(self, name: str, workspace: Path) -> Path:
        """A dataset's folder.

        Raises:
            MissingPart: it is named by an environment variable that is not set.
        """
        dataset = self.datasets[name]
        for variable in _VARIABLE.findall(dataset.root):
            if not os.environ.get(variable):
                raise MissingPart(
                    f"dataset '{name}' ({dataset.title}) has no folder yet",
                    hint=f"Get it from {dataset.source or 'its authors'} and set {variable} to its "
                    f"folder; 'harness data check {name}' shows the expected tree",
                )
        return workspace / _VARIABLE.sub(lambda match: os.environ[match[1]], dataset.root)


def _plain(text: str) -> str:
    """A text without line breaks and what would move a terminal's cursor."""
    return "".join(letter if letter.isprintable() else " " for letter in text)


def _valid_keys(model: type[Any], location: Sequence[str]) -> list[str]:
    """The keys allowed at the last place of a location inside a model."""
    if model is _Recipe:
        return [key for key in RenderRecipe.__dataclass_fields__ if key != "name"]
    if model is _Protocol:
        return [key for key in MetricProtocol.__dataclass_fields__ if key != "name"]
    inside = {"datasets": Dataset, "splits": Split}.get(location[0]) if len(location) > 1 else None
    if inside is not None:
        return list(inside.model_fields)
    if len(location) > 1 and location[0] == "rigs":
        return list(RingRig.__dataclass_fields__)
    return ["schema", "datasets", "splits", "rigs", "recipes", "protocols"]


def default_manifest_path() -> Path:
    """The manifest that is used when none is named.

    In order: ``HARNESS_MANIFEST``, ``data_manifest.yaml`` in the current folder, the one of the
    source checkout, the one inside the installed package.
    """
    if named := os.environ.get("HARNESS_MANIFEST"):
        return Path(named)
    own, installed = Path("data_manifest.yaml"), installed_manifest_path()
    return installed if installed.is_file() and not own.is_file() else own


def installed_manifest_path() -> Path:
    """The manifest of the source checkout, or the one inside the installed package."""
    here = Path(__file__).resolve()
    candidates = (here.parents[2] / "data_manifest.yaml", here.parent / "data_manifest.yaml")
    return next((path for path in candidates if path.is_file()), candidates[0])


def load_manifest(path: str | Path | None = None) -> Manifest:
    """The checked manifest in a file, by default the one of ``default_manifest_path``."""
    return Manifest(Path(path) if path else default_manifest_path())

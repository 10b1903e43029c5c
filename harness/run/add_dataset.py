"""A folder of scans or captures becomes a dataset: found, converted, checked, written down."""

import json
import os
import re
import shutil
import textwrap
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path

import yaml

from harness.core.artifacts import Capture, image_name
from harness.core.errors import DataError, HarnessError
from harness.core.files.atomic import atomic_directory, atomic_path, exclusive_lock, write_json
from harness.core.files.names import checked_name
from harness.core.units import UNITS_RULE
from harness.data.converted_scans import Conversion, convert_scan, is_converted, told_of
from harness.data.field_sets import FieldSet, field_set, find_field
from harness.data.layouts import Companions, FoundFolder, Layout, find_layout
from harness.data.manifest import Dataset, Manifest, installed_manifest_path, load_manifest
from harness.data.scans import stature
from harness.data.subjects import load_subject
from harness.files.mtl import materials_of
from harness.geometry.images import load_rgb
from harness.geometry.occlusion import hidden_share
from harness.run.progress import Progress
from harness.run.scan_rules import (
    UNSTATED_LICENCE,
    Added,
    AddRequest,
    CheckedSubject,
    Rules,
    rules_of,
)
from harness.run.sources import IMPORTED, imported_state

#: The same cameras for other programs; written with every capture.
_CAMERAS = "transforms.json"


def copied_capture(source: Path, request: AddRequest, subject: str) -> str:
    """Copy a capture to where those of a dataset lie, unless it is there; what it is, in words.

    Raises:
        DataError: it is damaged, or other photos are there and are not to be replaced.
    """
    capture = Capture.load(source)
    if damage := capture.damage():
        raise DataError(f"{source} cannot be used: {damage}")
    directory = request.workspace.capture(request.name, subject, IMPORTED)
    note = f"{len(capture.cameras)} photos, as recipe '{capture.recipe}'"
    if imported_state(directory)[0] == "cached" and Capture.load(directory).key == capture.key:
        return note
    if directory.exists() and not request.replace:
        raise DataError(f"{directory} holds other photos", hint="Add --replace to replace them")
    own = replace(capture, dataset=request.name, subject=subject, recipe=IMPORTED)
    with atomic_directory(directory) as folder:
        for name in [*map(image_name, range(len(capture.cameras))), _CAMERAS]:
            if (source / name).is_file():
                (folder / name).parent.mkdir(exist_ok=True)
                shutil.copyfile(source / name, folder / name)
        write_json(folder / "capture.json", own.to_dict())
    return note


def manifest_to_write(named: Path | None) -> Path:
    """The named manifest, the one of ``HARNESS_MANIFEST``, or that of the current folder.

    Never the installed one: it may not exist yet.
    """
    path = named or Path(os.environ.get("HARNESS_MANIFEST") or "data_manifest.yaml")
    return path.resolve()


def check_name(path: Path, name: str, *, replace: bool) -> None:
    """Refuse a dataset's name that ``write_entry`` would refuse, before anything is done.

    Raises:
        HarnessError: a split or another dataset has the name.
        DataError: the manifest is not valid as it is.
    """
    manifest = load_manifest(_source(path))
    if name in manifest.splits:
        raise HarnessError(
            f"'{name}' is the name of a split in {manifest.path}", hint="Choose another name"
        )
    check_addable(_text(manifest.path), name, replace=replace)


def write_entry(path: Path, name: str, dataset: Dataset, *, replace: bool) -> bool:
    """Write a manifest with one more dataset; whether the file is new.

    A file that is not there begins as a copy of the installed manifest. Of two commands at once,
    the second adds to what the first wrote.

    Raises:
        HarnessError: the name is taken.
        DataError: the manifest would not be valid, or cannot be written.
    """
    with exclusive_lock(path.parent / f".{path.name}.lock"):
        check_name(path, name, replace=replace)
        created = not path.is_file()
        text = with_dataset(_text(_source(path)), name, dataset, replace=replace)
        with atomic_path(path) as temporary:
            temporary.write_bytes(text.encode())
            _check_reads_back(temporary, path, name, dataset)
    return created


def _source(path: Path) -> Path:
    return path if path.is_file() else installed_manifest_path()


def _text(path: Path) -> str:
    # Bytes, because reading as text would make other line ends of those that are there.
    return path.read_bytes().decode("utf-8")


def _check_reads_back(temporary: Path, path: Path, name: str, dataset: Dataset) -> None:
    try:
        found = Manifest(temporary).datasets.get(name)
    except HarnessError as error:
        what = str(error).replace(str(temporary), path.name)
        raise DataError(f"{path} would not be valid with '{name}', and was left as it is",
                        got=what) from error  # fmt: skip
    if found != dataset:
        raise DataError(
            f"the entry '{name}' would not be read back as it is meant, and was not written",
            expected=repr(dataset),
            got=repr(found),
        )


#: A person whose height is less than this share of the longest side probably lies.
_LYING = 0.6
#: Folds of clothes hide less than this share of a scan's area.
_LAYERED = 0.1


def add_dataset(request: AddRequest, progress: Progress) -> Added:
    """Add a dataset to the manifest, if all its subjects are sound.

    Scans in a tree as THuman's are read where they lie; others are converted, and captures copied,
    into the workspace. What a command that was stopped had done is kept.

    Raises:
        HarnessError: the name is taken, or an option is missing or at odds with the folder.
        DataError: the folder has no known layout, or more than one.
    """
    checked_name("dataset", request.name)
    manifest = manifest_to_write(request.manifest)
    check_name(manifest, request.name, replace=request.replace)
    if field := field_set(request.name):
        layout = field.title
        dataset, checked, words, notes = _field(field, request, progress)
    else:
        found = find_layout(request.folder).only(request.subjects)
        layout = found.layout.value
        added = _captures if found.layout is Layout.captures else _scans
        (dataset, checked, words), notes = added(found, request, progress), ()
    sound = tuple(each.subject for each in checked if not each.failure)
    is_complete = len(sound) == len(checked) or request.skip_bad
    written = bool(sound) and is_complete
    created = written and write_entry(
        manifest, request.name, _only(dataset, sound), replace=request.replace
    )
    notes += _splits_there(field, request.name, _only(dataset, sound)) if field else ()
    return Added(
        request.name, layout, dataset.kind, dataset.root, words, checked, manifest, created,
        written, notes, field.protocol if field else "",
    )  # fmt: skip


def _field(
    field: FieldSet, request: AddRequest, progress: Progress
) -> tuple[Dataset, tuple[CheckedSubject, ...], str, tuple[str, ...]]:
    """A data set of the field: as ``_scans``, and what is missing in it."""
    place = find_field(request.name, request.folder, request.frame)
    wanted = {} if request.subjects else place.damaged
    failed = tuple(CheckedSubject(each, failure=why) for each, why in wanted.items())
    if not place.found.subjects:
        why = "; ".join(f"{each.subject}: {each.failure}" for each in failed[:3])
        raise DataError(f"{request.folder}: no scan of {field.title} can be used", got=why)
    found = place.found.only(request.subjects)
    dataset, checked, words = _scans(found, request.prefilled(field, found), progress)
    told = {"field": request.name, "splits": dict(place.splits)}
    return dataset.model_copy(update=told), (*checked, *failed), words, place.told


def _splits_there(field: FieldSet, name: str, dataset: Dataset) -> tuple[str, ...]:
    """Which published splits are whole in a data set of the field, and why others are not."""
    told: list[str] = []
    for split, published in field.splits.items():
        try:
            stored = dataset.splits.get(split, ())
            count = len(field.subjects_of(split, name, dataset.subjects, stored))
            told.append(f"split {split}: {count} subjects ({published.by})")
        except HarnessError as error:
            told.append(f"split {split} cannot be used: {error}")
    return tuple(told)


Found = tuple[Dataset, tuple[CheckedSubject, ...], str]


def _scans(found: FoundFolder, request: AddRequest, progress: Progress) -> Found:
    rules = rules_of(found, request)
    if rules.conversion is None:
        dataset = _dataset(request, rules, found, _root(found.root, request))
        return (
            dataset,
            _each(found, progress, _Check(request.name, dataset, found.root)),
            rules.words,
        )
    place = request.workspace.root / "data" / request.name
    _check_apart(found.root, place)
    dataset = _dataset(request, rules, found, f"data/{request.name}")
    convert = _Convert(
        _Check(request.name, dataset, place), place / "model", found, rules.conversion
    )
    with _held(place):
        return dataset, _each(found, progress, convert), rules.words


def _captures(found: FoundFolder, request: AddRequest, progress: Progress) -> Found:
    options = ("scale", "facing", "up", "grey", "copy", "drop_hidden")
    given = [f"--{name.replace('_', '-')}" for name in options if getattr(request, name)]
    if given:
        raise HarnessError(
            f"captures have a world of their own and take no {', '.join(given)}",
            hint="Leave these options out",
        )
    place = request.workspace.root / "captures" / request.name
    _check_apart(found.root, place)

    def check(subject: str) -> CheckedSubject:
        note = copied_capture(found.subjects[subject], request, subject)
        return CheckedSubject(subject, note)

    dataset = Dataset(
        title=request.title or request.name,
        kind="captures",
        licence=request.licence or UNSTATED_LICENCE,
        root=f"captures/{request.name}",
        scale="metres",
        facing="+z",
    )
    with _held(place):
        return dataset, _each(found, progress, check), "copied"


def _each(
    found: FoundFolder, progress: Progress, check: Callable[[str], CheckedSubject]
) -> tuple[CheckedSubject, ...]:
    """Every subject's check; one that fails does not stop the others."""
    progress.expect("subjects", len(found.subjects))
    checked: list[CheckedSubject] = []
    for subject in found.subjects:
        try:
            checked.append(check(subject))
        except HarnessError as error:
            checked.append(CheckedSubject(subject, failure=str(error)))
        progress.done("subjects")
    return tuple(checked)


@dataclass(frozen=True, slots=True)
class _Check:
    """Loads a subject as everything else will."""

    name: str
    dataset: Dataset
    root: Path

    def __call__(self, subject: str) -> CheckedSubject:
        try:
            scan, mesh = load_subject(self.name, self.dataset, self.root, subject)
        except DataError as error:
            # Its hints are about an entry that is in the manifest already.
            hint = "Give another --scale" if " m high " in error.what else ""
            raise DataError(
                error.what, expected=error.expected, got=error.got, hint=hint
            ) from error
        assert mesh.texture is not None
        rows, columns = load_rgb(mesh.texture).shape[:2]
        size, hidden = stature(mesh), hidden_share(mesh)
        unit = "units" if self.dataset.scale == UNITS_RULE else "m"
        note = (
            f"{size.extent[1]:.2f} {unit} high, {len(mesh.faces)} faces, "
            f"texture {columns} x {rows}, {hidden:.0%} hidden"
        )
        told = [*scan.warnings, *size.told, *_lies(size.extent.tolist()), *_hides(hidden)]
        told += [
            f"no material file defines '{name}', which faces name"
            for name in materials_of(scan.mesh_path).undefined
        ]
        return CheckedSubject(subject, note, tuple(told))


def _lies(sides: list[float]) -> tuple[str, ...]:
    if sides[1] >= _LYING * max(sides):
        return ()
    shown = " x ".join(f"{side:.2f}" for side in sides)
    return (f"measures {shown}, so that it may lie: is --up right?",)


def _hides(share: float) -> tuple[str, ...]:
    if share < _LAYERED:
        return ()
    return (
        f"no ray from outside reaches {share:.0%} of its area, as of a body under its clothes: it "
        "counts against surfaces that are right outside. --drop-hidden leaves it out of the truth",
    )


@dataclass(frozen=True, slots=True)
class _Convert:
    """Converts a subject unless that was done, then checks it."""

    check: _Check
    place: Path
    found: FoundFolder
    conversion: Conversion

    def __call__(self, subject: str) -> CheckedSubject:
        source, directory = self.found.subjects[subject], self.place / subject
        beside = self.found.companions.get(subject, Companions())
        if not is_converted(source, self.conversion, directory, beside):
            convert_scan(source, self.conversion, directory, beside)
        checked = self.check(subject)
        return replace(checked, warnings=(*told_of(directory), *checked.warnings))


def _dataset(request: AddRequest, rules: Rules, found: FoundFolder, root: str) -> Dataset:
    return Dataset(
        title=request.title or request.name,
        kind=rules.kind,
        licence=request.licence or UNSTATED_LICENCE,
        root=root,
        scale=rules.scale,
        facing=rules.facing,
        hidden=rules.hidden,
        subjects=tuple(found.subjects),
    )


def _only(dataset: Dataset, subjects: tuple[str, ...]) -> Dataset:
    """The same dataset with some of its subjects; that of captures lists none."""
    if dataset.kind == "captures":
        return dataset
    facing = dataset.facing
    if isinstance(facing, dict):
        facing = {subject: facing[subject] for subject in subjects}
    return dataset.model_copy(update={"subjects": subjects, "facing": facing})


def _root(folder: Path, request: AddRequest) -> str:
    """The folder as the manifest has it: relative to the workspace if it lies there."""
    if "${" in str(folder):
        raise HarnessError(
            f"{folder} has '${{' in its name, which a manifest reads as a variable",
            hint="Rename the folder",
        )
    if folder.is_relative_to(request.workspace.root):
        return str(folder.relative_to(request.workspace.root))
    return str(folder)


def _check_apart(folder: Path, place: Path) -> None:
    """Refuse to write into what is read."""
    if folder.is_relative_to(place) or place.is_relative_to(folder):
        raise HarnessError(
            f"{folder} and {place}, where the dataset is kept, lie one inside the other",
            hint="Move the folder elsewhere, or choose another name or --workspace",
        )


def _held(place: Path) -> AbstractContextManager[None]:
    """A lock, so that two commands do not write the same dataset at once."""
    return exclusive_lock(place.parent / f".{place.name}.lock")


#: Stands behind the name of an entry that was written by a command.
MARK = "# written by 'harness data add'"
#: Stands there in the manifest that is installed, where 'harness data add' knows the data set.
SHIPPED = "# 'harness data add NAME DIR' writes this again"
_WIDTH = 110
_PLAIN = re.compile(r"[A-Za-z0-9_./-]+")


@dataclass(frozen=True, slots=True)
class _Place:
    """Lines of a text, from 0; ``end`` is the line after the last one."""

    start: int
    end: int
    indent: int


def with_dataset(text: str, name: str, dataset: Dataset, *, replace: bool) -> str:
    """A manifest's text with a dataset at the end of its block ``datasets``.

    Args:
        text: Of a manifest that has been checked.
        name: Of the dataset.
        dataset: Its entry.
        replace: Whether an entry of that name with the mark is replaced where it stands.

    Raises:
        HarnessError: there is a dataset of that name that may not be replaced.
        DataError: the block is written in braces.
    """
    newline = "\r\n" if "\r\n" in text else "\n"
    lines = _lines(text)
    places = _places(text, lines)
    last = max(places.values(), key=lambda place: place.end)
    if name not in places:
        entry = ["", *_entry(name, dataset, last.indent)]
        return newline.join([*lines[: last.end], *entry, *lines[last.end :]]) + newline
    place = places[name]
    _check_replaceable(name, lines[place.start], replace=replace)
    entry = _entry(name, dataset, place.indent)
    return newline.join([*lines[: place.start], *entry, *lines[place.end :]]) + newline


def check_addable(text: str, name: str, *, replace: bool) -> None:
    """Refuse, before any work, what ``with_dataset`` would refuse; as there."""
    lines = _lines(text)
    places = _places(text, lines)
    if name in places:
        _check_replaceable(name, lines[places[name].start], replace=replace)


def _check_replaceable(name: str, first_line: str, *, replace: bool) -> None:
    if SHIPPED in first_line:
        return
    if MARK not in first_line:
        raise HarnessError(
            f"there is a dataset '{name}' already, which 'harness data add' did not write",
            hint="Choose another name, or edit the manifest",
        )
    if not replace:
        raise HarnessError(
            f"there is a dataset '{name}' already",
            hint="Choose another name, or add --replace to write its entry again",
        )


def _lines(text: str) -> list[str]:
    return text.replace("\r\n", "\n").removesuffix("\n").split("\n")


def _places(text: str, lines: list[str]) -> dict[str, _Place]:
    """Where each dataset stands."""
    root = yaml.compose(text, Loader=yaml.SafeLoader)
    assert isinstance(root, yaml.MappingNode)
    block = next(value for key, value in root.value if key.value == "datasets")
    if not isinstance(block, yaml.MappingNode) or block.flow_style or not block.value:
        raise DataError(
            "the manifest's 'datasets' are not written one below the other",
            expected="'datasets:' and an indented block",
            hint="Write them without braces, or name another manifest with --manifest",
        )
    places: dict[str, _Place] = {}
    for key, value in block.value:
        start, indent = key.start_mark.line, key.start_mark.column
        end = max(_end(value), start + 1)
        # Fields that were commented out belong to the entry above them.
        while end < len(lines) and _is_comment(lines[end], deeper_than=indent):
            end += 1
        places[key.value] = _Place(start, end, indent)
    return places


def _is_comment(line: str, *, deeper_than: int) -> bool:
    text = line.lstrip(" ")
    return text.startswith("#") and len(line) - len(text) > deeper_than


def _end(node: yaml.Node) -> int:
    """The line after a value's last one; a block's own end comes after comments that follow it."""
    if isinstance(node, yaml.MappingNode) and not node.flow_style and node.value:
        return _end(node.value[-1][1])
    if isinstance(node, yaml.SequenceNode) and not node.flow_style and node.value:
        return _end(node.value[-1])
    return node.end_mark.line + (node.end_mark.column > 0)


def _entry(name: str, dataset: Dataset, indent: int) -> list[str]:
    """The lines of an entry."""
    inner = " " * (2 * indent)
    lines = [
        f"{' ' * indent}{_quoted(name)}: {MARK}",
        f"{inner}title: {_quoted(dataset.title)}",
        f"{inner}kind: {dataset.kind}",
        f"{inner}licence: {_quoted(dataset.licence)}",
        f"{inner}root: {_quoted(dataset.root)}",
        f"{inner}scale: {dataset.scale}",
    ]
    if isinstance(dataset.facing, str):
        lines.append(f"{inner}facing: {_quoted(dataset.facing)}")
    else:
        yaws = [f"{_quoted(subject)}: {yaw!r}" for subject, yaw in dataset.facing.items()]
        lines += _wrapped(f"{inner}facing: {{", yaws, "}")
    lines += [f"{inner}field: {dataset.field}"] if dataset.field else []
    if dataset.splits:
        lines.append(f"{inner}splits:")
        for split, subjects in dataset.splits.items():
            head = f"{inner}{inner[:indent]}{_quoted(split)}: ["
            lines += _wrapped(head, [_quoted(each) for each in subjects], "]")
    if dataset.hidden != "kept":
        lines.append(f"{inner}hidden: {dataset.hidden}")
    if dataset.subjects:
        lines += _wrapped(f"{inner}subjects: [", [_quoted(each) for each in dataset.subjects], "]")
    return lines


def _wrapped(head: str, values: list[str], tail: str) -> list[str]:
    return textwrap.wrap(
        head + ", ".join(values) + tail,
        _WIDTH,
        subsequent_indent=" " * len(head),
        break_long_words=False,
        break_on_hyphens=False,
    )


def _quoted(text: str) -> str:
    """A text as YAML reads it back; plain where it cannot be taken for anything else."""
    is_plain = _PLAIN.fullmatch(text) is not None and yaml.safe_load(text) == text
    return text if is_plain else json.dumps(text, ensure_ascii=False)

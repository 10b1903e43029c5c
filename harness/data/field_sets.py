"""The data sets of the field by name: what their descriptions say, and their subjects in a folder.

A description is a file ``field/NAME.yaml``; all of them are read here. Paths in it are templates:
``{id}`` stands for a part of a path, ``{frame}`` for digits, and what is named twice is the same
twice.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from harness.core.errors import DataError, HarnessError, did_you_mean, listed
from harness.core.files.names import inside, is_name, listed_names
from harness.data.layouts import FITTED_BODY, Companions, FoundFolder, Layout
from harness.data.yaml_text import read_yaml

_FOLDER = Path(__file__).with_name("field")
_FRAME, _DIGITS = "frame", r"\d+"
_Ids = Annotated[tuple[str, ...], BeforeValidator(listed_names)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Companion(_Strict):
    """A kind of file that belongs to each scan.

    Attributes:
        files: Where it may lie, templates; the first that is there counts.
        source: Where it comes from if it is missing.
        needed: Whether a scan cannot be used without it.
    """

    files: tuple[str, ...]
    source: str
    needed: bool = False


class PublishedSplit(_Strict):
    """The subjects that a publication used.

    Attributes:
        by: Who uses them, and what is to be known about it.
        ids: The subjects.
        match: A regular expression of their ids, instead.
        listed: A file of the data set that lists them, instead.
        lines: The first and the last line of that file that count, from 1; all where none stands.
        unknown: Where the ids stand, if they are not known here.
    """

    by: str
    ids: _Ids = ()
    match: str = ""
    listed: str = ""
    lines: tuple[int, int] | None = None
    unknown: str = ""


class FieldSet(_Strict):
    """What is known of a data set of the field.

    Attributes:
        title: Name in tables.
        licence: Of the scans.
        source: Where they come from.
        scans: Where scans lie, templates.
        tree: Whether they are read where they lie, with their fits, as THuman's.
        id: Template of a subject's id.
        ids: What ids look like, a regular expression.
        other: What to do where they do not.
        scale: As ``harness data add --scale``; ``unit`` is the one of metres, cm and mm in which
            the scans are as high as people.
        up: As ``--up``; ``longest`` is the one of +y and +z along which the scans are longest.
        facing: As ``--facing``; ``orientation`` is where the companion of that name says.
        grey: Whether scans without colours are made grey.
        floor: Height, in units of the files, below which lies what is no person.
        companions: ``body`` becomes the true body, ``labels`` the regions, ``orientation`` tells
            the front, others are only looked for.
        regions: Names of the labels' numbers.
        person: The part of an id, a group of this regular expression of all of it, that is equal
            for one person; where it does not match, nothing is known.
        people: What stands before it; of a data set with people of another one, that one's name.
        protocol: The metric protocol that belongs to it.
        splits: By name.
    """

    title: str
    licence: str
    source: str
    scans: tuple[str, ...]
    tree: bool = False
    id: str = "{id}"
    ids: str = ".+"
    other: str = ""
    scale: str
    up: str = "+y"
    facing: str = "+z"
    grey: bool = False
    floor: float | None = None
    companions: dict[str, Companion] = Field(default_factory=dict)
    regions: tuple[str, ...] = ()
    person: str = ""
    people: str = ""
    protocol: str
    splits: dict[str, PublishedSplit] = Field(default_factory=dict)

    def person_of(self, subject: str) -> str:
        """Which person a subject is, such as ``4d-dress/00122``; empty where that is not known."""
        found = re.fullmatch(self.person, subject) if self.person else None
        return f"{self.people}/{found[1]}" if found else ""

    def subjects_of(
        self, name: str, dataset: str, known: Sequence[str], stored: Sequence[str] = ()
    ) -> tuple[str, ...]:
        """The subjects of a published split, all of which have to be there.

        Args:
            name: Of the split.
            dataset: The data set's name, for messages.
            known: Its subjects.
            stored: Those of a split that a file of the data set lists.

        Raises:
            HarnessError: no such split, its ids are not known, or subjects are not there.
        """
        split = self.splits.get(name)
        if split is None:
            hint = did_you_mean(name, self.splits)
            raise HarnessError(f"dataset '{dataset}' has no split '{name}'", hint=hint)
        if split.unknown:
            raise HarnessError(
                f"split '{name}' of {self.title}: ids not known here: from {split.unknown}",
                hint="Name its subjects with --subjects",
            )
        ids = tuple(stored) or split.ids
        if split.match:
            ids = tuple(each for each in known if re.fullmatch(split.match, each))
        absent = [each for each in ids if each not in known]
        if absent or not ids:
            raise HarnessError(
                f"split '{name}' of {self.title} is not whole in dataset '{dataset}'",
                expected=f"{len(ids)} subjects" if ids else "subjects of it, or their list",
                got=f"{len(absent)} of them missing: {listed(absent)}" if ids else "none",
                hint=f"Get them from {self.source} and add the data set again with --replace",
            )
        return ids


@cache
def field_names() -> tuple[str, ...]:
    """The names of all data sets of the field that are described."""
    return tuple(sorted(path.stem for path in _FOLDER.glob("*.yaml")))


@cache
def field_set(name: str) -> FieldSet | None:
    """The description of a data set of the field; None for other names."""
    if name not in field_names():
        return None
    path = _FOLDER / f"{name}.yaml"
    try:
        return FieldSet.model_validate(read_yaml(path)[1])
    except ValidationError as error:
        raise DataError(f"{path} is no description of a data set", got=str(error)) from error


@dataclass(frozen=True, slots=True)
class FieldFolder:
    """A data set of the field as it lies in a folder.

    Attributes:
        found: Its subjects that can be used, with what lies beside each.
        damaged: Why others cannot be, by id or path.
        told: What is missing and where it comes from, in words.
        splits: Subjects of the splits that a file of the data set lists.
    """

    found: FoundFolder
    damaged: Mapping[str, str]
    told: tuple[str, ...]
    splits: Mapping[str, tuple[str, ...]]


def find_field(name: str, folder: Path, frame: int | None = None) -> FieldFolder:
    """A data set of the field in a folder, or in the one folder of it that holds it.

    Args:
        name: Of its description.
        folder: What the user named.
        frame: Which frame of each sequence; the first by default.

    Raises:
        DataError: it is not laid out as the description says, or lies there twice.
    """
    field = field_set(name)
    assert field is not None
    if not folder.is_dir():
        raise DataError(f"{folder} is no folder", expected=f"{field.title}, unpacked")
    held = _held(field, folder)
    if len(held) > 1 and held[0][0] != folder:
        places = listed([root.name for root, _ in held])
        raise DataError(f"{folder} holds {field.title} more than once: {places}",
                        hint="Name one of these folders")  # fmt: skip
    if not held:
        raise _other_layout(field, name, folder)
    root, scans = held[0]
    chosen, told = _chosen(field, scans, frame)
    companions, damaged, missing = _companions(field, root, chosen)
    damaged |= _without_scan(field, root, scans, chosen)
    for subject, (path, _) in chosen.items():
        if not re.fullmatch(field.ids, subject) or not is_name(subject):
            damaged[subject] = f"'{subject}' is no id of {field.title}. {field.other}".strip()
        inside(folder, path, folder)
    paths = {each: path for each, (path, _) in chosen.items() if each not in damaged}
    layout = Layout.tree if field.tree else Layout.named
    found = FoundFolder(root.resolve(), layout, paths, companions)
    return FieldFolder(found, damaged, (*told, *missing), _listed_splits(field, root))


def _held(field: FieldSet, folder: Path) -> list[tuple[Path, list[_Match]]]:
    """The folder itself and those in it that hold scans of a data set, with the scans."""
    roots = [folder, *sorted(path for path in folder.iterdir() if path.is_dir())]
    return [(root, found) for root in roots if (found := list(_matches(root, field.scans)))]


def _other_layout(field: FieldSet, name: str, folder: Path) -> DataError:
    """That a folder is laid out in another way; as which other data set, if there is one."""
    others = [(each, field_set(each)) for each in field_names() if each != name]
    alike = [each for each, other in others if other and any(
        re.fullmatch(other.ids, other.id.format(**words))
        for _, scans in _held(other, folder) for _, words in scans)]  # fmt: skip
    return DataError(
        f"{folder} is not laid out as {field.title}",
        expected=" or ".join(field.scans),
        got=listed(sorted(path.name for path in folder.iterdir())) or "an empty folder",
        hint=f"It looks like {' or '.join(alike)}" if alike else f"Get it from {field.source}",
    )


def _pattern(template: str) -> re.Pattern[str]:
    """What paths a template stands for."""
    seen: set[str] = set()

    def group(match: re.Match[str]) -> str:
        word = match[1]
        if word in seen:
            return f"(?P={word})"
        seen.add(word)
        return f"(?P<{word}>{_DIGITS if word == _FRAME else '[^/]+?'})"

    parts = re.split(r"(\{\w+\})", template)
    return re.compile("".join(re.sub(r"\{(\w+)\}", group, part) if part.startswith("{")
                              else re.escape(part) for part in parts))  # fmt: skip


_Match = tuple[Path, Mapping[str, str]]


def _matches(root: Path, templates: Sequence[str]) -> Iterator[_Match]:
    """The files below a folder that a template stands for, with what its words stand for."""
    for template in templates:
        pattern = _pattern(template)
        for path in sorted(root.glob(re.sub(r"\{\w+\}", "*", template))):
            match = pattern.fullmatch(path.relative_to(root).as_posix())
            if match and path.is_file() and not any(p.startswith(".") for p in match.groups()):
                yield path, match.groupdict()


def _chosen(
    field: FieldSet, scans: Sequence[_Match], frame: int | None
) -> tuple[dict[str, _Match], list[str]]:
    """One scan for each subject, and how it was chosen."""
    by_id: dict[str, list[_Match]] = {}
    for path, words in scans:
        by_id.setdefault(field.id.format(**words), []).append((path, words))
    if frame is not None:
        by_id = {
            each: [scan for scan in found if int(scan[1].get(_FRAME, -1)) == frame]
            for each, found in by_id.items()
        }
    chosen = {
        each: min(found, key=lambda scan: int(scan[1].get(_FRAME, 0)))
        for each, found in by_id.items()
        if found
    }
    if not chosen:
        raise DataError(f"no sequence of {field.title} here has a frame {frame}")
    several = sum(len(found) > 1 for found in by_id.values())
    told = [f"of {several} subjects with several frames the first is taken; --frame N takes others"]
    return chosen, told if several else []


def _companions(
    field: FieldSet, root: Path, chosen: Mapping[str, _Match]
) -> tuple[dict[str, Companions], dict[str, str], list[str]]:
    """What lies beside each scan, which scans lack what they need, and what else is missing."""
    beside: dict[str, dict[str, Path]] = {each: {} for each in chosen}
    damaged: dict[str, str] = {}
    told: list[str] = []
    for kind, companion in field.companions.items():
        missing: list[str] = []
        for subject, (_, words) in chosen.items():
            places = [root / template.format(**words) for template in companion.files]
            path = next((place for place in places if place.is_file()), None)
            if path is not None:
                beside[subject][kind] = inside(root, path, root)
            else:
                missing.append(subject)
                if companion.needed:
                    where = places[0].relative_to(root)
                    damaged[subject] = f"no {kind} at {where}: get it from {companion.source}"
        if missing:
            told.append(f"{len(missing)} of {len(chosen)} have no {kind} ({companion.files[0]}), "
                        f"which comes from {companion.source}: {listed(missing)}")  # fmt: skip
    return {each: Companions(dict(found), field.regions, field.floor)
            for each, found in beside.items()}, damaged, told  # fmt: skip


def _without_scan(
    field: FieldSet, root: Path, scans: Sequence[_Match], chosen: Mapping[str, _Match]
) -> dict[str, str]:
    """What has a companion or a mesh of another name, but no scan: renamed, or not unpacked."""
    found: dict[str, str] = {}
    expected = " or ".join(field.scans)
    known = {path for path, _ in scans}
    for companion in field.companions.values():
        for path, words in _matches(root, companion.files):
            known.add(path)
            subject = field.id.format(**words)
            if subject not in chosen:
                where = path.relative_to(root)
                found[subject] = f"no scan belongs to {where} (expected {expected})"
    for template in field.scans:
        like = str(Path(template).with_name(f"*{Path(template).suffix}"))
        for path in sorted(root.glob(re.sub(r"\{\w+\}", "*", like))):
            if path not in known and path.name != FITTED_BODY and path.is_file():
                where = path.relative_to(root)
                found[where.as_posix()] = f"{where} fits no name (expected {expected})"
    return found


def _listed_splits(field: FieldSet, root: Path) -> dict[str, tuple[str, ...]]:
    """The ids of splits that files of the data set list; each may begin with the set's folder."""
    found: dict[str, tuple[str, ...]] = {}
    for name, split in field.splits.items():
        path = root / split.listed
        if split.listed and path.is_file():
            lines = inside(root, path, root).read_text(encoding="utf-8").split("\n")
            first, last = split.lines or (1, len(lines))
            ids = [line.strip().rpartition("/")[2] for line in lines[first - 1 : last]]
            found[name] = tuple(each for each in ids if is_name(each))
    return found

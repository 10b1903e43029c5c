"""The text of a manifest with one more dataset: comments and order of the others stay.

Entries that were written here have a mark in their first line; only these are ever replaced.
"""

from __future__ import annotations

import json
import re
import textwrap
from dataclasses import dataclass

import yaml

from harness.core.errors import DataError, HarnessError
from harness.data.manifest import Dataset

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

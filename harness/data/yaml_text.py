"""YAML files that strangers may write: plain content, with the line of every key."""

from pathlib import Path

import yaml

from harness.core.errors import DataError, is_plain

#: The line of every key, by its path of keys.
Lines = dict[tuple[str, ...], int]

_MOST_BYTES = 2**20
_MOST_DEPTH = 20
#: Some numbers, such as those in sixties, take time that grows with their length squared.
_MOST_LETTERS = 4096
#: libyaml's, where PyYAML was built with it, takes a tenth of the time.
_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def read_yaml(path: Path) -> tuple[Lines, object]:
    """The line of every key, and the file's plain content.

    Raises:
        DataError: no such file, larger than 1 MiB, not YAML in UTF-8, a key that stands twice,
            nesting deeper than 20, a value of more than 4096 letters, or an alias: aliases of
            aliases grow without end.
    """
    return parse_yaml(path, _text(path))


def parse_yaml(path: Path, text: str) -> tuple[Lines, object]:
    """As ``read_yaml``, of a text of at most 1 MiB that was read already."""
    if len(text) > _MOST_BYTES:
        raise DataError(f"{path} is too large", expected=f"at most {_MOST_BYTES} letters")
    try:
        _check_events(path, text)
        loader = _LOADER(text)
        node = loader.get_single_node()
        lines = _lines(path, node)
        return lines, None if node is None else loader.construct_document(node)
    except yaml.YAMLError as error:
        raise DataError(f"{path} is not YAML: {' '.join(str(error).split())}") from error
    except (ArithmeticError, LookupError, TypeError, ValueError) as error:
        # A number of thousands of digits, or a date that no calendar has.
        raise DataError(f"{path} holds a value that cannot be read: {error}") from error


def _text(path: Path) -> str:
    try:
        size = path.stat().st_size
        if size > _MOST_BYTES:
            raise DataError(
                f"{path} is too large for a manifest",
                expected=f"at most {_MOST_BYTES} bytes",
                got=str(size),
            )
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise DataError(f"no manifest at {path}", hint="Name one with --manifest") from error
    except UnicodeDecodeError as error:
        raise DataError(f"{path} is not text in UTF-8", got=str(error)) from error


def _check_events(path: Path, text: str) -> None:
    """Refuse, before anything is built, what could be larger or deeper than the file looks."""
    depth = 0
    for event in yaml.parse(text, Loader=_LOADER):
        line = event.start_mark.line + 1
        if isinstance(event, yaml.AliasEvent):
            raise DataError(
                f"{path}, line {line}: '*{event.anchor}' is an alias",
                expected="every value written out",
                hint="Write the value itself in its place",
            )
        if isinstance(event, yaml.ScalarEvent) and len(event.value) > _MOST_LETTERS:
            raise DataError(
                f"{path}, line {line}: a value of {len(event.value)} letters",
                expected=f"at most {_MOST_LETTERS}",
            )
        if isinstance(event, yaml.ScalarEvent) and not is_plain(event.value):
            raise DataError(f"{path}, line {line}: a value with signs that cannot be shown")
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        if depth > _MOST_DEPTH:
            raise DataError(f"{path}, line {line}: nested more than {_MOST_DEPTH} deep")


def _lines(path: Path, root: yaml.Node | None) -> Lines:
    lines: Lines = {}

    def visit(current: yaml.Node | None, location: tuple[str, ...]) -> None:
        if isinstance(current, yaml.MappingNode):
            for key, value in current.value:
                place = (*location, str(key.value))
                if place in lines:
                    raise DataError(
                        f"{path}, line {key.start_mark.line + 1}: key '{key.value}' stands twice"
                    )
                lines[place] = key.start_mark.line + 1
                visit(value, place)

    visit(root, ())
    return lines

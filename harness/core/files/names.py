"""What datasets, splits, recipes, protocols, subjects, methods and runs may be called.

Names become folders. There is one rule, and all code that makes a path from a name applies it.
What is passed on names files without the folders of the machine that they lie on.

A scan, a camera file or a method may come from a stranger, and what it names is read, copied and
shown. So a path in a file counts from that file's folder, links are followed, and what lies outside
that folder and outside the folders that the user named is refused. What the user named may itself
be a link; a link inside it may not lead out of it.
"""

import os
import re
from collections.abc import Sequence
from pathlib import Path

from harness.core.errors import DataError, HarnessError

_MOST_LETTERS = 64
_NAME = re.compile(rf"(?!.*\.\.)[A-Za-z0-9_][A-Za-z0-9_.+-]{{0,{_MOST_LETTERS - 1}}}")

_RANGE = re.compile(r"(?P<prefix>\D*)(?P<low>\d{1,9})\.\.(?P<prefix2>\D*)(?P<high>\d{1,9})")
_MOST_SUBJECTS = 10_000

#: The rule in words, for messages.
NAME_RULE = (
    f"at most {_MOST_LETTERS} letters (a to z), digits and - _ . +, "
    "with a letter, digit or _ first and no two dots together"
)

#: How cameras are known, by what ``--cameras`` says, and what it adds to the names of rows and
#: recipes: the recipe's own; these refined; estimated with the focal length given; that estimated,
#: too.
CAMERAS = {
    "given": "",
    "refined": "-refined",
    "estimated": "-uncalibrated",
    "estimated-all": "-uncalibrated-all",
}


def suffix_of(name: str) -> str:
    """What of a row's or a recipe's name says how cameras are known; empty if as given."""
    return next((each for each in CAMERAS.values() if each and name.endswith(each)), "")


def is_name(text: str) -> bool:
    """Whether a text may be a name."""
    return _NAME.fullmatch(text) is not None


def checked_name(kind: str, text: str) -> str:
    """The text itself, if it may be a name.

    Args:
        kind: What it names, for the message, such as ``run``.
        text: The name.

    Raises:
        HarnessError: it may not.
    """
    if not is_name(text):
        raise HarnessError(
            f"{text[:_MOST_LETTERS]!r} cannot be the name of a {kind}", expected=NAME_RULE
        )
    return text


def subject_range(text: str) -> tuple[str, ...]:
    """The ids of a range such as ``t00001..t00020``, or none if the text is not one.

    Ranges of more than 10 000 ids are none.
    """
    match = _RANGE.fullmatch(text)
    if not match or match["prefix"] != match["prefix2"] or len(match["low"]) != len(match["high"]):
        return ()
    numbers = range(int(match["low"]), int(match["high"]) + 1)
    if len(numbers) > _MOST_SUBJECTS:
        return ()
    return tuple(f"{match['prefix']}{number:0{len(match['low'])}d}" for number in numbers)


def listed_names(given: str | Sequence[str]) -> tuple[str, ...]:
    """Names in a sequence or in a text with commas, each once; ranges stand for their ids.

    Raises:
        HarnessError: something that is no name.
    """
    texts = given.split(",") if isinstance(given, str) else given
    names = [text.strip() for text in texts if text.strip()]
    found = [single for name in names for single in subject_range(name) or (name,)]
    return tuple(checked_name("method or subject", name) for name in dict.fromkeys(found))


def named_from(message: str, folder: Path) -> str:
    """The message, with files below an absolute folder named from there."""
    if not folder.is_absolute() or folder == Path(folder.anchor):
        return message
    # Only where a path begins: another path may have the same folders further down.
    return re.sub(rf"(?<![\w./~-]){re.escape(str(folder))}/", "", message)


_MOST_SHOWN = 200


def named_path(source: Path, name: str, *folders: Path, base: Path | None = None) -> Path:
    """The path that a file means by a name; whether something is there is not looked at.

    Args:
        source: The file with the name in it; what lies in its folder may be named.
        name: Relative or absolute, as the file has it.
        folders: Further folders that the user named, below which anything may be named.
        base: The folder from which the name counts; ``source``'s by default.

    Raises:
        DataError: it leads out of all these folders, or no file can have this path.
    """
    return inside(source, (base or source.parent) / name, source.parent, *folders)


def inside(source: Path, path: Path, *folders: Path) -> Path:
    """The path itself, if it lies in one of the folders with all links followed.

    Args:
        source: What names it or holds it, for the message.
        path: Of what would be read.
        folders: Where it may lie.

    Raises:
        DataError: it lies elsewhere, or no file can have this path.
    """
    try:
        path.stat()
    except (FileNotFoundError, NotADirectoryError, PermissionError):
        pass  # whoever reads it says so
    except (OSError, ValueError) as error:
        raise DataError(
            f"{source} names what cannot be a path",
            got=f"{str(path)[:_MOST_SHOWN]!r} ({error.args[-1]})",
        ) from error
    found = os.path.realpath(path)
    roots = [os.path.realpath(folder) for folder in folders]
    if any(Path(found).is_relative_to(root) for root in roots):
        return path
    both = os.path.commonpath([found, roots[-1]])
    parent = "" if both == os.path.sep else f"name the folder {both}, which holds both, or "
    raise DataError(
        f"{source} names a file outside the folders that were given",
        expected=f"something in {' or '.join(dict.fromkeys(map(str, folders)))}",
        got=str(path) if str(path) == found else f"{path}, which is {found}",
        hint=f"If it belongs there, {parent}copy it into {folders[-1]}",
    )

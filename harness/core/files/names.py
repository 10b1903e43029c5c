"""What datasets, splits, recipes, protocols, subjects, methods and runs may be called.

Names become folders. There is one rule, and all code that makes a path from a name applies it.
What is passed on names files without the folders of the machine that they lie on.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from harness.core.errors import HarnessError

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
#: recipes: the recipe's own; estimated with the focal length given; that estimated, too.
CAMERAS = {"given": "", "estimated": "-uncalibrated", "estimated-all": "-uncalibrated-all"}


def suffix_of(name: str) -> str:
    """What of a row's or a recipe's name says that cameras were estimated; empty if nothing."""
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

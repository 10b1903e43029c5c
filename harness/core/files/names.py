"""What datasets, splits, recipes, protocols, subjects, methods and runs may be called.

Names become folders. There is one rule, and all code that makes a path from a name applies it.
What is passed on names files without the folders of the machine that they lie on.
"""

from __future__ import annotations

import re
from pathlib import Path

from harness.core.errors import HarnessError

_MOST_LETTERS = 64
_NAME = re.compile(rf"(?!.*\.\.)[A-Za-z0-9_][A-Za-z0-9_.+-]{{0,{_MOST_LETTERS - 1}}}")

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


def named_from(message: str, folder: Path) -> str:
    """The message, with files below an absolute folder named from there."""
    if not folder.is_absolute() or folder == Path(folder.anchor):
        return message
    # Only where a path begins: another path may have the same folders further down.
    return re.sub(rf"(?<![\w./~-]){re.escape(str(folder))}/", "", message)

"""Every error that a user can cause, and what the command line answers with.

``HarnessError`` is the root; the command line prints its message in one line, without a traceback,
and exits with ``exit_code``. Anything else is a defect of ours and keeps its traceback.

======================  =========  ==================================================
class                   exit code  meaning
======================  =========  ==================================================
``HarnessError``        2          a request that cannot be carried out as given
``DataError``           3          a file or mesh is not what it should be
``WriteError``          3          a file cannot be written: no room, or no right to
``MissingPart``         4          a licensed or optional part is not installed
``MethodError``         5          a method, renderer or worker process failed
``Killed``              5          a process was killed, as when memory runs out
``ProtocolMismatch``    6          numbers of different protocols would be mixed
======================  =========  ==================================================

Exit code 1 is kept for "the command ran and the answer is no": failed subjects, moved numbers.
What is shown has no sign in it that moves a terminal's cursor or hides what is written.
"""

import difflib
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Self

#: Control characters but for tabs and line breaks, halves of signs, and what turns text around.
_UNSHOWN = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069\ud800-\udfff]"
)


def plain_text(text: str) -> str:
    """The text with a mark in the place of each sign that must not be shown."""
    return _UNSHOWN.sub("\N{REPLACEMENT CHARACTER}", text.replace("\r\n", "\n"))


def is_plain(text: str) -> bool:
    """Whether all of a text may be shown."""
    return _UNSHOWN.search(text) is None


_NAMES_SHOWN = 20


class HarnessError(Exception):
    """A request that cannot be carried out.

    The message says what and where; ``expected`` and ``got`` are appended when given; ``hint`` is
    the next step.
    """

    exit_code = 2

    def __init__(self, what: str, *, expected: str = "", got: str = "", hint: str = "") -> None:
        self.what, self.expected, self.got, self.hint = what, expected, got, hint
        super().__init__(str(self))

    def __str__(self) -> str:
        contrast = "; ".join(
            f"{label} {text}"
            for label, text in (("expected", self.expected), ("got", self.got))
            if text
        )
        text = f"{self.what} ({contrast})" if contrast else self.what
        # Names of files and what other programs print reach terminals, logs and records with it.
        return plain_text(f"{text}. {self.hint}" if self.hint else text)

    def located(self, where: object) -> Self:
        """The same error, with the file or place where it was met in front."""
        return type(self)(
            f"{where}: {self.what}", expected=self.expected, got=self.got, hint=self.hint
        )

    def __reduce__(self) -> tuple[object, ...]:
        return (_rebuild, (type(self), self.what, self.expected, self.got, self.hint))


def _rebuild(
    kind: type[HarnessError], what: str, expected: str, got: str, hint: str
) -> HarnessError:
    return kind(what, expected=expected, got=got, hint=hint)


class DataError(HarnessError):
    """A file, mesh, image or manifest is not what it should be."""

    exit_code = 3


class WriteError(DataError):
    """A file cannot be written, because of a full disk or a missing right.

    It says nothing of the work that was to be kept.
    """


class MissingPart(HarnessError):
    """A licensed, optional or system part is not there; the hint says where it comes from."""

    exit_code = 4


class MethodError(HarnessError):
    """A method, a renderer or their worker process failed."""

    exit_code = 5


class Killed(MethodError):
    """A process was killed from outside, as the system does when memory runs out.

    Others may have taken the memory: it is no failure of what the process worked on.
    """


class ProtocolMismatch(HarnessError):
    """Numbers made under different protocols or datasets would meet in one table."""

    exit_code = 6


def error_values(error: HarnessError) -> dict[str, str]:
    """An error as JSON values; its class is the nearest one that is known here."""
    return {
        "kind": next(kind.__name__ for kind in type(error).__mro__ if kind.__name__ in globals()),
        "what": error.what,
        "expected": error.expected,
        "got": error.got,
        "hint": error.hint,
    }


def found_error(values: Mapping[str, str]) -> HarnessError:
    """The error behind ``error_values``."""
    kind: type[HarnessError] = globals()[values["kind"]]
    return kind(**{name: text for name, text in values.items() if name != "kind"})


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """A hint that names the nearest known spelling, or lists what is known."""
    names = sorted(known)
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    return f"Did you mean '{close[0]}'?" if close else f"Known: {listed(names) or 'none'}"


def listed(names: Sequence[str]) -> str:
    """Names for a message: the first twenty, and how many more there are."""
    # One more takes no more room than to say so.
    shown = names if len(names) == _NAMES_SHOWN + 1 else names[:_NAMES_SHOWN]
    more = len(names) - len(shown)
    return ", ".join(shown) + (f" and {more} more" if more > 0 else "")

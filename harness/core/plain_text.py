"""Text that is safe to show: no sign in it moves a terminal's cursor or hides what is written."""

from __future__ import annotations

import re

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

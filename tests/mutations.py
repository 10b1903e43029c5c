"""Records with one value flipped, removed or replaced, as a stranger may hand them in."""

from __future__ import annotations

import json
import random
from collections.abc import Iterator

#: What stands in the place of a value: other types, no numbers, too much, other places, no text.
NESTED: object = json.loads("[" * 100 + "]" * 100)
OTHERS: tuple[object, ...] = (
    None, True, False, 0, -1, 1, 7, 10**30, -(2**63), 0.5, -0.001, 1e308, -1e308, float("nan"),
    float("inf"), "", "0", "metre", "units", "=1+1", "@everyone", "http://example.org", "a\nb",
    "../../ESCAPED", "/etc/passwd", "\x1b[2J\x1b[31m", "\ud800", "\u202egnp", "a" * 100_000, "9999",
    "2026-W01-1", "2026-01-01T00:00:00+23:00", [], {}, [None], {"": None}, [0, 0], {"a": {"b": []}},
    NESTED,
)  # fmt: skip


def mutated(text: str, count: int, seed: int = 0) -> Iterator[str]:
    """So many texts of JSON, each with one value changed, removed or added; equal for a seed."""
    draw = random.Random(seed)
    for _ in range(count):
        document = json.loads(text)
        holder, key = document, draw.choice(list(document))
        while isinstance(holder[key], dict | list) and holder[key] and draw.random() < 0.8:
            holder = holder[key]
            key = draw.choice(list(holder) if isinstance(holder, dict) else range(len(holder)))
        kind = draw.choice(("flip", "flip", "remove", "replace", "replace", "add"))
        if kind == "remove":
            del holder[key]
        elif kind == "flip" and isinstance(holder[key], bool | int | float | str):
            holder[key] = _flipped(holder[key], draw)
        elif kind == "add" and isinstance(holder, dict):
            holder[draw.choice(["", "new", "../x", "share_a", "\x00"])] = draw.choice(OTHERS)
        else:
            holder[key] = draw.choice(OTHERS)
        yield json.dumps(document)


def _flipped(value: bool | float | str, draw: random.Random) -> object:
    if isinstance(value, bool):
        return not value
    if isinstance(value, int | float):
        return draw.choice([-value, value + 1, value * 1000, value / 3, str(value)])
    place = draw.randrange(len(value) + 1)
    return value[:place] + chr(draw.choice([0, 9, 46, 47, 65, 0x2028, 0xD83D])) + value[place + 1 :]

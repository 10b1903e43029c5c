"""Which parts a method is run with: the open ones, or the paper's own that a user imported.

A choice replaces an open part by the paper's where a method uses it, and nothing else: a method
that is given the scan's normals keeps them, and a fit that starts from all landmarks still does.
"""

from __future__ import annotations

from dataclasses import dataclass

from harness.core.errors import HarnessError, did_you_mean
from harness.core.protocols import MethodInfo

OPEN, PAPER = "open", "paper"


@dataclass(frozen=True, slots=True)
class _Exchange:
    """A setting and its values with the open part and with the paper's."""

    setting: str
    open: str
    paper: str


#: By the name of the part: what it is called among open parts and among the paper's, and the
#: settings that it decides.
_PARTS: dict[str, tuple[str, str, tuple[_Exchange, ...]]] = {
    "body": ("anny", "smplx", (_Exchange("body.model", "anny", "smplx"),)),
    "start": ("landmarks", "pixie", (_Exchange("body.start", "average", "pixie"),)),
    "normals": (
        "open",
        "econ",
        tuple(
            _Exchange(f"{room}.normals", "open", "econ") for room in ("body", "surface", "nview")
        ),
    ),
    "completion": ("body", "ifnet", (_Exchange("surface.completion", "body", "ifnet"),)),
}


@dataclass(frozen=True, slots=True)
class PartChoice:
    """The parts that were chosen.

    Attributes:
        papers: Names of the parts for which the paper's own is used.
    """

    papers: frozenset[str] = frozenset()

    def settings(self, info: MethodInfo) -> dict[str, str]:
        """What a method's settings have to be changed to, as text by name."""
        exchanges = [each for name in sorted(self.papers) for each in _PARTS[name][2]]
        return {each.setting: each.paper for each in exchanges if _uses(info, each)}


def _uses(info: MethodInfo, exchange: _Exchange) -> bool:
    """Whether a method uses the open part."""
    room, _, name = exchange.setting.partition(".")
    own = info.parameters.get(room, {})
    # A fit that ends with the first bodies has no start to go on from, but PIXIE may make them.
    value = own.get(name, "average" if name == "start" and "stage" in own else None)
    return value == exchange.open


def parsed_parts(text: str) -> PartChoice:
    """The choice behind ``--parts``.

    Args:
        text: ``open``, ``paper``, or pairs such as ``normals=econ,body=smplx``; parts that are not
            named are open.

    Raises:
        HarnessError: a part or a name that is not known.
    """
    if text in ("", OPEN):
        return PartChoice()
    if text == PAPER:
        return PartChoice(frozenset(_PARTS))
    return PartChoice(frozenset(filter(None, map(_paper_part, text.split(",")))))


def _paper_part(pair: str) -> str:
    """The name of the part that a pair chooses the paper's own of; empty for an open one."""
    key, separator, name = (word.strip() for word in pair.partition("="))
    if not separator or key not in _PARTS:
        raise HarnessError(
            f"--parts {pair}",
            expected="open, paper, or pairs such as normals=econ",
            hint=did_you_mean(key, [OPEN, PAPER, *_PARTS]),
        )
    open_name, paper_name, _ = _PARTS[key]
    if name not in (open_name, paper_name):
        raise HarnessError(f"--parts {pair}", expected=f"{key}={open_name} or {key}={paper_name}")
    return key if name == paper_name else ""

"""What other publications print of their methods, each with protocol, data, and what was given.

Only numbers whose table or page is known are here; where a publication's numbers were not found,
that is said. No number stands without its protocol, split and privileges.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from harness.core.errors import HarnessError
from harness.core.protocols import Privilege
from harness.core.records import Record
from harness.core.settings import MetricProtocol
from reports.published.printed import PublishedBlock, PublishedRow, PublishedValue
from reports.tables.geometry import geometry_table
from reports.tables.table import Column, Table


@dataclass(frozen=True, slots=True)
class Printed:
    """The numbers of one method in one publication.

    Attributes:
        method: As printed.
        protocol: Whose program made them.
        data: Data set and split.
        where: Publication and page or table.
        numbers: As printed, by key of the protocol's summary.
        unit: Of lengths, as printed.
        given: What the method was given at test time.
        trained_on: What it was trained on, where that is known.
        note: What else must be known.
    """

    method: str
    protocol: str
    data: str
    where: str
    numbers: dict[str, str]
    unit: str
    given: tuple[Privilege, ...] = ()
    trained_on: str = ""
    note: str = ""


_LENGTHS = ("mm", "cm", "ndc-cm")
_SITH = "SiTH, EVALUATE.md of its code"
_ECON = "ECON, docs/testing.md of its code (ECON_EX)"
_CUSTOM = "CustomHumans, 60 scans"
_NFP = "CAPE-NFP"
_SPLIT = "CAPE, split not found"
_BOTH = (Privilege.TRUE_BODY, Privilege.TRUE_NORMALS)


def _sith(method: str, trained_on: str, line: str) -> Printed:
    keys = ("p_to_s", "s_to_p", "nc", "f_score")
    numbers: dict[str, str] = dict(zip(keys, line.split(), strict=True))
    note = "The program prints mm, the page cm"
    return Printed(method, "sith", _CUSTOM, _SITH, numbers, "cm", (), trained_on, note)


def _econ(data: str, line: str) -> Printed:
    numbers: dict[str, str] = dict(zip(("chamfer", "p2s", "nc"), line.split(), strict=True))
    return Printed("ECON", "econ", data, _ECON, numbers, "ndc-cm")


#: The key of a number of which it was not found what it measures.
_UNATTRIBUTED = "unattributed"


def _sifu(
    method: str, data: str, where: str, number: str, given: tuple[Privilege, ...], note: str
) -> Printed:
    return Printed(method, "sifu", data, where, {_UNATTRIBUTED: number}, "", given, "", note)


#: In the order of the protocols.
PRINTED: tuple[Printed, ...] = (
    _econ("CAPE, pose.txt (100 scans, 3 views)", "0.926 0.917 0.0367"),
    _econ("RenderPeople, loose.txt (100 scans, 3 views)", "1.342 1.458 0.0478"),
    _sifu("SIFU", _NFP, "SIFU's paper", "0.77", _BOTH, "its program takes all 100 scans"),
    _sifu("SIFU", _NFP, "PSHuman's paper (PSHuman issue 2)", "1.57", (), ""),
    _sifu("GTA", _SPLIT, "GTA's paper", "0.81", _BOTH, "its program takes 50 scans of CAPE-NFP"),
    _sifu("GTA", _SPLIT, "SIFU's paper", "0.73", (), ""),
    _sifu("GTA", _SPLIT, "GTA issue 9", "1.12", (Privilege.TRUE_BODY,), "no true normals"),
    _sith("SiTH", "THuman2.0", "1.871 2.045 0.826 37.029"),
    _sith("ECON*", "THuman2.0", "2.483 2.680 0.797 30.894"),
    _sith("ICON*", "THuman2.0", "2.256 2.795 0.791 30.437"),
)

#: Publications whose tables could not be read here, by protocol.
NOT_FOUND: dict[str, str] = {
    "icon": "ICON",
    "hilo": "HiLo",
    "econ": "PSHuman and VS, whose evaluators are ECON's",
    "xavatar": "X-Avatar",
    "puzzle": "PuzzleAvatar; UP2You, which says Chamfer -15 % and P2S -18 % of PuzzleAvatar's",
    "canonicalfusion": "CanonicalFusion",
    "pifu": "PIFu",
}


def published_under(protocol: MetricProtocol, records: Sequence[Record] = ()) -> Table:
    """Own rows under a protocol, and below them what was printed under it.

    Args:
        protocol: Of the field.
        records: Of one run that was measured by it; without any there are printed numbers alone.

    Raises:
        HarnessError: nothing printed is known.
        ProtocolMismatch: records of another protocol.
    """
    printed = [each for each in PRINTED if each.protocol == protocol.name]
    missing = NOT_FOUND.get(protocol.name, "")
    if not printed:
        raise HarnessError(
            f"no number that was printed under protocol {protocol.name} is known",
            got=f"not found are those of {missing}" if missing else "",
            hint=f"Known: {', '.join(dict.fromkeys(each.protocol for each in PRINTED))}",
        )
    keys = {column.key: column.unit for column in protocol.columns}
    block = PublishedBlock(
        source=f"Printed under protocol {protocol.name}",
        note="; ".join(dict.fromkeys(_words(each) for each in printed))
        + (f". Not found: {missing}" if missing else ""),
        columns={key: f"{key} ({unit})" for key, unit in keys.items()},
        rows=tuple(_row(each, keys) for each in printed),
    )
    if records:
        return _replaced(geometry_table(records), block)
    return Table(
        name="published",
        title=f"Published under protocol {protocol.name}",
        dataset="as said below",
        recipe="of the authors",
        protocol=None,
        columns=tuple(Column(key, key, key, unit, 3, ranked=False) for key, unit in keys.items()),
        rows=(),
        published=block,
        origin="Printed by others, not measured here",
    )


def _replaced(table: Table, block: PublishedBlock) -> Table:
    return replace(
        table, name="published", title="Own results beside printed ones", published=block
    )


def _words(each: Printed) -> str:
    given = ", ".join(privilege.label for privilege in each.given) or "no privilege known"
    parts = (each.where, each.data, f"given: {given}", each.note)
    trained = f", trained on {each.trained_on}" if each.trained_on else ""
    return f"{each.method}{trained}: " + ", ".join(part for part in parts if part)


def _row(each: Printed, units: dict[str, str]) -> PublishedRow:
    given = " + ".join(privilege.label for privilege in each.given)
    title = f"{each.method}, {each.data}" + (f", {given}" if given else "")
    cells = {}
    for key, text in each.numbers.items():
        if key == _UNATTRIBUTED:
            title += f": {text}, of which metric was not found"
            continue
        unit = each.unit if units[key] in _LENGTHS else units[key]
        words = text if unit == units[key] else f"{text} {unit}"
        cells[key] = PublishedValue(words, float(text), unit)
    return PublishedRow(title, cells)

"""The model card says what the shipped network, its provenance and the measured tables say."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from pathlib import Path

from methods.normals import NormalChoice, installed
from methods.normals.installed import OPEN_NETWORK
from normal_training.training_runs import provenance, sittings_of, spans

ROOT = Path(__file__).parents[3]
WEIGHTS = ROOT / "packages" / "open-normals" / "open_normals"
CARD = (ROOT / "packages" / "open-normals" / "MODEL_CARD.md").read_text(encoding="utf-8")
RESULTS = (ROOT / "docs" / "lab" / "results.md").read_text(encoding="utf-8")
TITLES = {"mexecon+": "MExECON+, N views"}


def test_the_card_is_of_the_shipped_file() -> None:
    shipped = json.loads((WEIGHTS / "weights.json").read_text())
    stored = shipped[OPEN_NETWORK]

    assert f"# Model card: `{OPEN_NETWORK}`" in CARD
    assert "(open_normals/PROVENANCE.md)" in CARD
    assert (
        f"`packages/open-normals/open_normals/{stored['file']}`, {stored['bytes'] / 1e6:.1f} MB"
        in CARD
    )
    assert f"| licence | {stored['licence']};" in CARD


def test_the_cards_numbers_are_those_of_the_measured_tables() -> None:
    table = RESULTS[RESULTS.index("## Normal maps") :]
    rows = re.findall(
        r"^\| `([\w+]+)` \| (\w+ photo, \w+ side) \| ([\d.]+) \| ([\d.]+) \| ([\d.]+) \|$",
        CARD,
        re.MULTILINE,
    )

    assert len(rows) >= 4
    for method, side, body, network, share in rows:
        line = next(
            line for line in table.splitlines() if line.startswith(f"| {TITLES[method]}: {side}<")
        )
        cells = [cell.strip() for cell in line.split("|")]
        assert (cells[2], cells[3], cells[7]) == (body, network, share)


def test_the_card_names_the_training_subjects_of_all_sittings() -> None:
    stored = json.loads((WEIGHTS / "weights.json").read_text())[OPEN_NETWORK]
    sittings = sittings_of(WEIGHTS / stored["file"])
    page = (WEIGHTS / "PROVENANCE.md").read_text(encoding="utf-8")
    trained = _together(sitting.trained for sitting in sittings)
    judges = _together(sitting.judged for sitting in sittings)
    steps = [sitting.curve[-1].step for sitting in sittings]

    assert page == provenance(OPEN_NETWORK, sittings)
    card = " ".join(CARD.split())
    assert "trained on generated people only" in card
    count = sum(map(len, trained.values()))
    assert f"{count} subjects in {len(steps)} sittings of {sum(steps)} steps" in card
    for listed in (trained, judges):
        named = [f"{dataset} {spans(sorted(ids))}" for dataset, ids in listed.items()]
        assert " and of ".join(named) in card
    for dataset, ids in judges.items():
        assert not ids & trained[dataset]


def _together(each: Iterable[Mapping[str, tuple[str, ...]]]) -> dict[str, set[str]]:
    """All subjects of some sittings by dataset."""
    found: dict[str, set[str]] = {}
    for subjects in each:
        for dataset, ids in subjects.items():
            found.setdefault(dataset, set()).update(ids)
    return found


def test_what_is_shipped_is_whole() -> None:
    """The package's own folder: every entry's file is there, and every network has an entry."""
    place = installed.Place("shipped", WEIGHTS)
    networks = installed.listed(place)
    assert [network.name for network in networks] == [OPEN_NETWORK]
    for network in networks:
        assert installed.shipped(network.name).path.samefile(network.path)
        # One that asks for a size has a second network, which sees the person larger.
        networks_in_it = 2 if NormalChoice("onnx", network.name).side_px else 1
        assert network.bytes == network.path.stat().st_size <= networks_in_it * 20e6
        assert network.training_set
    assert {path.name for path in WEIGHTS.glob("*.onnx")} == {
        network.path.name for network in networks
    }

"""The model card says what the shipped network, its provenance and the measured tables say."""

from __future__ import annotations

import json
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
WEIGHTS = ROOT / "methods" / "normals" / "weights"
CARD = (ROOT / "docs" / "model_card.md").read_text(encoding="utf-8")
RESULTS = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")
TITLES = {"econ": "ECON", "mexecon8": "MExECON, 8 views"}


def test_the_card_is_of_the_shipped_file() -> None:
    shipped = json.loads((WEIGHTS / "weights.json").read_text())
    first, *others = sorted(shipped)
    stored = shipped[first]

    assert f"# Model card: `{first}`" in CARD
    for name in others:
        size = f"`{shipped[name]['file']}` ({shipped[name]['bytes'] / 1e6:.1f} MB)"
        assert f"`{name}`" in CARD
        assert size in CARD
        assert (WEIGHTS / f"PROVENANCE-{name}.md").is_file()
    assert f"`methods/normals/weights/{stored['file']}`, {stored['bytes'] / 1e6:.1f} MB" in CARD
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


def test_the_card_names_the_training_subjects_of_the_provenance() -> None:
    provenance = (WEIGHTS / "PROVENANCE.md").read_text(encoding="utf-8")

    assert "trained on generated people only" in CARD
    for subject in ("`t00011` and `t00018`", "`t00019` and `t00020`"):
        assert subject in CARD
        assert subject in provenance
    assert "4.6 million numbers" in CARD
    assert "4.6 million numbers" in provenance

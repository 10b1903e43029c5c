"""The model card says what the shipped network, its provenance and the measured tables say."""

from __future__ import annotations

import json
import re
from pathlib import Path

from methods.normals.installed import OPEN_NETWORK

ROOT = Path(__file__).parents[2]
WEIGHTS = ROOT / "methods" / "normals" / "weights"
CARD = (ROOT / "docs" / "model_card.md").read_text(encoding="utf-8")
RESULTS = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")
TITLES = {"mexecon+": "MExECON+, N views"}


def test_the_card_is_of_the_shipped_file() -> None:
    shipped = json.loads((WEIGHTS / "weights.json").read_text())
    stored = shipped[OPEN_NETWORK]

    assert f"# Model card: `{OPEN_NETWORK}`" in CARD
    for name, entry in shipped.items():
        assert f"(../methods/normals/weights/PROVENANCE-{name}.md)" in CARD
        assert (WEIGHTS / f"PROVENANCE-{name}.md").is_file()
        if name != OPEN_NETWORK:
            assert f"`{entry['file']}` ({entry['bytes'] / 1e6:.1f} MB)" in CARD
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
            line for line in table.splitlines() if line.startswith(f"| {TITLES[method]}: {side} |")
        )
        cells = [cell.strip() for cell in line.split("|")]
        assert (cells[2], cells[3], cells[7]) == (body, network, share)


def test_the_card_names_the_training_subjects_of_all_sittings() -> None:
    stored = json.loads((WEIGHTS / "weights.json").read_text())[OPEN_NETWORK]
    page = (WEIGHTS / f"PROVENANCE-{OPEN_NETWORK}.md").read_text(encoding="utf-8")
    trained, _, _ = stored["training_set"].rpartition(", version")
    sittings = re.findall(r"and saw \d+ subjects: (.*?) \(version \d+\)", page)
    steps = [int(n) for n in re.findall(r"--steps (\d+)", page)]
    (judges,) = set(re.findall(r"These only judged: (.*?)\.\n", page))

    assert set().union(*map(_expanded, sittings)) == _expanded(trained)
    card = " ".join(CARD.split())
    assert "trained on generated people only" in card
    count = len(_expanded(trained))
    assert f"{count} subjects in {len(steps)} sittings of {sum(steps)} steps" in card
    for listed in (trained, judges):
        assert listed.replace("; ", " and of ") in card
    assert not _expanded(judges) & _expanded(trained)


def _expanded(listed: str) -> set[str]:
    """The subjects of a list such as ``avatars-train t00001..t00003, t00007``."""
    found: set[str] = set()
    for first, last in re.findall(r"\b([tuv]\d{5})(?:\.\.([tuv]\d{5}))?", listed):
        numbers = range(int(first[1:]), int((last or first)[1:]) + 1)
        found |= {f"{first[0]}{number:05d}" for number in numbers}
    return found

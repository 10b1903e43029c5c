"""What changed, in words."""

from __future__ import annotations

from harness.core.process.source_digest import differences, listed_differences

BEFORE = {
    "code": {"methods.hull": "ab", "methods.gone": "cd"},
    "packages": {"scipy": "1.17", "torch": ""},
    "truth": {"sha256": {"body.npz": "12"}, "rule": "metres"},
    "protocol": {"samples": 3, "name": "x" * 50},
    "seed": 0,
    "views": (0, 4),
}
NOW = {
    "code": {"methods.hull": "ac", "methods.new": "ef"},
    "packages": {"scipy": "1.18", "torch": "2.13"},
    "truth": {"sha256": {"body.npz": "13"}, "rule": "fit"},
    "protocol": {"samples": 4, "name": "y" * 50},
    "seed": 1,
    "views": [0, 4],
}


def test_every_kind_of_change_is_named() -> None:
    assert differences(BEFORE, NOW) == [
        "code of methods.hull",
        "code of methods.gone (gone)",
        "code of methods.new (new)",
        "package scipy 1.17 -> 1.18",
        "package torch none -> 2.13",
        "file body.npz",
        "truth rule metres -> fit",
        "protocol samples 3 -> 4",
        "protocol name",
        "seed 0 -> 1",
    ]
    assert differences(BEFORE, BEFORE) == []


def test_a_long_list_is_cut() -> None:
    assert listed_differences(BEFORE, NOW).endswith("package scipy 1.17 -> 1.18, 6 more")
    assert listed_differences({"seed": 0}, {"seed": 1}) == "seed 0 -> 1"

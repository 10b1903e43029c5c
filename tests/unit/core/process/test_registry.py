"""Names that become objects on first use."""

from __future__ import annotations

import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from harness.core.errors import HarnessError, MissingPart
from harness.core.process import registry as registry_module
from harness.core.process.registry import Registry

TARGETS = {
    "hull8": "json:loads",
    "mexecon": "json:JSONDecoder.decode",
    "gone": "no_such_package:thing",
    "moved": "json:no_such_object",
    "odd": "this is no target",
}


def registry(group: str = "") -> Registry:
    return Registry("method", TARGETS, group)


def test_a_name_becomes_its_object() -> None:
    import json

    assert registry().resolve("hull8") is json.loads
    assert registry().resolve("mexecon") is json.JSONDecoder.decode


def test_names_are_listed_in_order_without_an_import(tmp_path: Path) -> None:
    assert list(Registry("method", {"b": "never_there:x", "a": "never_there:y"})) == ["b", "a"]
    assert "never_there" not in sys.modules


@pytest.mark.parametrize("name", ["hull", "hul8", "mexecom"])
def test_an_unknown_name_is_answered_with_the_nearest(name: str) -> None:
    nearest = "mexecon" if name.startswith("m") else "hull8"

    with pytest.raises(HarnessError, match=f"unknown method '{name}'. Did you mean '{nearest}'?"):
        registry().resolve(name)


def test_a_name_like_no_other_is_answered_with_all() -> None:
    with pytest.raises(HarnessError, match="Known: gone, hull8, mexecon, moved, odd"):
        registry().resolve("zzz")
    with pytest.raises(HarnessError, match="Known: none"):
        Registry("renderer", {}).resolve("zzz")


def test_a_missing_package_is_a_missing_part() -> None:
    with pytest.raises(MissingPart, match="'gone' could not be loaded: No module named 'no_such"):
        registry().resolve("gone")


@pytest.mark.parametrize("name", ["moved", "odd"])
def test_a_wrong_target_says_what_was_registered(name: str) -> None:
    with pytest.raises(HarnessError, match=f"'{name}' is not where it is registered") as caught:
        registry().resolve(name)

    assert TARGETS[name] in str(caught.value)


def test_third_parties_add_names_but_replace_none(monkeypatch: pytest.MonkeyPatch) -> None:
    points = [
        EntryPoint("theirs", "json:dumps", "some.group"),
        EntryPoint("hull8", "json:dumps", "some.group"),
    ]
    monkeypatch.setattr(registry_module, "entry_points", lambda group: points)

    import json

    assert registry("some.group").resolve("theirs") is json.dumps
    assert registry("some.group").resolve("hull8") is json.loads
    assert "theirs" not in registry().targets()

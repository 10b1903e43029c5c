"""What 'harness methods' prints, and that the documentation says the same."""

from __future__ import annotations

import json
from pathlib import Path

from typer.testing import CliRunner

from harness.cli.main import app
from harness.cli.methods import markdown_pages, text_page
from harness.core.protocols import Deviation, MethodInfo, Privilege
from harness.run.method_choice import catalogued_methods
from methods.catalog import METHODS

DOCS = Path(__file__).parents[3] / "docs" / "methods.md"


def told(*arguments: str) -> str:
    result = CliRunner().invoke(app, ["methods", *arguments])
    assert result.exit_code == 0, result.output
    return result.stdout


def test_the_documentation_is_what_the_methods_say():
    """Remade by ``harness methods docs -o docs/methods.md``."""
    found = catalogued_methods()
    assert not found.failures
    infos = [method.info for method in found.usable]
    assert DOCS.read_text(encoding="utf-8") == markdown_pages(infos)


def test_the_list_names_every_method_and_what_it_is_given():
    text = told("list")
    for name in METHODS:
        assert any(line.startswith(f"{name} ") for line in text.splitlines())
    assert "ground truth mesh" in text
    assert set(json.loads(told("list", "--json"))["methods"]) == set(METHODS)


def test_a_method_is_shown_with_every_deviation_and_privilege():
    text = told("show", "mexecon8")
    info = METHODS.resolve("mexecon8").info
    for deviation in info.deviations:
        assert f"\n  {deviation.what}\n" in text
    for privilege in info.privileges:
        assert privilege.label in text
    assert "body.iterations = 35" in text
    assert "surface.faces = 50000" in text


def test_a_users_setting_is_shown_as_a_deviation():
    shown = json.loads(told("show", "mexecon8", "--set", "body.head=0", "--json"))
    (own,) = [entry for entry in shown["deviations"] if entry["what"] == "body.head"]
    assert (own["published"], own["here"], own["why"]) == ("0.1", "0.0", "set by the user")


def test_long_texts_are_wrapped_and_nested_settings_named_in_full():
    info = MethodInfo(
        "m",
        "M",
        privileges=(Privilege.SUBJECT_CENTRE,),
        parameters={"room": {"inner": {"size": 3}}},
        deviations=(Deviation("a", "word " * 60, "here", "why"),),
    )
    page = text_page(info)
    assert "  room.inner.size = 3" in page
    assert max(map(len, page.splitlines())) <= 100


def test_an_unknown_method_is_one_sentence():
    result = CliRunner().invoke(app, ["methods", "show", "mexecon9"])
    assert "Did you mean" in str(result.exception)


def test_a_number_of_views_is_told():
    assert "Views: 4 of all, as evenly apart as can be" in text_page(
        MethodInfo("m", "M", view_count=4)
    )

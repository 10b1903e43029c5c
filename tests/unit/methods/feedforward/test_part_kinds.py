"""VGGT and its kin under ``harness parts``: missing, imported, verified, damaged."""

from __future__ import annotations

import json

import pytest
from typer.testing import CliRunner

from harness.cli.main import app
from harness.core.errors import HarnessError
from methods.feedforward.parts import VGGT


def run(*arguments: str):
    return CliRunner().invoke(app, ["parts", *map(str, arguments)])


def listed(name: str) -> dict:
    found = run("list", "--json")
    assert found.exit_code == 0, found.output
    (entry,) = [entry for entry in json.loads(found.stdout) if entry["name"] == name]
    return entry


@pytest.mark.parametrize("name", ["vggt", "da3", "mapanything"])
def test_what_is_missing_is_listed_with_its_licence_and_command(name, parts_folder):
    entry = listed(name)
    assert entry["state"] == "missing"
    assert "huggingface.co" in entry["source"]
    assert entry["licence"]
    if name == "vggt":
        text = run("list").stdout
        assert f"missing  {VGGT.command}" in text


@pytest.mark.nightly
def test_weights_are_imported_verified_and_damage_is_found(parts_folder, weights, foreign_python):
    done = run("import", "vggt", weights, "--python", foreign_python)
    assert done.exit_code == 0, done.output
    assert "Next: harness eval --method vggt8" in done.stdout
    entry = listed("vggt")
    assert entry["state"] == "present"
    assert entry["parts"][0]["note"] == f"runs in {foreign_python}"
    assert run("verify", "vggt").exit_code == 0
    file = VGGT.find().weights
    content = bytearray(file.read_bytes())
    content[-1] ^= 1
    file.write_bytes(content)
    damaged = run("verify", "vggt")
    assert damaged.exit_code == 1
    assert "CORRUPT" in damaged.stdout


def test_options_that_mean_nothing_here_are_refused(parts_folder, weights):
    refused = run("import", "vggt", weights, "--name", "mine")
    assert isinstance(refused.exception, HarnessError)
    assert "does not take --name" in str(refused.exception)

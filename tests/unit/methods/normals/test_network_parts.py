"""``harness parts`` with networks that estimate normals: what it prints, and its exit codes."""

from __future__ import annotations

import json
import sys

import pytest

from harness.cli.main import main
from methods.normals import installed


@pytest.fixture
def harness(monkeypatch, capsys, places):
    """``harness("list", "--json")``: exit code, standard output, standard error."""
    monkeypatch.setenv("HARNESS_PARTS", str(places / "parts"))

    def run(*arguments: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["harness", "parts", *arguments])
        with pytest.raises(SystemExit) as ended:
            main()
        return (int(ended.value.code or 0), *capsys.readouterr())

    return run


def networks(told: str) -> dict[str, object]:
    (kind,) = [kind for kind in json.loads(told) if kind["name"] == "normals-onnx"]
    return kind


def test_import_list_verify(harness, places, save_network):
    code, told, _ = harness("list")
    assert (code, "harness parts import normals-onnx FILE.onnx" in told) == (0, True)
    path = save_network(places / "mirror.onnx")
    code, told, _ = harness("import", "normals-onnx", str(path))
    assert code == 0
    assert "--set surface.normals=onnx --set surface.normals_model=mirror" in told
    code, told, _ = harness("list")
    assert "mirror, " in told
    for text in ("0.0 MiB", "Apache-2.0", "avatars-train t00001", "imported"):
        assert text in told
    code, told, _ = harness("list", "--json")
    assert networks(told)["state"] == "present"
    (entry,) = networks(told)["parts"]
    assert entry["sha256"] == installed.find("mirror", installed.imported_place()).sha256
    assert (entry["place"], entry["bytes"]) == ("imported", path.stat().st_size)
    assert harness("verify")[0] == 0
    (places / "own" / "mirror.onnx").write_bytes(b"x")
    code, told, _ = harness("verify", "normals-onnx/mirror")
    assert (code, told.startswith("CORRUPT")) == (1, True)
    (places / "own" / "mirror.onnx").unlink()
    code, told, _ = harness("verify", "normals-onnx", "--json")
    assert (code, json.loads(told)[0]["state"]) == (1, "missing")


def test_names_and_bad_files(harness, places, save_network):
    (places / "text.onnx").write_text("no")
    code, _, told = harness("import", "normals-onnx", str(places / "text.onnx"))
    assert (code, "not a network that can be run" in told) == (3, True)
    path, other = (save_network(places / f"{n}.onnx", training_set=n) for n in ("a", "b"))
    named = ("--name", "mine")
    code, told, _ = harness("import", "normals-onnx", str(path), *named, "--json")
    assert (code, json.loads(told)["name"]) == (0, "mine")
    assert harness("import", "normals-onnx", str(other), *named)[0] == 2
    assert harness("import", "normals-onnx", str(other), *named, "--replace")[0] == 0
    assert harness("verify", "normals-onnx/yours")[0] == 2

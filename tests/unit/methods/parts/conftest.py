"""A kind of part whose conversion is a copy in capital letters, and a folder for the user's own."""

from __future__ import annotations

import sys
import types
from pathlib import Path

import pytest

from harness.core.errors import DataError
from harness.core.process.registry import Registry
from methods.parts import kind as catalog
from methods.parts.kind import About, ImportOptions
from methods.parts.store import ConvertedKind, Examined


def examine(file: Path, options: ImportOptions) -> Examined:
    text = file.read_text()
    if not text.startswith("toy"):
        raise DataError(f"{file} is no toy", expected="text that begins with 'toy'", got=text[:9])

    def write(folder: Path) -> None:
        (folder / "upper.txt").write_text(text.upper())
        (folder / "length.txt").write_text(str(len(text)))

    details = {"python": str(options.python)} if options.python else {}
    return Examined("toy", f"toy of {len(text)} letters", write, details)


ABOUT = About(
    name="toy",
    role="plaything",
    purpose="letters in capitals",
    licence="CC0-1.0",
    source="Write it yourself",
    files=("toy.txt", "toy.text"),
    takes=("name", "python"),
)


@pytest.fixture
def toy(parts, monkeypatch) -> ConvertedKind:
    """The kind, as the only one in the catalogue."""
    kind = ConvertedKind(ABOUT, "toy_kind:examine", "harness eval --toy {name}")
    module = types.SimpleNamespace(TOY=kind, examine=examine)
    monkeypatch.setitem(sys.modules, "toy_kind", module)
    monkeypatch.setattr(catalog, "KINDS", Registry("kind of part", {"toy": "toy_kind:TOY"}))
    return kind


@pytest.fixture
def toy_file(tmp_path) -> Path:
    path = tmp_path / "toy.txt"
    path.write_text("toy train")
    return path

"""Croissant metadata: what the specification asks for, and that a loader reads it."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.core.errors import HarnessError
from harness.data.avatars import AVATARS_VERSION
from harness.data.avatars.writer import TexturedMesh, write_avatar
from harness.data.croissant import CROISSANT_FILE, Publication, croissant_document
from harness.data.manifest import load_manifest

ROOT = Path(__file__).parents[3]
MANIFEST = load_manifest(ROOT / "data_manifest.yaml")
PUBLICATION = Publication("https://example.org/avatars", date(2026, 11, 22))
#: What version 1.0 of the specification requires, by type.
REQUIRED = {
    "sc:Dataset": {
        "@context", "@type", "conformsTo", "creator", "datePublished", "description", "license",
        "name", "url", "version", "distribution", "recordSet",
    },
    "cr:FileSet": {"@id", "name", "encodingFormat", "includes"},
    "cr:RecordSet": {"@id", "name", "field"},
    "cr:Field": {"@id", "name", "dataType"},
}  # fmt: skip


def document(name: str = "avatars") -> dict[str, Any]:
    return croissant_document(name, MANIFEST.datasets[name], PUBLICATION)


def nodes(value: Any) -> Iterator[dict[str, Any]]:
    """Every object with a type."""
    if isinstance(value, dict):
        if "@type" in value:
            yield value
        for key, each in value.items():
            if key != "@context":
                yield from nodes(each)
    elif isinstance(value, list):
        for each in value:
            yield from nodes(each)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A dataset with the files of one tiny avatar, and its description."""
    mesh = TexturedMesh(
        vertices=np.eye(3), faces=np.array([[0, 1, 2]]), uv=np.zeros((3, 2)),
        uv_faces=np.array([[0, 1, 2]]), face_labels=np.zeros(1, dtype=int), label_names=("skin",),
        texture=np.zeros((4, 4, 3), dtype=np.uint8),
    )  # fmt: skip
    measured = {"vertices": 3, "faces": 1, "height_m": 1.75, "watertight": False}
    record = {"version": AVATARS_VERSION, "measured": measured}
    write_avatar(tmp_path / "model" / "a01", "a01", mesh, {"vertices": np.eye(3)}, record)
    (tmp_path / CROISSANT_FILE).write_text(json.dumps(document()))
    return tmp_path


def test_everything_that_is_required_is_there() -> None:
    found = list(nodes(document()))

    assert {node["@type"] for node in found} >= set(REQUIRED)
    for node in found:
        assert REQUIRED.get(node["@type"], set()) - set(node) == set()
        assert all(value not in ("", None, []) for value in node.values())


def test_every_reference_names_something_that_is_described() -> None:
    found = list(nodes(document()))
    ids = [node["@id"] for node in found if "@id" in node]
    named = re.findall(r'"(?:fileSet|key)": \{"@id": "([^"]+)"', json.dumps(document()))

    assert len(ids) == len(set(ids))
    assert named
    assert set(named) <= set(ids)


def test_every_short_name_of_a_term_is_explained() -> None:
    made = document()
    used = {key for node in nodes(made) for key in node if not key.startswith("@")}
    schema_org = {
        "citeAs", "creator", "datePublished", "description", "distribution", "encodingFormat",
        "keywords", "license", "name", "url", "version",
    }  # fmt: skip

    known = set(made["@context"]) | schema_org
    assert {key for key in used if ":" not in key} - known == set()
    assert {key.partition(":")[0] for key in used if ":" in key} <= set(made["@context"])


def test_the_subjects_and_their_classes_are_those_of_the_manifest() -> None:
    subjects = next(one for one in document()["recordSet"] if one["@id"] == "subjects")

    assert [row["subjects/id"] for row in subjects["data"]] == list(
        MANIFEST.datasets["avatars"].subjects
    )
    assert subjects["data"][0]["subjects/clothing"] == "t-shirt and straight trousers"
    assert "bumps of 0.5 mm" in document("avatars-scanned")["description"]


def test_every_file_of_an_avatar_is_in_exactly_one_set(folder: Path) -> None:
    patterns = [one["includes"] for one in document()["distribution"]]
    files = [path for path in folder.glob("model/*/*") if path.is_file()]

    assert len(files) == len(patterns) == 7
    for path in files:
        assert sum(path in set(folder.glob(pattern)) for pattern in patterns) == 1


@pytest.mark.parametrize("name", ["thuman21"])
def test_scans_of_others_are_not_described(name: str) -> None:
    with pytest.raises(HarnessError, match="does not describe them"):
        document(name)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of the loader's own libraries
def test_the_loader_of_the_specification_reads_it(folder: Path) -> None:
    mlcroissant = pytest.importorskip("mlcroissant")
    dataset = mlcroissant.Dataset(jsonld=str(folder / CROISSANT_FILE))

    issues = dataset.metadata.ctx.issues
    assert (set(issues.errors), set(issues.warnings)) == (set(), set())
    assert len(list(dataset.records("subjects"))) == 20
    (record,) = dataset.records("measured")
    assert record["measured/subject"] in ("a01", b"a01")
    assert record["measured/height_m"] == pytest.approx(1.75)
    assert record["measured/watertight"] is False

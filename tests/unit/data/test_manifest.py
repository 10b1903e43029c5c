"""The manifest: what ships is valid, and every mistake names its line and the nearest key."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from harness.core.errors import DataError, HarnessError, MissingPart
from harness.core.files.names import subject_range
from harness.data.field_sets import field_set
from harness.data.manifest import load_manifest

SHIPPED = Path(__file__).resolve().parents[3] / "data_manifest.yaml"
PAPER_IDS = (
    "0004", "0006", "0007", "0019", "0021", "0023", "0053", "0054", "0055", "0057",
    "0070", "0071", "0072", "0074", "0081", "0083", "0120", "0170", "0181", "0445",
)  # fmt: skip


def line_of(text: str, part: str) -> int:
    return text[: text.index(part)].count("\n") + 1


def test_the_shipped_manifest_is_the_paper():
    manifest = load_manifest(SHIPPED)
    assert manifest.datasets["thuman21"].subjects == PAPER_IDS
    paper, quick = manifest.recipe("paper8"), manifest.recipe("quick8")
    assert (paper.width, paper.height, paper.rig.views, paper.rig.radius_m) == (1080, 1920, 8, 3.0)
    assert paper.cameras()[0].K[0, 0] == pytest.approx(2666.667, abs=1e-3)
    assert quick.rig == paper.rig
    assert 4 * quick.width * quick.height <= paper.width * paper.height
    example = manifest.recipe("published8")
    assert (example.width, example.height, example.rig.first_yaw_deg) == (1920, 1080, 90.0)
    units = manifest.datasets["thuman21-units"]
    assert (units.scale, units.facing, units.subjects) == ("units", "+z", PAPER_IDS)
    assert (
        manifest.splits["thuman21-units-published"].subjects
        == manifest.splits["thuman21-published"].subjects
    )
    ortho = manifest.recipe("quick8-ortho")
    assert ortho.cameras()[0].K[0, 0] == pytest.approx(quick.cameras()[0].K[0, 0] / 3.0)
    # ICON: 1.8 / height in units of 1.024 m, so that a person is 1.758 of 2 high.
    icon = manifest.recipe("icon512").rig.placed(np.array([[0, -0.85, 0], [0, 0.85, 0]]), None)
    assert 2 * 1.7 / icon.span_m == pytest.approx(1.8 / 1.024)
    published = manifest.protocol("mexecon")
    assert published.samples == 30_000
    assert published.chamfer == "sample-to-sample"
    assert manifest.protocol("exact").chamfer == "point-to-surface"


@pytest.mark.parametrize(
    ("before", "after", "place", "hint"),
    [
        ("samples: 30000", "sampels: 30000", "protocols.mexecon.sampels", "'samples'"),
        ("width: 1080", "widht: 1080", "recipes.paper8.widht", "'width'"),
        ("scale: fit ", "skale: fit ", "datasets.thuman21.skale", "'scale'"),
        ("splits:", "split:", "split", "'splits'"),
        ("radius_m:", "radius:", "rigs.ring8.radius", "'radius_m'"),
        ("rig: ring8, width: 1080", "rig: ring9, width: 1080", "recipes.paper8.rig", "'ring8'"),
        ("scale: fit ", "scale: inches ", "datasets.thuman21.scale", "height=<metres>"),
        ("subjects: [a01, a02]", "subjects: [a01, b02]", "splits.avatars-tiny", "'a02'"),
        ("version: 2, sam", "version: one, sam", "protocols.mexecon.version", "integer"),
        (
            *("normal_weights: permuted", "normal_weights: wrong"),
            *("protocols.mexecon.normal_weights", "'barycentric' or 'permuted'"),
        ),
        ("  paper8:", "  ../../victim:", "recipes.../../victim", "'../../victim' is no name"),
        ("  thuman21:", "  thuman/21:", "datasets.thuman/21", "'thuman/21' is no name"),
        ("avatars-tiny:", ".hidden:", "splits..hidden", "'.hidden' is no name"),
        ("subjects: t00001..t02000", "subjects: ../a", "datasets.avatars-train", "'../a' is no"),
        ("subjects: t00001..t02000", "subjects: t00001..t99999", "datasets.avatars-train", "name"),
        ("width: 1080", "width: 1000000", "recipes.paper8.width", "not 1 to 8192"),
        ("views: 8", "views: 0", "rigs.ring8.views", "not 1 to 360"),
        ("samples: 30000", "samples: 0", "protocols.mexecon.samples", "not 1 to"),
    ],
)  # fmt: skip
def test_a_mistake_names_file_line_key_and_the_nearest(tmp_path, before, after, place, hint):
    text = SHIPPED.read_text().replace(before, after, 1)
    assert after in text
    path = tmp_path / "m.yaml"
    path.write_text(text)
    with pytest.raises(DataError) as caught:
        load_manifest(path)
    message = str(caught.value)
    assert f"{path}, line {line_of(text, after)}, {place}" in message
    assert hint in message


def test_the_shipped_protocols_say_how_normals_are_compared():
    manifest = load_manifest(SHIPPED)
    mexecon, exact = manifest.protocol("mexecon"), manifest.protocol("exact")
    assert (mexecon.normal_weights, mexecon.texture_seams) == ("permuted", "split")
    assert (exact.normal_weights, exact.texture_seams) == ("barycentric", "smooth")
    assert (mexecon.cancelled_normals, exact.cancelled_normals) == ("left-out", "face")
    declared = yaml.safe_load(SHIPPED.read_text())["protocols"]
    for entry in declared.values():
        assert {"normal_weights", "texture_seams", "cancelled_normals"} <= entry.keys()


def test_not_yaml_missing_file_and_repeated_key(tmp_path):
    path = tmp_path / "m.yaml"
    with pytest.raises(DataError, match="no manifest at"):
        load_manifest(path)
    path.write_text("datasets: [")
    with pytest.raises(DataError, match="is not YAML"):
        load_manifest(path)
    text = SHIPPED.read_text()
    path.write_text(text + "\nrigs: {}\n")
    with pytest.raises(DataError, match=r"line \d+: key 'rigs' stands twice"):
        load_manifest(path)


ALIASES = "\n".join(
    ["a0: &a0 [x, x]", *(f"a{n}: &a{n} [*a{n - 1}, *a{n - 1}]" for n in range(1, 40))]
)


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (ALIASES, r"line 2: '\*a0' is an alias"),
        (r'title: "\e[2J gone"', "line 1: a value with signs that cannot be shown"),
        ("[" * 30 + "]" * 30, "nested more than 20 deep"),
        ("{a: " * 3000 + "}" * 3000, "nested more than 20 deep"),
        (f"schema: {'9' * 4000}", "schema: "),
        (f"schema: {'9' * 5000}", "line 1: a value of 5000 letters"),
        ("schema: 1" + ":59" * 100_000, "a value of 300001 letters"),
        ("schema: 2026-99-99", "a value that cannot be read"),
        ("x: " + "a" * 5_000_000, "too large for a manifest"),
        ("schema: !!python/object/apply:os.system [true]", "is not YAML"),
        ("{[a]: 1}", "is not YAML"),
        ("", "is no manifest .*got nothing"),
        ("- 1", "is no manifest .*got list"),
    ],
)
def test_what_is_made_to_do_harm_is_one_sentence(tmp_path, content, sentence):
    path = tmp_path / "m.yaml"
    path.write_text(content)
    with pytest.raises(DataError, match=sentence) as caught:
        load_manifest(path)
    assert str(caught.value).isprintable()


def test_a_manifest_that_is_no_text(tmp_path):
    path = tmp_path / "m.yaml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(DataError, match="is not text in UTF-8"):
        load_manifest(path)


def test_names_are_selected_with_did_you_mean():
    manifest = load_manifest(SHIPPED)
    assert manifest.select("avatars-tiny")[0] == "avatars"
    assert manifest.select("thuman21", ("0021", "0004"))[2] == ("0021", "0004")
    for call, nearest in (
        (lambda: manifest.select("avatar"), "avatars"),
        (lambda: manifest.select("thuman21", ("00211",)), "0021"),
        (lambda: manifest.recipe("paper"), "paper8"),
        (lambda: manifest.protocol("exac"), "exact"),
    ):
        with pytest.raises(HarnessError, match=f"Did you mean '{nearest}'"):
            call()


def test_the_users_folder_comes_from_the_environment(monkeypatch, tmp_path):
    manifest = load_manifest(SHIPPED)
    monkeypatch.delenv("THUMAN21_ROOT", raising=False)
    with pytest.raises(MissingPart, match="set THUMAN21_ROOT"):
        manifest.root("thuman21", tmp_path)
    monkeypatch.setenv("THUMAN21_ROOT", str(tmp_path / "scans"))
    assert manifest.root("thuman21", Path("workspace")) == tmp_path / "scans"
    assert manifest.root("avatars", tmp_path) == tmp_path / "data/avatars"


def test_training_subjects_are_a_range_apart_from_the_test_subjects():
    manifest = load_manifest(SHIPPED)
    training = manifest.datasets["avatars-train"].subjects
    assert training[:2] == ("t00001", "t00002")
    assert len(training) == 2000
    assert not set(training) & set(manifest.datasets["avatars"].subjects)


@pytest.mark.parametrize("text", ["a01", "a1..b2", "a01..a2", "..", "a03..a01", "a00001..a99999"])
def test_what_is_no_range_gives_no_subjects(text):
    assert subject_range(text) == ()


def test_people_are_told_apart_from_subjects():
    """The twenty of THuman 2.1 were in 2.0, and scanner's bumps make no other person."""
    manifest = load_manifest(SHIPPED)
    assert manifest.datasets["avatars-scanned"].person_of("a03") == "avatars/a03"
    assert manifest.datasets["avatars"].person_of("a03") == ""
    assert manifest.datasets["thuman21"].person_of("0445") == "thuman20/0445"
    people = {
        "4d-dress": ("00122-Inner-Take2", "4d-dress/00122"),
        "x-humans": ("00016-test-Take12", "x-humans/00016"),
        "puzzleioi": ("alice-outfit9", "puzzleioi/alice"),
        "cape": ("00032-shortlong-hips-000090", "cape/00032"),
        "thuman20": ("0525", "thuman20/0525"),
        "thuman21": ("0526", ""),
        "2k2k": ("00003", ""),
    }
    for name, (subject, person) in people.items():
        assert field_set(name).person_of(subject) == person


def test_noise_is_not_added_to_other_peoples_scans(tmp_path):
    path = tmp_path / "m.yaml"
    text = SHIPPED.read_text().replace("kind: thuman ", "scan_noise_mm: 1.0\n    kind: thuman ", 1)
    path.write_text(text)
    with pytest.raises(DataError, match="thuman21.*kind 'generated' only"):
        load_manifest(path)

"""``harness data add``: each layout becomes a dataset that loads, and what cannot be is refused."""

from __future__ import annotations

import json
import re
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from typer.testing import CliRunner

from harness.cli.main import app
from harness.core.artifacts import Capture
from harness.core.errors import DataError, HarnessError
from harness.core.mesh import Mesh
from harness.core.settings import MetricProtocol
from harness.data.manifest import Dataset, load_manifest
from harness.data.subjects import load_subject
from harness.files.obj import write_obj
from harness.run.add_dataset import write_entry
from harness.run.scan_rules import UNSTATED_LICENCE
from harness.run.sources import _manifest
from harness.run.workspace import Workspace
from metrics.score import score
from tests.box_person import box_person, put_glb, put_obj, put_ply
from tests.stand_in.thuman_tree import FITS, SCANS, fit_bytes, write_subject

MANIFEST = """\
# Ours.
schema: 1
datasets:
  toy:   # the first
    title: Toy
    kind: thuman
    licence: CC0-1.0
    root: scans
    scale: metres
    facing: "+z"
    subjects: [t1]

# Parts of it.
splits:
  toy-one: {dataset: toy, subjects: [t1]}
rigs:
  ring8: {views: 8, radius_m: 3.0, lens_mm: 50.0, sensor_mm: 36.0}
recipes:
  tiny: {rig: ring8, width: 108, height: 192, renderer: raycast, minimum_mask_iou: 0.9}
protocols:
  exact: {version: 1, samples: 2000, sampling: stratified, chamfer: point-to-surface}
"""
GIVEN = ("--up", "+y", "--scale", "metres", "--facing", "+z")


@pytest.fixture
def place(tmp_path, monkeypatch) -> Path:
    """A folder with a manifest, which is the workspace and the current folder."""
    (tmp_path / "data_manifest.yaml").write_text(MANIFEST)
    monkeypatch.chdir(tmp_path)
    for name in ("HARNESS_WORKSPACE", "HARNESS_MANIFEST"):
        monkeypatch.delenv(name, raising=False)
    return tmp_path


def harness(*words: object) -> tuple[int, str]:
    """Exit code and all output, in one line; as a new process, it reads the manifest again."""
    _manifest.cache_clear()
    result = CliRunner().invoke(app, [str(word) for word in words])
    error = result.exception
    if isinstance(error, HarnessError):
        # The program itself prints it and ends with its code.
        return error.exit_code, " ".join(f"{result.output} {error}".split())
    assert error is None or isinstance(error, SystemExit), error
    return result.exit_code, " ".join(result.output.split())


def added(place: Path, name: str, subject: str) -> tuple[Dataset, Mesh]:
    """A dataset of the manifest and one of its scans, as everything else reads it."""
    manifest = load_manifest(place / "data_manifest.yaml")
    dataset = manifest.datasets[name]
    return dataset, load_subject(name, dataset, manifest.root(name, place), subject)[1]


def test_mesh_files_become_a_dataset(place):
    put_ply(place / "in" / "a.ply", box_person(1.7))
    put_glb(place / "in" / "b.glb", box_person(1.6))
    code, out = harness("data", "add", "mine", "in", *GIVEN, "--licence", "CC0-1.0")
    assert code == 0, out
    assert "ok a: 1.70 m high, 72 faces, texture" in out
    assert "Next: harness data check mine harness eval --method hull8 --dataset mine" in out
    dataset, mesh = added(place, "mine", "b")
    assert (dataset.kind, dataset.licence, dataset.subjects) == ("scans", "CC0-1.0", ("a", "b"))
    assert dataset.root == "data/mine"
    assert mesh.extent[1] == pytest.approx(1.6, abs=1e-5)
    code, out = harness("data", "check", "mine")
    assert (code, "All 6 files of 2 subjects are there" in out) == (0, True)
    assert "2 of 2 subjects" in harness("data", "list")[1]
    # Comments and order of what was there.
    text = (place / "data_manifest.yaml").read_text()
    assert text.startswith(MANIFEST[: MANIFEST.index("\n# Parts")])
    assert text.endswith(MANIFEST[MANIFEST.index("\n# Parts") :])


def test_a_missing_picture_is_found_by_the_check(place):
    put_ply(place / "in" / "a.ply", box_person())
    assert harness("data", "add", "mine", "in", *GIVEN)[0] == 0
    folder = place / "data" / "mine" / "model" / "a"
    (folder / "material0.png").unlink()
    code, out = harness("data", "check", "mine")
    assert code == 1
    assert "material0.png" in out
    (folder / "material0.mtl").unlink()
    assert "MISSING model/a/material0.mtl" in harness("data", "check", "mine")[1]
    (folder / "a.obj").unlink()
    assert "MISSING model/a/a.obj" in harness("data", "check", "mine")[1]
    # The next run mends what is not whole.
    assert harness("data", "add", "mine", "in", *GIVEN, "--replace")[0] == 0
    assert harness("data", "check", "mine")[0] == 0


def test_folders_with_other_axes_units_and_yaw(place):
    person = box_person(1.7)
    # In millimetres, +Z up; as a file's own frame has it, the person looks along +X.
    turn = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    scan = replace(person, vertices=person.vertices @ turn.T * 1000.0)
    for name in ("a", "b"):
        put_obj(place / "in" / name / "scan.obj", scan)
    words = ("data", "add", "mine", "in", "--up", "+z")
    code, out = harness(*words, "--scale", "mm", "--facing", "+x")
    assert code == 0, out
    dataset, mesh = added(place, "mine", "b")
    assert dataset.facing == {"a": 90.0, "b": 90.0}
    centred = person.vertices - person.bounds.mean(axis=0)
    np.testing.assert_allclose(mesh.vertices, centred, atol=2e-6)
    code, out = harness(*words, "--scale", "height=1.5", "--facing", "a=90,b=-90", "--replace")
    assert code == 0, out
    dataset, mesh = added(place, "mine", "b")
    assert dataset.facing == {"a": 90.0, "b": -90.0}
    np.testing.assert_allclose(mesh.vertices, centred * (1.5 / 1.7) * (-1, 1, -1), atol=2e-6)


def test_a_tree_is_read_where_it_lies_or_copied(place):
    put_obj(place / "in" / "model" / "0001" / "0001.obj", box_person())
    before = sorted(place.rglob("*.obj"))
    assert harness("data", "add", "mine", "in", "--scale", "metres", "--facing", "+z")[0] == 0
    dataset, _ = added(place, "mine", "0001")
    assert (dataset.kind, dataset.root, sorted(place.rglob("*.obj"))) == ("scans", "in", before)
    assert harness("data", "check", "mine")[0] == 0
    for words in (("--copy",), ("--up", "+z"), ("--scale", "cm"), ("--grey",), ("--drop-hidden",)):
        code, out = harness("data", "add", "two", "in", *GIVEN, *words, "--replace")
        what = "hidden layers are left out" if words == ("--drop-hidden",) else " ".join(words)
        assert f"converted: {what}" in out, out
        # A person of 1.7 cm is none.
        assert code == int(words[-1] == "cm")
    assert added(place, "two", "0001")[0].root == "data/two"


@pytest.mark.parametrize(
    ("mtl", "names", "reason"),
    [
        ("newmtl a\nmap_Kd material0.png\nnewmtl b\nKd 0 0 1\n", ("a", "b"),
         "but material0.png, the plain colour of b"),
        ("newmtl a\nmap_Kd material0.png\nnewmtl b\nmap_Kd other.png\n", ("a", "b"),
         "but material0.png, other.png"),
        ("newmtl a\nmap_Kd -s 2 2 material0.png\n", ("a",), "but material0.png by -s or -o"),
        ("newmtl a\nmap_Kd material0.png\n", ("a", "ghost"), "ghost, which is not defined"),
        ("newmtl a\nmap_Kd cmyk.jpg\n", ("a",), "a picture cmyk.jpg of another kind (mode CMYK)"),
        ("newmtl a\nmap_Kd ../other.png\n", ("a",), "other.png of another kind (mode RGB), or"),
        ("newmtl a\nmap_Kd material0.tga\n", ("a",), "a picture material0.tga of another kind"),
        ("newmtl a\nmap_Kd material0.png\n", ("a", "a"), ""),
        ("newmtl a\nmap_Kd material0.png\n", (), ""),
    ],
)  # fmt: skip
def test_a_tree_of_other_scans_than_one_picture_is_converted_and_says_so(place, mtl, names, reason):
    folder = place / "in" / "0001"
    put_obj(folder / "0001.obj", box_person())
    (folder / "material0.mtl").write_text(mtl)
    picture = Image.open(folder / "material0.png")
    for path in ("material0.tga", "other.png", "../other.png"):
        picture.save(folder / path)
    picture.convert("CMYK").save(folder / "cmyk.jpg")
    rows = (folder / "0001.obj").read_text().replace("usemtl material0\n", "").splitlines()
    first = next(k for k, row in enumerate(rows) if row.startswith("f "))
    for number, name in enumerate(names):
        rows.insert(first + 11 * number, f"usemtl {name}")
    (folder / "0001.obj").write_text("\n".join(rows) + "\n")
    code, out = harness("data", "add", "mine", "in", *GIVEN)
    assert code == 0, out
    assert added(place, "mine", "0001")[0].root == ("data/mine" if reason else "in")
    if reason:
        assert re.search(f"converted: 0001 .*{re.escape(reason)}", out), out
    else:
        assert "read where they lie" in out
    # A manifest that was written by hand is not more lenient.
    entry = (
        MANIFEST.replace("kind: thuman", "kind: scans")
        .replace("root: scans", "root: in")
        .replace("[t1]", '["0001"]')
    )
    (place / "own.yaml").write_text(entry)
    code, out = harness("data", "check", "toy", "--manifest", "own.yaml")
    if "," in reason and "kind" not in reason:
        assert (code, "'harness data add' makes one picture of several" in out) == (1, True), out


def test_a_tree_with_materials_in_another_folder_is_converted(place):
    put_obj(place / "in" / "a" / "a.obj", box_person())
    (place / "in" / "materials").mkdir()
    (place / "in" / "a" / "material0.mtl").rename(place / "in" / "materials" / "material0.mtl")
    path = place / "in" / "a" / "a.obj"
    path.write_text(path.read_text().replace("mtllib ", "mtllib ../materials/"))
    code, out = harness("data", "add", "mine", "in", *GIVEN)
    assert (code, "its material file lies elsewhere" in out) == (0, True), out
    path.write_text(path.read_text().replace("mtllib ", "mtllib ../"))
    (place / "in" / "materials").rename(place / "materials")
    code, out = harness("data", "add", "mine", "in", *GIVEN, "--replace")
    assert (code, "outside the folders that were given" in out) == (1, True), out


def test_a_picture_that_is_missing_is_no_reason_to_convert_a_tree(place):
    for name in ("a", "b"):
        put_obj(place / "in" / name / f"{name}.obj", box_person())
    (place / "in" / "b" / "material0.png").unlink()
    code, out = harness("data", "add", "mine", "in", *GIVEN, "--skip-bad")
    assert (code, "read where they lie" in out, "FAILED b: the texture of" in out) == (
        0,
        True,
        True,
    )


def test_a_material_that_is_not_defined_is_told_where_the_only_one_is_taken(place):
    put_obj(place / "in" / "a" / "a.obj", box_person())
    path = place / "in" / "a" / "a.obj"
    path.write_text(path.read_text().replace("usemtl material0", "usemtl ghost"))
    code, out = harness("data", "add", "mine", "in", *GIVEN)
    assert (code, "read where they lie" in out) == (0, True), out
    assert "warning: no material file defines 'ghost'" in out


def test_a_scan_without_coordinates_is_taken_as_grey_in_a_tree(place):
    put_obj(place / "in" / "a" / "a.obj", box_person().geometry())
    path = place / "in" / "a" / "a.obj"
    path.write_text("mtllib material0.mtl\nusemtl material0\n" + path.read_text())
    code, out = harness("data", "add", "mine", "in", *GIVEN)
    assert (code, "(got it names a picture" in out, "with --grey" in out) == (1, True, True)
    assert harness("data", "add", "mine", "in", *GIVEN, "--grey")[0] == 0


def ball(radius: float) -> trimesh.Trimesh:
    return trimesh.creation.icosphere(3, radius)


def test_a_body_under_its_clothes_is_told_and_left_out_of_the_truth(place):
    """A ball inside a ball: all of the inner one is hidden, and the outer one is then the truth."""
    body, clothes = ball(0.6), ball(0.9)
    layers = trimesh.util.concatenate([body, clothes])
    colours = np.full((len(layers.vertices), 4), (200, 90, 30, 255), np.uint8)
    (place / "in" / "a").mkdir(parents=True)
    trimesh.Trimesh(layers.vertices, layers.faces, vertex_colors=colours, process=False).export(
        place / "in" / "a" / "scan.ply"
    )
    code, out = harness("data", "add", "both", "in", *GIVEN)
    share = round(100 * body.area / (body.area + clothes.area))
    assert (code, f", {share}% hidden" in out) == (0, True), out
    assert f"warning: no ray from outside reaches {share}% of its area" in out
    assert f"ok model/a/a.obj {share}% hidden" in harness("data", "check", "both")[1]
    code, out = harness("data", "add", "outer", "in", *GIVEN, "--drop-hidden")
    assert (code, ", 0% hidden" in out, "warning" in out) == (0, True, False), out
    outside = Mesh(clothes.vertices, clothes.faces)
    exact = MetricProtocol("exact", 1, 5000, "stratified", "point-to-surface")
    completeness = {}
    for name in ("both", "outer"):
        dataset, truth = added(place, name, "a")
        assert dataset.hidden == ("dropped" if name == "outer" else "kept")
        completeness[name] = score(outside, truth, exact).metrics["p2s_completeness"].value
    # The balls are polyhedra, whose files have six digits.
    assert completeness["outer"] < 0.01
    hidden = body.area / (body.area + clothes.area)
    assert completeness["both"] == pytest.approx(hidden * 300.0, rel=0.02)
    assert len(truth.faces) == len(clothes.faces)
    # What it wrote is added again as what it is, in place and copied.
    for name, words in (("again", ()), ("copied", ("--copy",))):
        source = "data/outer/model"
        code, out = harness(
            "data", "add", name, source, "--scale", "metres", "--facing", "+z", *words
        )
        assert (code, added(place, name, "a")[0].hidden) == (0, "dropped"), out
    # The records say so, and an entry that says so of other scans is refused.
    manifest = load_manifest(place / "data_manifest.yaml")
    dataset, root = manifest.datasets["outer"], manifest.root("outer", place)
    assert load_subject("outer", dataset, root, "a")[0].identity()["hidden_rule"] == "dropped"
    kept = manifest.datasets["both"]
    root = manifest.root("both", place)
    assert "hidden_rule" not in load_subject("both", kept, root, "a")[0].identity()
    with pytest.raises(DataError, match="hidden layers .* were not left out"):
        load_subject("both", kept.model_copy(update={"hidden": "dropped"}), root, "a")


@pytest.mark.parametrize("kind", ["files", "tree"])
def test_a_speck_above_the_head_does_not_count_for_the_height(place, kind):
    person = box_person(1.7)
    speck = np.array([[0.0, 2.4, 0.0], [0.003, 2.4, 0.0], [0.0, 2.4, 0.003]])
    corners = np.arange(3)[None] + len(person.vertices)
    mesh = Mesh(
        np.concatenate([person.vertices, speck]),
        np.concatenate([person.faces, corners]),
        uv=np.concatenate([person.uv, np.full((3, 2), 0.5)]),
        face_uv=np.concatenate([person.face_uv, corners]),
    )
    put_obj(place / "in" / ("a.obj" if kind == "files" else "a/a.obj"), mesh)
    words = ("--up", "+y", "--scale", "height=1.75", "--facing", "+z")
    code, out = harness("data", "add", "mine", "in", *words)
    assert code == 0, out
    assert "ok a: 1.75 m high" in out
    assert "warning: loose specks lie beyond the person" in out
    assert out.count("warning") == 1
    _, found = added(place, "mine", "a")
    assert np.ptp(found.vertices[: len(person.vertices), 1]) == pytest.approx(1.75, abs=1e-5)


def test_a_tree_with_fits_needs_no_rules(place):
    fit = fit_bytes(0.5, np.zeros(3), global_orient=np.array([0.0, np.pi / 2, 0.0]))
    write_subject(place / "TH", "0004", box_person(0.85), None, fit)
    code, out = harness("data", "add", "mine", place / "TH" / SCANS)
    assert code == 0, out
    dataset, mesh = added(place, "mine", "0004")
    assert (dataset.kind, dataset.scale, dataset.facing) == ("thuman", "fit", "fit")
    assert mesh.extent[1] == pytest.approx(1.7, abs=1e-5)
    code, out = harness("data", "add", "two", place / "TH" / FITS / "smplx")
    assert code == 3
    assert "none of the layouts" in out


def test_no_rule_is_guessed(place):
    put_ply(place / "in" / "a.ply", Mesh(box_person(1740).vertices, box_person().faces))
    code, out = harness("data", "add", "mine", "in")
    assert code == 2
    for part in ("--up and --scale and --facing are missing", "x 1740 x", "mm makes it 1.74 m high",
                 "longest side is along y"):  # fmt: skip
        assert part in out
    code, out = harness("data", "add", "mine", "in", *GIVEN)
    assert code == 1
    assert "FAILED a: subject 'a' is 1740 m high" in out
    assert "Nothing was added: 1 of 1" in out
    assert "mine" not in load_manifest(place / "data_manifest.yaml").datasets


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--scale", "inches"), "--scale inches is no rule"),
        (("--scale", "height=170"), "--scale height=170 is no rule"),
        (("--up", "north"), "--up north is no axis"),
        (("--facing", "left"), "--facing left cannot be read"),
        (("--facing", "a=90,b=0"), "name each subject once.*unknown b"),
        (("--facing", "b=90"), "name each subject once.*none for a"),
        (("--scale", "fit"), "needs SMPL-X fits"),
        (("--scale", "units", "--up", "+z"), "have to be .Y up"),
        (("--subjects", "c"), "no subject 'c'"),
    ],
)
def test_options_of_another_form_are_refused(place, words, message):
    put_ply(place / "in" / "a.ply", box_person())
    code, out = harness("data", "add", "mine", "in", *GIVEN, *words)
    assert code in (2, 3)
    assert re.search(message, out), out


def test_names_that_are_taken_are_refused_before_any_work(place):
    put_ply(place / "in" / "a.ply", box_person())
    for name, message in (
        ("toy", "did not write"),
        ("toy-one", "name of a split"),
        ("my scans", "cannot be the name of a dataset"),
        ("../out", "cannot be the name of a dataset"),
    ):
        code, out = harness("data", "add", name, "in", *GIVEN, "--replace")
        assert (code, message in out) == (2, True), out
    assert not (place / "data").exists()
    assert harness("data", "add", "mine", "in", *GIVEN)[0] == 0
    code, out = harness("data", "add", "mine", "in", *GIVEN)
    assert (code, "already" in out) == (2, True)


def test_subjects_that_fail_are_named_and_left_out_only_if_wanted(place):
    put_ply(place / "in" / "good.ply", box_person())
    put_ply(place / "in" / "torn.ply", box_person())
    content = (place / "in" / "torn.ply").read_bytes()
    (place / "in" / "torn.ply").write_bytes(content[:-40])
    write_obj(place / "in" / "plain.obj", box_person().geometry())
    code, out = harness("data", "add", "mine", "in", *GIVEN)
    assert code == 1
    for part in ("FAILED torn: ", "truncated", "FAILED plain: ", "--grey", "2 of 3 subjects"):
        assert part in out
    assert "mine" not in load_manifest(place / "data_manifest.yaml").datasets
    code, out = harness("data", "add", "mine", "in", *GIVEN, "--skip-bad", "--json")
    assert code == 0, out
    told = json.loads(out)
    assert (told["written"], told["kind"]) == (True, "scans")
    assert {each["subject"]: bool(each["failure"]) for each in told["subjects"]} == {
        "good": False, "plain": True, "torn": True,
    }  # fmt: skip
    assert added(place, "mine", "good")[0].subjects == ("good",)
    assert harness("data", "add", "grey", "in", *GIVEN, "--grey", "--subjects", "plain")[0] == 0


def test_what_was_converted_is_kept(place):
    put_ply(place / "in" / "a.ply", box_person())
    assert harness("data", "add", "mine", "in", *GIVEN)[0] == 0
    mesh = place / "data" / "mine" / "model" / "a" / "a.obj"
    before = mesh.stat().st_mtime_ns
    assert harness("data", "add", "mine", "in", *GIVEN, "--replace")[0] == 0
    assert mesh.stat().st_mtime_ns == before
    (place / "data" / "other" / "model" / "a").mkdir(parents=True)
    code, out = harness("data", "add", "other", "in", *GIVEN)
    assert (code, "was not made by 'harness data add'" in out) == (1, True)
    code, out = harness("data", "add", "in2", "data/mine/model", *GIVEN)
    assert code == 0, out
    code, out = harness("data", "add", "mine", "data", *GIVEN, "--replace", "--copy")
    assert code > 1


def test_a_person_that_lies_is_told(place):
    person = box_person(1.7)
    put_ply(place / "in" / "a.ply", Mesh(person.vertices[:, [1, 2, 0]], person.faces))
    code, out = harness("data", "add", "mine", "in", *GIVEN)
    assert "may lie: is --up right?" in out, (code, out)


def test_a_manifest_that_is_not_there_begins_as_the_installed_one(place):
    put_ply(place / "in" / "a.ply", box_person())
    code, out = harness("data", "add", "mine", "in", *GIVEN, "--manifest", "new.yaml")
    assert code == 0, out
    assert "which is new: a copy of the installed manifest" in out
    datasets = load_manifest(place / "new.yaml").datasets
    assert next(iter(datasets)) == "avatars"
    assert datasets["mine"].licence == UNSTATED_LICENCE
    assert (place / "data_manifest.yaml").read_text() == MANIFEST


def test_two_commands_at_once_lose_no_entry(place):
    names = [f"d{k}" for k in range(6)]
    path = place / "data_manifest.yaml"

    def write(name: str) -> None:
        values = {"title": name, "kind": "scans", "licence": "own", "root": "x", "scale": "metres"}
        write_entry(path, name, Dataset(**values, facing="+z", subjects=("a",)), replace=False)

    threads = [threading.Thread(target=write, args=(name,)) for name in names]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert set(load_manifest(path).datasets) == {"toy", *names}


def test_a_split_that_would_lose_its_subjects_keeps_the_manifest(place):
    for name in ("a", "b"):
        put_ply(place / "in" / f"{name}.ply", box_person())
    assert harness("data", "add", "mine", "in", *GIVEN)[0] == 0
    path = place / "data_manifest.yaml"
    text = path.read_text().replace("rigs:", "  half: {dataset: mine, subjects: [b]}\nrigs:")
    path.write_text(text)
    code, out = harness("data", "add", "mine", "in", *GIVEN, "--replace", "--subjects", "a")
    assert (code, "would not be valid" in out, "unknown subject 'b'" in out) == (3, True, True)
    assert path.read_text() == text
    assert not list(place.glob(".data_manifest.yaml.*.part*"))


@pytest.mark.nightly
def test_scans_are_photographed_scored_and_their_captures_added(place):
    """From a folder of meshes to scores, and from its photos to a dataset of captures."""
    for name, height in (("a", 1.6), ("b", 1.8)):
        put_ply(place / "in" / f"{name}.ply", box_person(height))
    assert harness("data", "add", "mine", "in", *GIVEN)[0] == 0
    common = ("--subjects", "b", "--recipe", "tiny", "--protocol", "exact")
    common += ("--set", "hull.voxel_m=0.03")
    code, out = harness("eval", "--method", "hull8", "--dataset", "mine", "--run", "one", *common)
    assert code == 0, out
    records = [json.loads(path.read_text()) for path in place.glob("runs/one/**/record.json")]
    assert {record["subject"] for record in records} == {"b"}
    assert records[0]["metrics"]["chamfer"]["value"] < 30.0
    code, out = harness("data", "add", "photos", "captures/mine")
    assert code == 0, out
    assert "ok b: 8 photos, as recipe 'tiny'" in out
    found = Capture.load(Workspace(place).capture("photos", "b", "imported"))
    assert (found.dataset, found.subject, found.damage()) == ("photos", "b", "")
    assert harness("data", "check", "photos")[0] == 0
    code, out = harness("data", "add", "p2", "captures/mine", "--scale", "metres")
    assert (code, "take no --scale" in out) == (2, True)
    picture = next((place / "captures" / "mine" / "b" / "tiny" / "rgb").glob("*.png"))
    picture.write_bytes(b"damaged")
    code, out = harness("data", "add", "p2", "captures/mine", "--skip-bad")
    assert (code, "FAILED b: " in out, "damaged" in out) == (1, True, True)

"""``harness data add cape`` and so on: stand-ins in each exact layout, whole and damaged."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

from harness.core.truth import face_regions, true_body
from harness.data.field_sets import field_names, field_set
from harness.data.manifest import load_manifest
from harness.data.subjects import load_subject
from tests.stand_in.field_trees import TREES, dress, put_pickle, renderpeople, x_humans
from tests.unit.run.test_adding import harness, place

__all__ = ["place"]


def test_every_description_has_a_stand_in():
    assert tuple(sorted(TREES)) == field_names()


@pytest.fixture(params=sorted(TREES))
def whole(request, tmp_path):
    return request.param, TREES[request.param](tmp_path / "licensed" / request.param)


def loaded(place, name, subject):
    manifest = load_manifest(place / "data_manifest.yaml")
    return load_subject(name, manifest.datasets[name], manifest.root(name, place), subject)


def test_scans_come_out_in_metres_upright_and_facing_z(place, whole):
    name, tree = whole
    code, out = harness("data", "add", name, tree.root)
    assert code == 0, out
    field, dataset = field_set(name), load_manifest(place / "data_manifest.yaml").datasets[name]
    assert set(dataset.subjects) == set(tree.world)
    assert (dataset.licence, dataset.title, dataset.field) == (field.licence, field.title, name)
    assert f"--dataset {name} --protocol {field.protocol}" in out
    for subject, vertices in tree.world.items():
        scan, mesh = loaded(place, name, subject)
        used = np.unique(mesh.faces)
        np.testing.assert_allclose(mesh.vertices[used], vertices, atol=1.0001e-6)
        assert mesh.texture is not None
        assert not scan.warnings
        if tree.body:
            body = true_body(scan)
            np.testing.assert_allclose(body.vertices, tree.body[subject], atol=2e-6)
            assert body.joint_names == ()
    for split in field.splits:
        assert f"split {split}" in out
    code, out = harness("data", "check", name)
    assert code == 0
    assert f"scan hidden open edges {next(iter(dataset.subjects))}" in out
    count = len(tree.world)
    assert f"{count} scans 8.2% in the middle, 8.2% at most {count} watertight" in out


@pytest.mark.parametrize("name", sorted(TREES))
def test_damaged_trees_are_told(place, name, tmp_path):
    tree = TREES[name](tmp_path / "licensed")
    for kind in ("body", "orientation", "fit"):
        if kind in tree.files:
            tree.files[kind].rename(tmp_path / kind)
            code, out = harness("data", "add", name, tree.root)
            none = f"of {len(tree.world)} have no body"
            said = {"body": none, "orientation": "no orientation at", "fit": "no SMPL-X fit"}[kind]
            assert said in out, out
            assert code == (0 if kind == "body" else 1)
            (tmp_path / kind).rename(tree.files[kind])
            break
    tree.scan.rename(tree.scan.with_name(f"renamed{tree.scan.suffix}"))
    code, out = harness("data", "add", name, tree.root, "--replace")
    assert code != 0
    assert "renamed" in out or "no scan belongs to" in out, out
    other = "customhumans" if name == "cape" else "cape"
    code, out = harness("data", "add", other, tree.root)
    assert code != 0
    assert f"is not laid out as {field_set(other).title}" in out
    alike = {"thuman20": "2k2k or thuman20 or thuman21", "thuman21": "2k2k or thuman20"}
    assert f"It looks like {alike.get(name, name)}" in out, out


def test_another_version_is_told_by_its_ids(place, tmp_path):
    tree = TREES["thuman21"](tmp_path / "licensed")
    for old, new in (("0461", "0700"), ("0524", "0900")):
        for folder in ("model", "smplx"):
            (tree.root / folder / old).rename(tree.root / folder / new)
        (tree.root / f"model/{new}/{old}.obj").rename(tree.root / f"model/{new}/{new}.obj")
    code, out = harness("data", "add", "thuman20", tree.root)
    assert code == 1
    assert "'0700' is no id of THuman 2.0. Version 2.0 has 0000 to 0525; add version 2.1 as" in out


def test_labels_become_regions_and_frames_are_chosen(place, tmp_path):
    tree = dress(tmp_path / "licensed")
    code, out = harness("data", "add", "4d-dress", tree.root)
    assert code == 0, out
    assert "of 1 subjects with several frames the first is taken" in out
    scan, mesh = loaded(place, "4d-dress", "00148-Inner-Take7")
    regions = face_regions(scan, mesh)
    assert regions.names == ("skin", "hair", "shoe", "upper", "lower", "outer")
    # Every box is one region.
    assert regions.of_face.tolist() == [number for number in range(6) for _ in range(12)]
    assert regions.worn.tolist() == [number > 1 for number in regions.of_face]
    shutil.rmtree(tree.root / "00127")
    code, out = harness("data", "add", "4d-dress", tree.root, "--frame", 12, "--replace")
    assert code == 0, out
    assert loaded(place, "4d-dress", "00148-Inner-Take7")[1].extent[1] == pytest.approx(1.5, 1e-5)
    assert "no sequence of 4D-DRESS here has a frame 7" in harness(
        "data", "add", "4d-dress", tree.root, "--frame", 7, "--replace")[1]  # fmt: skip
    labels = tree.root / "00148/Inner/Take7/Semantic/labels/label-f00012.pkl"
    put_pickle(labels, {"scan_labels": np.full(48, 9)})
    out = harness("data", "add", "4d-dress", tree.root, "--frame", 12, "--replace")[1]
    assert "has labels that are not known (expected 0 to 5: skin, hair" in out


def test_colours_of_vertices_stand_in_for_a_missing_texture(place, tmp_path):
    tree = dress(tmp_path / "licensed")
    for path in tree.root.rglob("atlas-*.pkl"):
        path.unlink()
    code, out = harness("data", "add", "4d-dress", tree.root)
    assert code == 0, out
    assert "have no texture" in out
    assert "there is no texture atlas-f00011.pkl: the colours of its vertices are taken" in out


def test_which_way_is_up_is_measured_and_never_guessed(place, tmp_path):
    for up in ("+y", "+z"):
        root = tmp_path / up
        assert harness("data", "add", "renderpeople", renderpeople(root, up=up).root, "--replace",
                       "--subjects", "rp_anna_posed_001")[0] == 0  # fmt: skip
        assert loaded(place, "renderpeople", "rp_anna_posed_001")[1].extent[1] > 1.5
    assert load_manifest(place / "data_manifest.yaml").datasets["renderpeople"].field


PAPER = """
  thuman21:   # 'harness data add NAME DIR' writes this again
    {title: T, kind: thuman, licence: L, root: "${NOWHERE}", scale: fit, facing: fit,
     subjects: ["0001"]}
"""


def test_splits_of_publications(place, tmp_path):
    assert harness("data", "add", "x-humans", x_humans(tmp_path / "x").root)[0] == 0
    manifest = load_manifest(place / "data_manifest.yaml")
    assert manifest.split("x-humans", "test") == ("00016-test-Take10",)
    tree = TREES["customhumans"](tmp_path / "c")
    code, out = harness("data", "add", "customhumans", tree.root)
    unknown = "split 'sith60' of CustomHumans: ids not known here: from the folder gt_meshes_60"
    assert (code, unknown in out) == (0, True)
    listed = harness("data", "list")[1]
    assert "customhumans --split sith60 ids not known here: from the folder gt_meshes_60" in listed
    assert "x-humans --split test the authors: all sequences in folders test" in listed
    assert "renderpeople RenderPeople: https://renderpeople.com" in listed
    words = ("--dataset", "customhumans", "--recipe", "tiny", "--split")
    for verb in (("eval", "--method", "gt", "--protocol", "sith"), ("render",)):
        code, out = harness(*verb, *words, "sith60")
        assert (code != 0, unknown in out) == (True, True)
    assert "did you mean 'sith60'" in harness("render", *words, "sith61")[1].lower()
    assert "both name subjects" in harness("render", *words, "sith60", "--subjects", "0003")[1]
    assert "has no split" in harness("render", "--dataset", "toy", "--split", "toy-two")[1]
    assert manifest.split("toy", "toy-one") == ("t1",)


def test_a_split_that_is_not_whole_is_none(place, tmp_path):
    ids = [f"{number:05d}-a-b-000{number:03d}" for number in range(60)]
    from tests.stand_in.field_trees import cape

    tree = cape(tmp_path / "cape", ids[:3])
    (tree.root / "all.txt").write_text("\n".join(f"cape/{each}" for each in ids))
    assert harness("data", "add", "cape", tree.root)[0] == 0
    out = harness("render", "--dataset", "cape", "--split", "easy", "--recipe", "tiny")[1]
    assert "split 'easy' of CAPE is not whole" in out
    assert "47 of them missing" in out
    (tree.root / "all.txt").write_text("\n".join(ids[:3]))
    assert harness("data", "add", "cape", tree.root, "--replace")[0] == 0
    manifest = load_manifest(place / "data_manifest.yaml")
    assert manifest.split("cape", "easy") == tuple(ids[:3])
    assert "is not whole" in harness(
        "render", "--dataset", "cape", "--split", "hard", "--recipe", "tiny")[1]  # fmt: skip


def test_published_ids_are_as_many_as_published():
    counts = {(name, split): len(found.ids) for name in field_names()
              for split, found in field_set(name).splits.items() if found.ids}  # fmt: skip
    assert counts == {
        ("cape", "pose"): 100, ("renderpeople", "loose"): 100, ("4d-dress", "single-view"): 128,
        ("4d-dress", "video-test"): 8, ("thuman20", "gta"): 20, ("thuman20", "sith-train"): 526,
        ("thuman21", "mexecon"): 20, ("thuman21", "pshuman"): 64,
    }  # fmt: skip
    shipped = load_manifest().datasets["thuman21"]
    assert set(field_set("thuman21").splits["mexecon"].ids) == set(shipped.subjects)
    assert (
        load_manifest().split("thuman21", "mexecon") == field_set("thuman21").splits["mexecon"].ids
    )


def test_the_shipped_entry_gives_way(place, tmp_path):
    path = place / "data_manifest.yaml"
    path.write_text(path.read_text().replace("\n# Parts", f"{PAPER}\n# Parts"))
    tree = TREES["thuman21"](tmp_path / "licensed")
    assert harness("data", "add", "thuman21", tree.root)[0] == 0
    assert load_manifest(path).datasets["thuman21"].subjects == ("0021", "0461", "0524")
    assert (
        "there is a dataset 'thuman21' already" in harness("data", "add", "thuman21", tree.root)[1]
    )

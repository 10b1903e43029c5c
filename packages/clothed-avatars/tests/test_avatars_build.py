"""One whole avatar, read back from its files; drapes that ship with the package."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from clothed_avatars import build, sheet, stored
from clothed_avatars.build import AVATARS_VERSION, drape_recipe, make_avatar
from clothed_avatars.clothes import drape
from clothed_avatars.mesh.faces import neighbours
from clothed_avatars.mesh.shell import Shell
from clothed_avatars.people.body import AvatarBody
from clothed_avatars.recipe import recipe_for, subject_ids
from clothed_avatars.sheet import avatar_sheet
from clothed_avatars.skin import bake
from clothed_avatars.stored import drape_key, load_drape, save_drape
from clothed_avatars.writer import write_avatar
from harness.core.errors import DataError
from harness.files.mesh_files import load_mesh

pytestmark = pytest.mark.nightly

NAME = "a01"
#: Shorts and a shirt: of all stored drapes, the one of two garments that is solved soonest.
DRAPED = "a09"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The folder of an avatar, and the calls by which it was written."""
    directory = tmp_path_factory.mktemp("avatars") / "model" / NAME
    calls = []

    def write(*arguments):
        calls.append(arguments)
        write_avatar(*arguments)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(build, "write_avatar", write)
        make_avatar(recipe_for(NAME), directory)
    return directory, calls


@pytest.fixture(scope="module")
def folder(made):
    return made[0]


@pytest.fixture(scope="module")
def mesh(folder):
    return load_mesh(folder / f"{NAME}.obj", texture=True)


@pytest.fixture(scope="module")
def labels(folder):
    with np.load(folder / "labels.npz") as data:
        return data["names"].tolist(), data["face_labels"]


def test_the_folder_is_complete(folder):
    assert {p.name for p in folder.iterdir()} == {
        f"{NAME}.obj",
        "material0.mtl",
        "material0.jpeg",
        "body.npz",
        "labels.npz",
        "LICENSE.txt",
        "avatar.json",
    }
    assert [p.name for p in folder.parent.iterdir()] == [NAME]


def test_the_record_says_what_was_made_and_what_it_measures(folder, mesh):
    record = json.loads((folder / "avatar.json").read_text())
    assert record["version"] == AVATARS_VERSION
    assert record["recipe"] == json.loads(json.dumps(recipe_for(NAME).as_dict()))
    assert record["clothing"] == "t-shirt and straight trousers"
    measured = record["measured"]
    assert measured["faces"] == len(mesh.faces)
    assert 10 < measured["cloth_to_body_mm"] < 40
    assert measured["cloth_to_body_normals_deg"] > 15
    assert [d["garment"] for d in record["drape"]] == ["bottom", "top"]
    assert record["packages"]["anny"]


def test_it_is_one_closed_surface_of_a_person_in_metres(mesh):
    assert 200_000 <= len(mesh.faces) <= 400_000
    assert 1.45 < mesh.extent[1] < 2.0
    assert mesh.signed_volume > 0.04
    neighbours(mesh.faces.astype(np.int64))  # refuses borders and non-manifold edges


def test_texture_triangles_are_not_turned_over(mesh):
    a, b, c = (np.asarray(mesh.uv)[np.asarray(mesh.face_uv)[:, k]] for k in range(3))
    area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    # The file's decimals may flatten a sliver, but turn none over.
    assert area.min() > -1e-10
    assert (area > 0).mean() > 0.999


def test_the_texture_is_painted_with_the_fabric(folder, mesh, labels):
    names, of_face = labels
    image = np.asarray(Image.open(folder / "material0.jpeg"), float)
    assert image.shape == (2048, 2048, 3)
    own = of_face == names.index("straight trousers")
    centre = np.asarray(mesh.uv)[np.asarray(mesh.face_uv)[own]].mean(1)
    column, row = (centre * 2047).astype(int).T
    fabric = recipe_for(NAME).bottom.fabric
    seen = np.median(image[2047 - row, column], axis=0)
    low, high = np.sort([fabric.colour, fabric.second], axis=0)
    assert (seen > low - 12).all()
    assert (seen < high + 12).all()


def test_every_face_has_a_region_and_none_is_a_speck(mesh, labels):
    names, of_face = labels
    assert of_face.dtype == np.int16
    assert of_face.shape == (len(mesh.faces),)
    counts = dict(zip(names, np.bincount(of_face, minlength=len(names)).tolist(), strict=True))
    worn = ("t-shirt", "straight trousers", "hair", "shoes", "head", "arms", "hands")
    assert all(counts[name] > 3000 for name in worn)


def test_the_toes_and_the_nose_point_to_plus_z(folder):
    with np.load(folder / "body.npz") as body:
        joints = dict(zip(body["joint_names"].tolist(), body["joints"], strict=True))
    assert joints["toe1-1.L"][2] > joints["foot.L"][2] + 0.05
    assert joints["eye.L"][2] > joints["head"][2]
    assert joints["upperarm01.L"][0] > joints["upperarm01.R"][0]
    assert joints["head"][1] > joints["root"][1]


def test_the_stored_parameters_give_the_stored_body(folder):
    anny = pytest.importorskip("anny")
    import torch

    with np.load(folder / "body.npz") as body:
        model = anny.Anny(
            rig=str(body["rig"]), topology=str(body["topology"]), skinning_method="lbs"
        )
        out = model(
            pose_parameters=torch.as_tensor(body["pose_parameters"], dtype=torch.float32)[None],
            phenotype_kwargs=dict(
                zip(body["phenotype_names"].tolist(), body["phenotype"].tolist(), strict=True)
            ),
            pose_parameterization=str(body["pose_parameterization"]),
        )
        again = out["vertices"][0].double().numpy() @ body["anny_to_product"].T
        assert np.abs(again - body["vertices"]).max() < 1e-5
        assert body["faces"].max() < len(body["vertices"])
        assert list(model.bone_labels) == body["joint_names"].tolist()


def test_bare_skin_lies_on_the_true_body(folder, mesh, labels):
    import open3d as o3d

    names, of_face = labels
    with np.load(folder / "body.npz") as body:
        scene = o3d.t.geometry.RaycastingScene(nthreads=1)
        scene.add_triangles(body["vertices"].astype(np.float32), body["faces"].astype(np.uint32))
    centres = mesh.vertices[mesh.faces].mean(1).astype(np.float32)
    distance_mm = 1000 * scene.compute_distance(o3d.core.Tensor(centres)).numpy()
    for region in ("hands", "arms"):
        assert np.median(distance_mm[of_face == names.index(region)]) < 1.5


def test_equal_recipes_give_equal_bytes(folder, tmp_path, monkeypatch):
    """Two coarse ones with small textures, which go through every step that a fine one does."""
    for module in (build, bake):
        monkeypatch.setattr(module, "TEXTURE_SIZE", 512)
    monkeypatch.setattr(build, "Shell", lambda: Shell(voxel=0.010, faces=30_000))
    first, again = tmp_path / "first" / NAME, tmp_path / "again" / NAME
    for each in (first, again):
        make_avatar(recipe_for(NAME), each)
    assert {file.name for file in first.iterdir()} == {file.name for file in folder.iterdir()}
    for file in first.iterdir():
        assert file.read_bytes() == (again / file.name).read_bytes(), file.name


def test_the_sheet_shows_a_person_on_paper(folder, monkeypatch):
    monkeypatch.setattr(sheet, "_VIEW_PX", (108, 192))  # a third of each side
    shown = avatar_sheet(folder, NAME)
    assert shown.dtype == np.uint8
    height, width, _ = shown.shape
    cells = shown.reshape(2, height // 2, 8, width // 8, 3)
    ink = (np.abs(cells.astype(int) - cells[0, 0, 0, 0]).max(-1) > 8).mean((1, 3))
    assert (ink > 0.05).all()
    assert (ink[0] < 0.4).all()


def test_a_failed_write_leaves_nothing(made, tmp_path, monkeypatch):
    def full_disk(*_args, **_kwargs):
        raise OSError(28, "No space left on device")

    # All that making an avatar writes is written by one call, which is made again.
    directory, ((written_to, *content),) = made
    assert written_to == directory
    monkeypatch.setattr(Image.Image, "save", full_disk)
    with pytest.raises(DataError, match="No space left"):
        write_avatar(tmp_path / "model" / NAME, *content)
    assert list((tmp_path / "model").iterdir()) == []


STORED = sorted(Path(stored.__file__).with_name("drapes").glob("*.npz"))


@pytest.mark.parametrize("path", STORED, ids=lambda path: path.stem)
def test_a_stored_drape_belongs_to_its_recipe_as_it_is_now(path):
    assert path.stem in subject_ids()
    with np.load(path) as data:
        assert str(data["key"]) == drape_key(recipe_for(path.stem))


def test_blender_drapes_what_is_stored_and_stale_drapes_are_not_used(tmp_path, monkeypatch):
    recipe = recipe_for(DRAPED)
    body = AvatarBody(recipe.phenotype)
    shipped = drape_recipe(recipe, body)
    pieces = [item.piece for item in shipped]
    save_drape(recipe, shipped, tmp_path)
    again = load_drape(recipe, pieces, tmp_path)
    assert again is not None
    assert np.array_equal(again[0].vertices, shipped[0].vertices)
    monkeypatch.setattr(stored, "DRAPE_VERSION", stored.DRAPE_VERSION + 1)
    assert load_drape(recipe, pieces, tmp_path) is None
    for new, old in zip(drape_recipe(recipe, body), shipped, strict=True):
        # Draping is chaotic: how another processor rounds moves folds, which is why drapes are
        # stored, but not garments.
        away = np.linalg.norm(new.vertices - old.vertices, axis=1)
        assert away.mean() < 4e-3
        assert away.max() < 0.05


def test_blender_drapes_alike_each_time():
    """Both garments, thrown into the pose in a few frames: to the last bit."""
    recipe = recipe_for(NAME)
    body = AvatarBody(recipe.phenotype)
    pieces = [item.piece for item in drape_recipe(recipe, body)]
    path = drape._path(body, recipe.posture, drape._Motion(4, 2, 5))
    first, again = (drape._solve(body, path, pieces, 5, None) for _ in range(2))
    for one, other, piece in zip(first, again, pieces, strict=True):
        np.testing.assert_array_equal(one, other)
        assert np.linalg.norm(one[-1] - piece.vertices, axis=1).max() > 0.05

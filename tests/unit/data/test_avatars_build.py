"""One whole avatar, read back from its files."""

import json

import numpy as np
import pytest
from PIL import Image

from harness.core.errors import DataError
from harness.core.mesh_files import load_mesh
from harness.data.avatars import AVATARS_VERSION, make_avatar, recipe_for, subject_ids
from harness.data.avatars.body import pose_body, skin_vertices
from harness.data.avatars.texture import CELLS

pytestmark = pytest.mark.slow

FOCAL_PX, HALF_WIDTH_PX, HALF_HEIGHT_PX, RADIUS_M = 2666.67, 540, 960, 3.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    directory = tmp_path_factory.mktemp("avatars") / "model" / "a02"
    make_avatar(recipe_for("a02"), directory)
    return directory


@pytest.fixture(scope="module")
def mesh(folder):
    return load_mesh(folder / "a02.obj", texture=True)


def test_the_folder_is_complete(folder):
    assert {p.name for p in folder.iterdir()} == {
        "a02.obj",
        "material0.mtl",
        "material0.jpeg",
        "body.npz",
        "labels.npz",
        "LICENSE.txt",
        "avatar.json",
    }
    assert [p.name for p in folder.parent.iterdir()] == ["a02"]


def test_the_record_says_what_was_made(folder, mesh):
    record = json.loads((folder / "avatar.json").read_text())
    assert record["version"] == AVATARS_VERSION
    assert record["recipe"] == json.loads(json.dumps(recipe_for("a02").as_dict()))
    assert record["counts"]["faces"] == len(mesh.faces)
    assert record["packages"]["anny"]


def test_it_is_a_standing_person_in_metres(mesh):
    size = np.ptp(mesh.vertices, axis=0)
    assert 1.5 < size[1] < 1.95
    assert size[1] == size.max()
    assert 50_000 <= len(mesh.faces) <= 160_000


def test_the_toes_and_the_nose_point_to_plus_z(folder):
    with np.load(folder / "body.npz") as body:
        joints = dict(zip(body["joint_names"].tolist(), body["joints"], strict=True))
    assert joints["toe1-1.L"][2] > joints["foot.L"][2] + 0.05
    assert joints["eye.L"][2] > joints["head"][2]
    assert joints["upperarm01.L"][0] > joints["upperarm01.R"][0]
    assert joints["head"][1] > joints["root"][1]


def test_texture_corners_lie_in_their_own_cells(folder, mesh):
    with np.load(folder / "labels.npz") as labels:
        names, of_face = labels["names"].tolist(), labels["face_labels"]
    assert of_face.dtype == np.int16
    assert of_face.shape == (len(mesh.faces),)
    uv = np.asarray(mesh.uv)[np.asarray(mesh.face_uv)]
    for index, name in enumerate(names):
        left, bottom, side = CELLS[name]
        corners = uv[of_face == index].reshape(-1, 2)
        assert len(corners)
        assert (corners >= [left, bottom]).all()
        assert (corners <= [left + side, bottom + side]).all()


def test_the_texture_is_painted(folder):
    image = np.asarray(Image.open(folder / "material0.jpeg"))
    assert image.shape == (2048, 2048, 3)
    recipe = recipe_for("a02")
    left, bottom, side = CELLS["bottom"]
    cell = image[
        int((1 - bottom - side) * 2048) : int((1 - bottom) * 2048),
        int(left * 2048) : int((left + side) * 2048),
    ]
    assert np.allclose(np.median(cell, axis=(0, 1)), recipe.bottom.fabric.colour, atol=8)


def test_the_stored_parameters_give_the_stored_body(folder):
    anny = pytest.importorskip("anny")
    import torch

    with np.load(folder / "body.npz") as body:
        model = anny.Anny(
            rig=str(body["rig"]), topology=str(body["topology"]), skinning_method="lbs"
        )
        out = model(
            pose_parameters=torch.as_tensor(body["pose_parameters"])[None],
            phenotype_kwargs=dict(
                zip(body["phenotype_names"].tolist(), body["phenotype"].tolist(), strict=True)
            ),
            pose_parameterization=str(body["pose_parameterization"]),
        )
        again = out["vertices"][0].numpy() @ body["anny_to_product"].T
        assert np.abs(again - body["vertices"]).max() < 1e-6
        assert body["faces"].max() < len(body["vertices"])
        assert list(model.bone_labels) == body["joint_names"].tolist()


def test_clothes_stand_off_the_body_and_skin_lies_on_it(folder, mesh):
    import open3d as o3d

    with np.load(folder / "body.npz") as body:
        scene = o3d.t.geometry.RaycastingScene(nthreads=1)
        scene.add_triangles(body["vertices"].astype(np.float32), body["faces"].astype(np.uint32))
    with np.load(folder / "labels.npz") as labels:
        names, of_face = labels["names"].tolist(), labels["face_labels"]
    centres = mesh.vertices[mesh.faces].mean(1).astype(np.float32)
    distance_mm = 1000 * scene.compute_distance(o3d.core.Tensor(centres)).numpy()
    mean_mm = {n: distance_mm[of_face == i].mean() for i, n in enumerate(names)}
    assert 8 < mean_mm["top"] < 40
    assert 10 < mean_mm["bottom"] < 100
    assert mean_mm["skin"] < 3
    assert mean_mm["head"] < 3


def test_equal_recipes_give_equal_bytes(folder, tmp_path):
    make_avatar(recipe_for("a02"), tmp_path / "a02")
    for file in folder.iterdir():
        assert file.read_bytes() == (tmp_path / "a02" / file.name).read_bytes(), file.name


def test_a_failed_write_leaves_nothing(tmp_path, monkeypatch):
    def full_disk(*_args, **_kwargs):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Image.Image, "save", full_disk)
    with pytest.raises(DataError, match="No space left"):
        make_avatar(recipe_for("a02"), tmp_path / "model" / "a02")
    assert list((tmp_path / "model").iterdir()) == []


@pytest.mark.parametrize("subject", subject_ids())
def test_every_pose_fits_the_frame_of_every_camera(subject):
    recipe = recipe_for(subject)
    body = pose_body(recipe.phenotype, recipe.pose_deg)
    assert np.allclose(skin_vertices(body.rest, body.weights, body.transforms), body.posed)
    skin = body.posed[np.unique(body.groups["skin"][0])]
    skin = skin - (skin.min(0) + skin.max(0)) / 2
    clothes_px = 0.04 * FOCAL_PX / RADIUS_M  # hair, soles and sleeves
    for angle in np.radians(np.arange(0, 360, 45)):
        depth = RADIUS_M - skin[:, 0] * np.sin(angle) - skin[:, 2] * np.cos(angle)
        across = skin[:, 0] * np.cos(angle) - skin[:, 2] * np.sin(angle)
        assert FOCAL_PX * np.abs(across / depth).max() + clothes_px < HALF_WIDTH_PX
        assert FOCAL_PX * np.abs(skin[:, 1] / depth).max() + clothes_px < HALF_HEIGHT_PX

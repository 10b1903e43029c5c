"""Bodies, poses and cut clothes, before they are draped."""

from dataclasses import replace

import numpy as np
import pytest

from clothed_avatars.checks import check_avatar
from clothed_avatars.clothes import drape as drape_module
from clothed_avatars.clothes.drape import DrapeCheck, drape
from clothed_avatars.clothes.extras import shoes
from clothed_avatars.clothes.patterns import cut_bottom, cut_top
from clothed_avatars.clothes.wardrobe import (
    Fabric,
    Hair,
    coat,
    dress,
    skirt,
    t_shirt,
    wide_trousers,
)
from clothed_avatars.mesh.nearness import Nearness
from clothed_avatars.mesh.quads import border_loops, triangles, vertex_normals
from clothed_avatars.people.body import SKIN_VERTICES, AvatarBody, carry
from clothed_avatars.people.landmarks import heights
from clothed_avatars.people.poses import POSES, joint_rotations
from clothed_avatars.recipe import recipe_for, subject_ids
from clothed_avatars.skin.hair import grow_hair
from harness.core.errors import DataError, MethodError

pytestmark = pytest.mark.nightly

FABRIC = Fabric((100, 100, 100))


@pytest.fixture(scope="module")
def body():
    return AvatarBody({"gender": 0.4, "age": 0.66, "height": 0.4, "weight": 0.5})


@pytest.fixture(scope="module")
def skin(body):
    return Nearness(body.vertices, body.quads("skin"))


def test_an_unmoved_body_is_the_unposed_body(body):
    still = body.posed({})
    assert np.allclose(still.vertices, body.vertices, atol=1e-6)
    assert np.allclose(still.transforms, np.eye(4), atol=1e-5)
    assert np.allclose(joint_rotations(body, POSES["walking"], 0.0, 0.0)["upperarm01.L"], 0)


def test_skinning_by_transforms_agrees_with_the_body_model(body):
    posed = body.posed(joint_rotations(body, POSES["reaching"]))
    carried = carry(body.vertices, body.weights, posed.transforms)
    assert np.abs(carried - posed.vertices).max() < 0.003


@pytest.mark.parametrize("name", POSES)
def test_limbs_point_where_the_pose_says(body, name):
    pose = POSES[name]
    posed = body.posed(joint_rotations(body, pose))
    at = dict(zip(body.bone_names, posed.joints, strict=True))
    for k, (side, sign) in enumerate((("L", 1), ("R", -1))):
        outward, down = np.radians(pose.legs[k].upper)
        said = [
            sign * np.sin(outward) * np.cos(down),
            -np.sin(down),
            np.cos(outward) * np.cos(down),
        ]
        bone = at[f"lowerleg01.{side}"] - at[f"upperleg01.{side}"]
        assert bone / np.linalg.norm(bone) == pytest.approx(said, abs=0.02)


@pytest.mark.parametrize(
    ("cut", "loops"),
    [(t_shirt, 4), (coat, 4), (dress, 4), (wide_trousers, 3), (skirt, 2)],
)
def test_a_cut_garment_clears_the_body_and_has_its_openings(body, skin, cut, loops):
    garment = cut(FABRIC)
    piece = (cut_bottom if cut in (wide_trousers, skirt) else cut_top)(body, garment, skin)
    assert skin.height(piece.vertices)[0].min() > 0.003
    assert len(border_loops(piece.quads)) == loops
    assert len(piece.pattern) == len(piece.part) == len(piece.pin) == len(piece.vertices)
    held = piece.vertices[piece.pin > 0]
    assert len(held)
    limit = heights(body).waist - 0.05 if piece.name == "bottom" else heights(body).shoulder
    assert held[:, 1].min() > limit
    assert (
        np.einsum("vd,vd->v", vertex_normals(piece.vertices, piece.quads), piece.vertices) > 0
    ).mean() > 0.5


def test_an_open_coat_parts_in_front(body, skin):
    piece = cut_top(body, coat(FABRIC, FABRIC), skin)
    front = piece.vertices[(piece.vertices[:, 2] > 0.05) & (piece.part == 0)]
    assert np.abs(front[:, 0]).min() > 0.01
    assert len(border_loops(piece.quads)) == 3


@pytest.mark.parametrize("style", ["short", "curly", "long", "bun", "ponytail"])
def test_hair_covers_the_crown_and_leaves_the_face(body, style):
    posed = body.posed({})
    layers = grow_hair(body, posed, Hair(style, (0, 0, 0)), 5)
    points = np.concatenate([layer.vertices for layer in layers])
    eyes = body.vertices[body.quads("eyes")].mean((0, 1))
    assert points[:, 1].max() > body.vertices[:SKIN_VERTICES, 1].max() + 0.003
    before_the_eyes = (points[:, 2] > eyes[2]) & (np.abs(points[:, 1] - eyes[1]) < 0.02)
    assert not before_the_eyes.any()
    assert all(layer.place.shape == (len(layer.vertices), 5) for layer in layers)


def test_shoes_enclose_the_feet(body):
    posed = body.posed(joint_rotations(body, POSES["walking"]))
    feet = body.members("foot.L", "toe")[:SKIN_VERTICES] > 0.9
    lowest = posed.vertices[:SKIN_VERTICES][feet, 1].min()
    soles = np.concatenate([layer.vertices for layer in shoes(body, posed)])
    assert soles[:, 1].min() < lowest


def test_a_bad_drape_is_named():
    good = DrapeCheck(sunk=0.0, stretch=1.1, strayed_m=0.05, restless_mm=1.0)
    assert good.complaints(0.3) == []
    bad = DrapeCheck(sunk=0.2, stretch=3.0, strayed_m=0.9, restless_mm=40.0)
    assert len(bad.complaints(0.3)) == 4


def test_cloth_that_never_rests_is_an_error_after_every_attempt(body, skin, monkeypatch):
    piece = cut_top(body, t_shirt(FABRIC), skin)
    attempts = []

    def fallen(_body, path, pieces, quality, _progress):
        attempts.append(quality)
        down = pieces[0].vertices - [0.0, 1.0, 0.0]
        return [np.stack([down, down])]

    # Few frames: nothing is solved, and only the last pose counts.
    short = tuple(replace(each, moving=3, waiting=1) for each in drape_module._ATTEMPTS)
    monkeypatch.setattr(drape_module, "_ATTEMPTS", short)
    monkeypatch.setattr(drape_module, "_solve", fallen)
    with pytest.raises(MethodError, match="strayed"):
        drape(body, POSES["standing"], [piece])
    assert len(attempts) == 3
    assert attempts == sorted(attempts)


def bare(subject):
    """The skin's vertices and faces of a posed subject, and what measures distances to them."""
    recipe = recipe_for(subject)
    person = AvatarBody(recipe.phenotype)
    posed = person.posed(joint_rotations(person, POSES[recipe.pose]))
    quads = person.quads("skin")
    used, faces = np.unique(triangles(quads), return_inverse=True)
    return posed.vertices[used], faces.reshape(-1, 3), Nearness(posed.vertices, quads)


@pytest.mark.parametrize("subject", subject_ids())
def test_every_body_fits_the_frame_of_every_camera(subject):
    vertices, faces, near = bare(subject)
    measured = check_avatar(subject, vertices, faces, np.ones(len(faces), bool), near)
    assert 1.45 < float(str(measured["height_m"])) < 1.98
    assert measured["cloth_to_body_mm"] == pytest.approx(0, abs=0.01)


def test_who_only_trains_networks_may_leave_the_frame():
    vertices, faces, near = bare("a01")
    wide = vertices * (3.0, 1.0, 1.0)
    cloth = np.ones(len(faces), bool)
    with pytest.raises(DataError, match="leaves the frame in [1-8] of 8 views"):
        check_avatar("wide", wide, faces, cloth, near)
    measured = check_avatar("wide", wide, faces, cloth, near, framed=False)
    assert measured["width_m"] == pytest.approx(np.ptp(wide[:, 0]), abs=1e-4)
    training = ["t00129", "u00002", "v00001"]
    tested = [*subject_ids(), "b01", "h01", "s01"]
    assert all(recipe_for(subject).is_for_training for subject in training)
    assert not any(recipe_for(subject).is_for_training for subject in tested)

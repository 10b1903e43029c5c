"""The second test set and its training: poses, people and weaves that the other does not have."""

import json
from dataclasses import replace

import numpy as np
import pytest

from clothed_avatars import build, creased_clothes
from clothed_avatars.build import make_avatar
from clothed_avatars.clothes import drape as draping
from clothed_avatars.clothes.drape import DrapeCheck, Draped
from clothed_avatars.clothes.patterns import cut_top
from clothed_avatars.clothes.weaves import WEAVES
from clothed_avatars.creased_clothes import MOST_CROSSING, creased
from clothed_avatars.mesh.nearness import Nearness
from clothed_avatars.mesh.noise import smooth_noise
from clothed_avatars.mesh.shell import Shell
from clothed_avatars.people.body import AvatarBody, carry
from clothed_avatars.people.poses import POSES, joint_rotations
from clothed_avatars.recipe import recipe_for, subject_ids
from clothed_avatars.skin import bake
from clothed_avatars.subjects.creased_people import creased_test_ids
from clothed_avatars.subjects.populations import LEAST_POSE_DISTANCE_DEG, sealed_ids
from drawn_people import fabrics, least_distance, poses, recipe_of
from harness.core.errors import DataError, MethodError
from harness.core.files.hashing import content_hash
from harness.data.manifest import load_manifest
from harness.files.mesh_files import load_mesh
from metrics.folds import PIXEL_M, fold_strength, true_normals

TESTED = creased_test_ids()
TRAINING = tuple(f"v{k:05d}" for k in range(1, 25))
OTHERS = (*subject_ids(), *sealed_ids(), "t00001", "t00002", "u00001", "u00002")


def test_there_are_twenty_and_the_manifest_lists_them(request):
    manifest = load_manifest(request.config.rootpath / "data_manifest.yaml")
    assert manifest.datasets["avatars2"].subjects == TESTED
    assert tuple(f"b{k:02d}" for k in range(1, 21)) == TESTED
    assert set(TRAINING) < set(manifest.datasets["avatars-train3"].subjects)
    with pytest.raises(DataError, match="b21"):
        recipe_for("b21")


def test_test_poses_keep_their_distance_from_written_sealed_and_training_poses():
    tested = poses(TESTED)
    for others in (POSES.values(), poses(sealed_ids()), poses(TRAINING)):
        assert least_distance(tested, others) >= LEAST_POSE_DISTANCE_DEG


def test_training_poses_keep_their_distance_from_written_and_sealed_poses():
    trained = poses(TRAINING)
    for others in (POSES.values(), poses(sealed_ids())):
        assert least_distance(trained, others) >= LEAST_POSE_DISTANCE_DEG
    assert len(set(trained)) == len(trained)


def test_test_and_training_share_no_seed_colour_cut_or_size_of_pattern():
    ours, theirs = list(map(recipe_of, TESTED)), list(map(recipe_of, (*TRAINING, *OTHERS)))
    assert not {r.seed for r in ours} & {r.seed for r in theirs}
    for look in ("skin", "eyes"):
        assert not {getattr(r, look) for r in ours} & {getattr(r, look) for r in theirs}
    assert not {r.hair.colour for r in ours} & {r.hair.colour for r in theirs}
    cuts = [{(r.top.chest, r.top.hem, r.top.sleeve) for r in group} for group in (ours, theirs)]
    assert not cuts[0] & cuts[1]
    sizes = [[f.scale for f in fabrics(ids)] for ids in (TESTED, (*TRAINING, *OTHERS))]
    assert min(sizes[0]) > max(sizes[1])


def test_every_garment_is_of_a_weave_and_no_older_subject_has_one():
    seen = set()
    for recipe in map(recipe_of, (*TESTED, *TRAINING)):
        worn = recipe.worn
        assert recipe.top.fabric.stiffness == WEAVES[worn.top].stiffness
        assert (worn.bottom is None) == (recipe.bottom is None)
        if recipe.bottom is not None:
            assert recipe.bottom.fabric.stiffness == WEAVES[worn.bottom].stiffness
        seen |= {worn.top, worn.bottom}
    assert set(WEAVES) <= seen
    assert all(recipe_of(subject).worn is None for subject in OTHERS)


@pytest.mark.parametrize("subject", ["b01", "v00007"])
def test_a_recipe_is_plain_data_and_the_same_each_time(subject):
    record = json.loads(json.dumps(recipe_for(subject).as_dict()))
    assert record["worn"]["revision"] == recipe_for(subject).worn.revision
    assert record == json.loads(json.dumps(recipe_for(subject).as_dict()))


def test_recipes_of_older_subjects_do_not_mention_weaves():
    assert all("worn" not in recipe_of(subject).as_dict() for subject in OTHERS)


def test_heights_and_weights_are_those_of_everybody():
    people = [recipe_of(subject).phenotype for subject in TRAINING]
    heights, weights = ([person[name] for person in people] for name in ("height", "weight"))
    assert min(heights) < 0.3 < 0.48 < max(heights)
    assert min(weights) < 0.3 < 0.72 < max(weights)


def digest(ids):
    return content_hash([recipe_for(subject).as_dict() for subject in ids])


def test_the_second_test_set_stays_what_it_is():
    assert digest(TESTED) == "0230ca4a4aacb12e"


@pytest.mark.nightly
def test_a_garment_that_collapsed_is_refused_and_named(monkeypatch):
    """A shirt that is thrown about by more than the size of its folds is no drape."""
    recipe = recipe_for("b01")
    body = AvatarBody(recipe.phenotype)
    posed = body.posed(joint_rotations(body, recipe.posture))
    piece = cut_top(body, recipe.top, Nearness(body.vertices, body.quads("skin")))

    def collapsed(_body, _pose, pieces, _progress, how):
        assert not how.evened
        vertices = carry(pieces[0].vertices, pieces[0].weights, posed.transforms)
        thrown = [smooth_noise(pieces[0].pattern / 0.04, seed) for seed in range(3)]
        vertices += 0.06 * np.stack(thrown, axis=1)
        return [Draped(pieces[0], vertices, DrapeCheck(0.0, 1.0, 0.0, 0.0), 1)]

    monkeypatch.setattr(creased_clothes, "drape", collapsed)
    with pytest.raises(MethodError, match="the top of b01 passes through itself") as refused:
        creased(recipe, body, posed, [piece])
    assert f"{MOST_CROSSING:.1%}" in str(refused.value)


@pytest.mark.nightly
def test_a_creased_person_folds_as_real_clothes_do(tmp_path, monkeypatch):
    """Jersey over poplin: between smooth jersey, 7 degrees, and crumpled cotton, 18."""
    name = "v00004"
    for module in (build, bake):  # nobody looks at its texture
        monkeypatch.setattr(module, "TEXTURE_SIZE", 512)
    # In a third of the time: folds stay as deep within a degree, and 8 degrees are left without
    # any.
    quicker = replace(draping._ATTEMPTS[0], moving=12, waiting=8, quality=4)
    monkeypatch.setattr(draping, "_ATTEMPTS", (quicker,))
    monkeypatch.setattr(build, "Shell", lambda: Shell(voxel=0.0045, faces=150_000))
    make_avatar(recipe_for(name), tmp_path / name)
    record = json.loads((tmp_path / name / "avatar.json").read_text())
    assert record["recipe"]["worn"]["top"] == "jersey"
    assert all(item["crossing"] <= MOST_CROSSING for item in record["drape"])
    assert record["measured"]["watertight"]
    mesh = load_mesh(tmp_path / name / f"{name}.obj")
    found = [fold_strength(*true_normals(mesh, yaw), PIXEL_M).mean_deg for yaw in (0.0, 180.0)]
    assert 9 < min(found) <= max(found) < 16

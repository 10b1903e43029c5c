"""The sealed split and wide training: poses, people and looks that nothing else has."""

import json

import numpy as np
import pytest

from clothed_avatars.people import postures
from clothed_avatars.people.poses import POSES, Limb, Pose
from clothed_avatars.people.postures import (
    Figure,
    draw_pose,
    is_possible,
    mirrored,
    pose_distance_deg,
)
from clothed_avatars.recipe import recipe_for, subject_ids
from clothed_avatars.subjects.populations import (
    LEAST_POSE_DISTANCE_DEG,
    USUAL_HEIGHT,
    USUAL_WEIGHT,
    sealed_ids,
    sealed_subject,
)
from drawn_people import fabrics, least_distance, poses, recipe_of
from harness.core.errors import DataError
from harness.core.files.hashing import content_hash

SEALED = sealed_ids()
WIDE = tuple(f"u{k:05d}" for k in range(1, 61))
TRAINING = tuple(f"t{k:05d}" for k in range(1, 61))

DOWN = Limb((90, 90), (90, 90))
HANGING = Pose((DOWN, DOWN), (DOWN, DOWN))


def cuts(ids):
    return {(r.top.chest, r.top.hem, r.top.sleeve) for r in map(recipe_of, ids)}


def test_the_written_list_and_the_first_training_subjects_are_what_they_always_were():
    def digest(ids):
        return content_hash([recipe_for(subject).as_dict() for subject in ids])

    assert digest(subject_ids()) == "5c32f5d1dece2b28"
    assert digest([f"t{k:05d}" for k in range(1, 2001)]) == "0413e86cb2d0b436"


def test_the_distance_of_two_poses_is_the_root_mean_square_of_their_limbs_angles():
    bent = Pose((Limb((0, 90), (0, 0)), DOWN), (DOWN, DOWN))  # one forearm level and forward
    assert pose_distance_deg(HANGING, HANGING) == pytest.approx(0, abs=1e-5)
    assert pose_distance_deg(HANGING, bent) == pytest.approx(np.sqrt(90**2 / 8))
    other_arm = Pose((DOWN, Limb((0, 90), (0, 0))), (DOWN, DOWN))
    assert mirrored(bent) == other_arm
    assert pose_distance_deg(bent, other_arm) == pytest.approx(0, abs=1e-5)


def test_sealed_poses_keep_their_distance_from_test_and_training_poses():
    tested, trained = poses(subject_ids()), poses(TRAINING)
    assert least_distance(poses(SEALED), tested) >= LEAST_POSE_DISTANCE_DEG
    assert least_distance(poses(SEALED), trained) >= LEAST_POSE_DISTANCE_DEG
    # All that training can ever draw, not only its first subjects.
    assert least_distance(poses(SEALED), POSES.values()) >= LEAST_POSE_DISTANCE_DEG


def test_wide_trainings_poses_keep_their_distance_from_test_and_sealed_poses():
    wide = poses(WIDE)
    assert least_distance(wide, POSES.values()) >= LEAST_POSE_DISTANCE_DEG
    assert least_distance(wide, poses(SEALED)) >= LEAST_POSE_DISTANCE_DEG
    assert len(set(wide)) == len(wide)


@pytest.mark.parametrize("subject", [*SEALED, *WIDE[:5]])
def test_every_person_is_an_adult_outside_the_usual_height_or_weight(subject):
    phenotype = recipe_of(subject).phenotype
    height, weight = phenotype["height"], phenotype["weight"]
    usual = USUAL_HEIGHT[0] <= height <= USUAL_HEIGHT[1]
    usual = usual and USUAL_WEIGHT[0] <= weight <= USUAL_WEIGHT[1]
    assert not usual
    assert phenotype["age"] >= 0.66
    assert all(0 <= value <= 1 for value in phenotype.values())


def test_the_written_list_and_training_are_inside_the_usual_height_and_weight():
    people = [recipe_of(subject).phenotype for subject in (*subject_ids(), *TRAINING)]
    heights, weights = ([person[name] for person in people] for name in ("height", "weight"))
    assert USUAL_HEIGHT[0] <= min(heights)
    assert max(heights) <= USUAL_HEIGHT[1]
    assert USUAL_WEIGHT[0] <= min(weights)
    assert max(weights) <= USUAL_WEIGHT[1]


def test_the_sealed_are_taller_shorter_heavier_and_thinner():
    people = [recipe_of(subject).phenotype for subject in SEALED]
    heights, weights = ([person[name] for person in people] for name in ("height", "weight"))
    assert min(heights) < USUAL_HEIGHT[0]
    assert max(heights) > USUAL_HEIGHT[1]
    assert min(weights) < USUAL_WEIGHT[0]
    assert max(weights) > USUAL_WEIGHT[1]


def test_sealed_subjects_share_no_seed_cut_colour_or_pattern_size_with_any_other():
    others = (*subject_ids(), *TRAINING, *WIDE)
    ours, theirs = map(recipe_of, SEALED), list(map(recipe_of, others))
    seeds = {recipe.seed for recipe in theirs}
    skins = {recipe.skin for recipe in theirs} | {recipe.hair.colour for recipe in theirs}
    eyes = {recipe.eyes for recipe in theirs}
    for recipe in ours:
        assert recipe.seed not in seeds
        assert recipe.skin not in skins
        assert recipe.hair.colour not in skins
        assert recipe.eyes not in eyes
    assert not cuts(SEALED) & cuts(others)
    colours = {colour for fabric in fabrics(others) for colour in (fabric.colour, fabric.second)}
    own = {colour for fabric in fabrics(SEALED) for colour in (fabric.colour, fabric.second)}
    assert not own & colours
    largest_of_the_list = max(fabric.scale for fabric in fabrics(subject_ids()))
    sizes = [fabric.scale for fabric in fabrics(SEALED)]
    least_of_training = min(fabric.scale for fabric in fabrics((*TRAINING, *WIDE)))
    assert largest_of_the_list < min(sizes) <= max(sizes) < least_of_training


def test_every_new_body_is_moved_off_the_model_and_no_old_one_is():
    new = [recipe_of(subject).shape for subject in (*SEALED, *WIDE)]
    assert all(shape is not None and 0.006 <= shape.rms_m <= 0.010 for shape in new)
    assert len({shape.seed for shape in new}) == len(new)
    assert all(recipe_of(subject).shape is None for subject in (*subject_ids(), *TRAINING))


@pytest.mark.parametrize("subject", [*SEALED[:3], *WIDE[:3]])
def test_a_recipe_is_plain_data_and_the_same_each_time(subject):
    recipe = recipe_for(subject)
    record = json.loads(json.dumps(recipe.as_dict()))
    assert record["drawn_pose"]["trunk"] == list(recipe.posture.trunk)
    assert record["shape"]["rms_m"] == recipe.shape.rms_m
    sealed_subject.cache_clear()
    assert record == json.loads(json.dumps(recipe_for(subject).as_dict()))


def test_there_are_only_twenty_sealed_subjects():
    assert list(SEALED) == [f"s{k:02d}" for k in range(1, 21)]
    with pytest.raises(DataError, match="s21"):
        recipe_for("s21")


# Forearms across the belly, an elbow bent backward, hands in front of the face, arms wide apart.
REFUSED = {
    "through the trunk": (Limb((90, 75), (-90, 5)), DOWN),
    "bent backward": (Limb((90, 60), (180, 40)), DOWN),
    "into the head": (Limb((0, 10), (-35, -75)), DOWN),
    "out of the frame": (Limb((90, 0), (90, 0)), DOWN),
}


@pytest.mark.parametrize("what", REFUSED)
def test_poses_that_nobody_takes_dressed_are_refused(what):
    one, leg = REFUSED[what]
    other = Limb((90, 68), (40, 60))
    assert not is_possible(Pose((one, other), (leg, leg)), Figure(1.75))
    assert is_possible(Pose((other, other), (leg, leg)), Figure(1.75))


def test_drawn_poses_follow_the_seed_and_end_when_there_is_none(monkeypatch):
    def drawn(seed, least_deg=10.0):
        return draw_pose(np.random.default_rng(seed), Figure(1.7), [HANGING], least_deg)

    assert drawn(4) == drawn(4)
    assert drawn(4) != drawn(5)
    monkeypatch.setattr(postures, "_ATTEMPTS", 1000)
    with pytest.raises(DataError, match="no pose was found in 1000 draws"):
        drawn(4, least_deg=175.0)

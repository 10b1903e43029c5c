"""The written list of subjects: complete, distinct, plain data."""

import copy
import json

import pytest

from harness.core.errors import DataError
from harness.data.avatars import recipe_for, subject_ids
from harness.data.avatars.poses import POSES

IDS = [f"a{i:02d}" for i in range(1, 21)]


def test_the_twenty_ids_are_there_in_order():
    assert list(subject_ids()) == IDS


def test_no_two_subjects_look_alike():
    looks = {json.dumps({**recipe_for(i).as_dict(), "id": "", "seed": 0}) for i in IDS}
    assert len(looks) == len(IDS)
    assert len({recipe_for(i).seed for i in IDS}) == len(IDS)


def test_a_recipe_is_the_same_each_time_and_travels_to_other_processes():
    recipe = recipe_for("a07")
    assert recipe == recipe_for("a07")
    assert copy.deepcopy(recipe) == recipe  # by the pickle protocol, as worker processes do
    assert json.loads(json.dumps(recipe.as_dict()))["pose"] == recipe.pose


def test_an_unknown_id_names_the_nearest():
    with pytest.raises(DataError, match="Did you mean 'a1[0-9]'"):
        recipe_for("a1x")


def test_every_pose_is_used_and_every_garment_class_appears():
    recipes = [recipe_for(i) for i in IDS]
    assert {r.pose for r in recipes} == set(POSES)
    assert {r.bottom.kind for r in recipes} == {
        "shorts",
        "skirt",
        "slim trousers",
        "straight trousers",
        "wide trousers",
    }
    assert {r.hair.cut for r in recipes} == {"short", "bob", "long", "bun"}


def test_phenotypes_are_in_range():
    for recipe in map(recipe_for, IDS):
        assert all(0 <= value <= 1 for value in recipe.phenotype.values())

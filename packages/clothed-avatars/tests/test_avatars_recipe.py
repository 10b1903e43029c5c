"""Who is in the list, and that training never meets it."""

import copy
import json

import numpy as np
import pytest

from clothed_avatars.clothes.wardrobe import Fabric
from clothed_avatars.generator import AVATARS
from clothed_avatars.people.poses import POSES
from clothed_avatars.recipe import recipe_for, subject_ids
from clothed_avatars.subjects.written import SUBJECTS
from harness.core.errors import DataError
from harness.data.manifest import load_manifest

TRAINING = [f"t{k:05d}" for k in range(60)]


def fabrics(recipe):
    return [
        f
        for f in (recipe.top.fabric, recipe.top.inner, recipe.bottom and recipe.bottom.fabric)
        if f
    ]


def test_there_are_twenty_subjects_in_order():
    assert subject_ids() == tuple(f"a{k:02d}" for k in range(1, 21))


@pytest.mark.parametrize("subject", [*subject_ids(), *TRAINING[:5]])
def test_a_recipe_is_plain_data_and_names_a_pose(subject):
    recipe = recipe_for(subject)
    assert recipe.id == subject
    assert recipe.pose in POSES
    assert json.loads(json.dumps(recipe.as_dict()))["top"]["kind"] == recipe.top.kind
    assert all(0 <= value <= 1 for value in recipe.phenotype.values())


def test_a_recipe_travels_to_other_processes():
    recipe = recipe_for("a07")
    assert copy.deepcopy(recipe) == recipe  # by the pickle protocol, as worker processes do


def test_the_list_has_every_kind_of_garment_hair_and_most_poses():
    recipes = [recipe_for(subject) for subject in subject_ids()]
    tops = {recipe.top.kind for recipe in recipes}
    assert tops == {
        "t-shirt",
        "long-sleeved shirt",
        "loose shirt",
        "hooded sweater",
        "jacket",
        "coat",
        "dress",
    }
    bottoms = {recipe.bottom.kind for recipe in recipes if recipe.bottom}
    assert bottoms == {"straight trousers", "wide trousers", "shorts", "skirt"}
    assert {recipe.hair.style for recipe in recipes} == {
        "short",
        "curly",
        "long",
        "bun",
        "ponytail",
    }
    assert {recipe.pose for recipe in recipes} == set(POSES)


def test_training_subjects_are_drawn_from_their_id_alone():
    again = [recipe_for(subject) for subject in reversed(TRAINING)][::-1]
    first = [recipe_for(subject) for subject in TRAINING]
    assert [r.as_dict() for r in first] == [r.as_dict() for r in again]
    assert len({json.dumps(r.as_dict()["phenotype"]) for r in first}) == len(TRAINING)


def test_training_shares_no_seed_and_no_fabric_with_the_list():
    tested = [recipe_for(subject) for subject in subject_ids()]
    trained = [recipe_for(subject) for subject in TRAINING]
    assert not {r.seed for r in tested} & {r.seed for r in trained}

    def look(fabric: Fabric):
        return fabric.colour, fabric.pattern, fabric.scale

    assert not {look(f) for r in tested for f in fabrics(r)} & {
        look(f) for r in trained for f in fabrics(r)
    }
    assert max(f.scale for r in tested for f in fabrics(r)) < min(
        f.scale for r in trained for f in fabrics(r)
    )


def test_an_unknown_subject_names_the_nearest():
    with pytest.raises(DataError, match="a0"):
        recipe_for("a0x")


def test_every_subject_differs_in_shape():
    shapes = np.array([list(recipe_for(subject).phenotype.values()) for subject in SUBJECTS])
    distance = np.linalg.norm(shapes[:, None] - shapes[None], axis=2) + np.eye(len(shapes))
    assert distance.min() > 0.05


def test_the_listed_classes_are_those_of_the_generator(request):
    avatars = load_manifest(request.config.rootpath / "data_manifest.yaml").datasets["avatars"]
    assert avatars.subjects == subject_ids()
    for subject, listed in avatars.classes.items():
        recipe = recipe_for(subject)
        assert (listed.clothing, listed.pose) == (recipe.clothing, recipe.pose), subject


def test_a_subject_whose_recipe_changed_is_made_anew(tmp_path):
    recipe = json.loads(json.dumps(recipe_for("s01").as_dict()))
    for pose, current in ((recipe["pose"], True), ("another", False)):
        made = {"version": AVATARS.version, "recipe": {**recipe, "pose": pose}}
        (tmp_path / "avatar.json").write_text(json.dumps(made))
        assert AVATARS.is_current("s01", tmp_path, 0.0) is current
        assert not AVATARS.is_current("s01", tmp_path, 0.5)

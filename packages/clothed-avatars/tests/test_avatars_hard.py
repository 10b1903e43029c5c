"""People that are hard to reconstruct: bare feet, raised hoods, raised hands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from clothed_avatars import build
from clothed_avatars.checks import check_frame
from clothed_avatars.clothes.hood import raised_hood
from clothed_avatars.mesh.nearness import Nearness
from clothed_avatars.people.body import SKIN_VERTICES
from clothed_avatars.people.deformation import deformed_body
from clothed_avatars.people.landmarks import head_place, heights
from clothed_avatars.people.poses import joint_rotations
from clothed_avatars.recipe import recipe_for
from clothed_avatars.skin.paint import painters
from clothed_avatars.subjects.hard import HARD_SUBJECTS
from harness.data.manifest import load_manifest


@pytest.fixture(scope="module")
def bodies():
    """Body and posed body by id."""
    found = {}
    for name in HARD_SUBJECTS:
        recipe = recipe_for(name)
        body = deformed_body(recipe.phenotype, recipe.shape)
        found[name] = body, body.posed(joint_rotations(body, recipe.posture))
    return found


def test_the_manifest_lists_them():
    assert load_manifest(None).datasets["avatars-hard"].subjects == tuple(HARD_SUBJECTS)


def test_they_have_what_makes_them_hard(bodies):
    bare = [name for name in HARD_SUBJECTS if recipe_for(name).shoes is None]
    assert len(bare) >= 4
    assert sum(recipe_for(name).hair.style == "long" for name in HARD_SUBJECTS) >= 2
    assert sum(recipe_for(name).top.collar == "hood up" for name in HARD_SUBJECTS) >= 1
    raised = [
        name
        for name, (body, posed) in bodies.items()
        if min(posed.joints[body.bone_names.index(f"wrist.{side}")][1] for side in "LR")
        > posed.joints[body.bone_names.index("neck01")][1]
    ]
    assert len(raised) >= 2


def test_all_stand_inside_the_frame_of_the_papers_photos(bodies):
    for name, (_, posed) in bodies.items():
        check_frame(name, posed.vertices[:SKIN_VERTICES])


def test_nothing_paints_shoes_on_bare_feet(bodies):
    recipe = recipe_for("h01")
    assert "shoes" not in painters(build._appearance(recipe), bodies["h01"][0])
    assert "shoes" in painters(build._appearance(recipe_for("h05")), bodies["h05"][0])


def test_a_hood_covers_head_and_neck_and_leaves_the_face_free(bodies):
    body, _ = bodies["h02"]
    still = body.posed({})
    hood = raised_hood(body, still, 0)
    near = Nearness(hood.vertices, hood.faces)
    head = head_place(body)
    skin = body.vertices[:SKIN_VERTICES]
    of_head = body.members("head")[:SKIN_VERTICES] > 0.5
    offset = skin - head.centre
    behind = of_head & (offset[:, 2] < -0.02) & (offset[:, 1] > -0.06)
    height, _ = near.height(skin[behind])
    # Inside means below the hood, whose normals point outward.
    assert (height < 0).mean() > 0.99
    assert np.abs(height).max() < 0.08
    face = of_head & (offset[:, 2] > 0.07) & (np.abs(offset[:, 0]) < 0.03) & (offset[:, 1] < 0.02)
    points, *_ = near.closest(skin[face])
    assert np.linalg.norm(points - skin[face], axis=1).min() > 0.03
    assert hood.vertices[:, 1].min() < heights(body).neck + 0.01


def test_the_hood_is_raised_where_the_recipe_says_so(monkeypatch):
    laid = []
    monkeypatch.setattr(build, "raised_hood", lambda *_: laid.append("hood up"))
    monkeypatch.setattr(build, "collar", lambda *given: laid.append(given[2]))
    for name in ("h02", "h05"):
        recipe = replace(recipe_for(name), worn=None)
        build._around_neck(recipe, None, None)
    assert laid == ["hood up", "fold"]

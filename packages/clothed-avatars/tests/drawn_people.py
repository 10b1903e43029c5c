"""Drawn subjects as several tests ask for them."""

import functools

from clothed_avatars.people.postures import pose_distance_deg
from clothed_avatars.recipe import recipe_for

#: Drawing a subject takes up to half a second, and most tests ask for all of them.
recipe_of = functools.cache(recipe_for)


def poses(ids):
    return [recipe_of(subject).posture for subject in ids]


def least_distance(some, others):
    return min(pose_distance_deg(one, other) for one in some for other in others)


def fabrics(ids):
    recipes = [recipe_of(subject) for subject in ids]
    found = [(r.top.fabric, r.top.inner, r.bottom and r.bottom.fabric) for r in recipes]
    return [fabric for group in found for fabric in group if fabric]

"""Posed bodies are the same on every processor: the last bits of their numbers do not get out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from clothed_avatars.people import body as body_module
from clothed_avatars.people.body import AvatarBody, carry
from clothed_avatars.people.deformation import deformed_body
from clothed_avatars.recipe import recipe_for

pytestmark = pytest.mark.nightly

TURNS = {"upperarm01.L": np.array([0.1, 0.2, 0.3]), "spine03": np.array([0.05, 0.1, 0.0])}


class Shaken:
    """The body model, with its outputs off by what two processors differ by."""

    def __init__(self, model) -> None:
        self._model, self._dice = model, np.random.default_rng(0)

    def __getattr__(self, name: str):
        return getattr(self._model, name)

    def __call__(self, **inputs):
        import torch

        outputs = self._model(**inputs)
        return {
            name: values + 4e-16 * torch.from_numpy(self._dice.uniform(-1, 1, values.shape))
            for name, values in outputs.items()
        }


@pytest.fixture
def shaken(monkeypatch):
    """Bodies that are made from now on come from another processor."""
    template = body_module._template()
    other = replace(template, model=Shaken(template.model))
    return lambda: monkeypatch.setattr(body_module, "_template", lambda: other)


@pytest.mark.parametrize("subject", ["a02", "s01"])
def test_another_processor_gives_the_same_bytes(shaken, subject):
    recipe = recipe_for(subject)

    def made():
        body = deformed_body(recipe.phenotype, recipe.shape)
        posed = body.posed(TURNS)
        moved = carry(body.vertices, body.weights, posed.transforms)
        return body.vertices, posed.vertices, posed.transforms, posed.joints, moved

    here = made()
    shaken()
    there = made()
    assert all(one.tobytes() == other.tobytes() for one, other in zip(here, there, strict=True))


def test_bodies_fit_into_single_precision_with_a_rounding_that_all_share(shaken):
    """The grid is not finer than single precision within a metre, or its last bit could turn."""
    phenotype = recipe_for("a02").phenotype
    vertices = AvatarBody(phenotype).posed(TURNS).vertices
    near = vertices[np.abs(vertices) < 1]
    np.testing.assert_array_equal(near, near.astype(np.float32).astype(float))
    shaken()
    again = AvatarBody(phenotype).posed(TURNS).vertices
    assert again.astype(np.float32).tobytes() == vertices.astype(np.float32).tobytes()

"""``stereo8`` from photos to a mesh, with a body that is given."""

from __future__ import annotations

import contextlib

import numpy as np
import pytest

from harness.core.artifacts import Body, Capture, image_name
from harness.core.errors import HarnessError
from harness.core.mesh import Mesh
from harness.core.protocols import Context
from harness.geometry.images import save_png
from harness.geometry.raycast import Raycaster
from methods import stereo8 as module
from methods.body.settings import BodyFitResult
from methods.stereo8 import stereo8
from tests.spheres import icosphere
from tests.unit.methods.stereo.conftest import CAMERAS, grain, picture

AXES_M = np.array([0.12, 0.3, 0.1])
CENTRE_M = np.array([0.03, -0.02, 0.01])
#: A start that is a centimetre or two off, and photos without noise, want no long search.
QUICK = {"match.tries": "4", "match.rounds": "1"}


def egg(by_m: float = 0.0, rounds: int = 5) -> Mesh:
    """An ellipsoid off the origin."""
    ball = icosphere(1.0, rounds)
    return Mesh(ball.vertices * (AXES_M + by_m) + CENTRE_M, ball.faces, source="egg")


def off_mm(points: np.ndarray) -> np.ndarray:
    """About how far points are off the egg: exact on it, and good near it."""
    scaled = (points - CENTRE_M) / AXES_M
    length = np.linalg.norm(scaled, axis=1)
    steepness = np.linalg.norm(scaled / AXES_M, axis=1) / length
    return 1e3 * np.abs(length - 1) / steepness


@pytest.fixture
def given_body(monkeypatch):
    """A body 2 cm too thin, whose upper end is its hands."""
    thin = egg(-0.02, 4)
    body = Body("given", thin.vertices, np.zeros((1, 3)), thin.faces, {})
    hands = thin.vertices[:, 1] > 0.2

    regions = {"left_hand": hands, "right_hand": np.zeros_like(hands)}
    fit = BodyFitResult(body, tuple(range(8)), (False, False), regions)
    monkeypatch.setattr(module.BodyFit, "fit", lambda *_: fit)
    return thin


@pytest.mark.nightly
def test_the_surface_is_pulled_to_what_the_photos_show(given_body, tmp_path):
    caster, rng = Raycaster(egg()), np.random.default_rng(0)
    for view, camera in enumerate(CAMERAS):
        save_png(tmp_path / image_name(view), picture(caster, camera, grain, 0.0, rng))
    capture = Capture("toy", "egg", "r", "k", tmp_path, CAMERAS)
    context = Context(0, tmp_path, lambda _: contextlib.nullcontext(), keep=True)
    result = stereo8.configured(QUICK).reconstruct(capture, context)
    assert result.body is not None
    assert result.details["views_used"] == list(range(8))
    assert result.details["points"] > 5000
    seen = np.abs(result.mesh.vertices[:, 1] - CENTRE_M[1]) < 0.15
    error_mm = off_mm(result.mesh.vertices[seen])
    assert np.median(error_mm) < 0.5
    assert np.quantile(error_mm, 0.95) < 2.0
    assert result.mesh.signed_volume > 0
    assert (tmp_path / "start.ply").is_file()
    rounds = result.details["rounds"]
    assert len(rounds) == 4
    assert rounds[0]["believed_share"] > 0.9


def test_settings_are_by_room_and_wrong_ones_are_refused():
    configured = stereo8.configured({"match.tries": "5", "start.narrow": "off"})
    assert configured.info.parameters["match"]["tries"] == 5
    assert configured.info.parameters["start"]["narrow"] == "off"
    assert stereo8.info.parameters["match"]["tries"] == 8
    for text in ({"start.narrow": "maybe"}, {"match.trials": "5"}, {"start.voxel_m": "1"}):
        with pytest.raises(HarnessError):
            stereo8.configured(text)


def test_no_normal_network_is_a_part():
    assert {part.role for part in stereo8.info.parts} == {"body model", "landmarks"}

"""``stereo8-psr``: the same points as ``stereo8``, closed by Poisson alone."""

from __future__ import annotations

import contextlib

import numpy as np
import pytest

from harness.core.artifacts import Capture, image_name
from harness.core.errors import HarnessError
from harness.core.protocols import Context
from harness.geometry.coinciding import open_edges
from harness.geometry.images import save_png
from harness.geometry.raycast import Raycaster
from harness.run.cell_worker import SharedResults
from harness.run.cost import StageMeter
from methods.from_points.stereo8_psr import stereo8_psr
from methods.stereo import surface
from methods.stereo8 import stereo8
from tests.unit.methods.stereo.conftest import CAMERAS, grain, picture
from tests.unit.methods.stereo.test_stereo8 import (
    CENTRE_M,
    QUICK,
    egg,
    given_body,  # noqa: F401
    off_mm,
)


@pytest.mark.nightly
@pytest.mark.usefixtures("given_body")
def test_points_become_a_closed_surface_also_at_the_hands(tmp_path, monkeypatch):
    caster, rng = Raycaster(egg()), np.random.default_rng(0)
    for view, camera in enumerate(CAMERAS):
        save_png(tmp_path / image_name(view), picture(caster, camera, grain, 0.0, rng))
    capture = Capture("toy", "egg", "r", "k", tmp_path, CAMERAS)
    share = SharedResults(tmp_path / "shared", StageMeter(), lambda: True)
    context = Context(0, tmp_path, lambda _: contextlib.nullcontext(), keep=True, share=share)
    method = stereo8_psr.configured({"mesh.depth": "7", "mesh.trim": "0.1", **QUICK})
    result = method.reconstruct(capture, context)
    assert result.body is not None
    assert result.details["points"] > 5000
    seen = np.abs(result.mesh.vertices[:, 1] - CENTRE_M[1]) < 0.15
    assert np.median(off_mm(result.mesh.vertices[seen])) < 1.0
    # The upper end is the given body's hands, near which stereo8 takes no points.
    hands = result.mesh.vertices[result.mesh.vertices[:, 1] > 0.21]
    assert np.median(off_mm(hands)) < 3.0
    assert open_edges(result.mesh) > 0
    assert result.details["trimmed_area_share"] > 0
    assert {path.name for path in tmp_path.glob("*.ply")} == {"closed.ply", "trimmed.ply"}
    # Nothing is searched again for a method that asks for the same points.
    monkeypatch.setattr(surface, "stereo_points", None)
    again = method.reconstruct(capture, context).mesh
    assert again.vertices.tobytes() == result.mesh.vertices.tobytes()
    assert share.taken == ["photo points"]
    with pytest.raises(TypeError, match="NoneType"):
        stereo8.configured({**QUICK, "match.tries": "5"}).reconstruct(capture, context)


def test_settings_are_those_that_it_uses():
    own, other = stereo8_psr.info.parameters, stereo8.info.parameters
    assert set(own) == {"body", "start", "match", "keep", "mesh"}
    assert "narrow" not in own["start"]
    assert "hands_m" not in own["keep"]
    assert own["match"] == other["match"]
    changed = stereo8_psr.configured({"match.tries": "5", "mesh.trim": "0.2"}).info.parameters
    assert (changed["match"]["tries"], changed["mesh"]["trim"]) == (5, 0.2)
    for text in ({"keep.hands_m": "0"}, {"start.narrow": "off"}, {"narrow.radius": "3"}):
        with pytest.raises(HarnessError, match="unknown setting"):
            stereo8_psr.configured(text)

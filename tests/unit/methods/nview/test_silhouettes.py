"""How well a surface fills its silhouettes, and what is done where a limb was lost."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from harness.core.mesh import Mesh
from methods.closed.lattices import remeshed
from methods.nview import method as module
from methods.nview.fusion import Fused, settled
from methods.nview.method import mexecon_plus
from methods.nview.settings import FusionSettings
from methods.nview.start import silhouette_fit
from tests.unit.methods.nview.test_method import SMALL, context


def test_a_mesh_fills_its_own_silhouettes(ball, ring, views_of):
    fit = silhouette_fit(ball, views_of(ball, ring(4)), 0.002)
    assert min(fit.iou) > 0.98
    assert min(fit.covered) > 0.985


def test_a_smaller_ball_covers_its_share_of_the_disc(ball, ring, views_of):
    smaller = Mesh(0.9 * ball.vertices, ball.faces)
    fit = silhouette_fit(smaller, views_of(ball, ring(4)), 0.001)
    np.testing.assert_allclose(fit.covered, 0.81, atol=0.01)
    np.testing.assert_allclose(fit.iou, fit.covered, atol=1e-9)
    whole = silhouette_fit(ball, views_of(ball, ring(4)), 0.001)
    assert fit.lost_since(whole) == pytest.approx(0.19, abs=0.015)
    assert whole.lost_since(fit) == 0.0


def test_settling_brings_a_shrunken_surface_back_to_its_outlines(ball, ring, views_of):
    views = views_of(ball, ring(8))
    shrunken = Mesh(ball.vertices * 0.99, ball.faces)
    before = silhouette_fit(shrunken, views, 0.001)
    mesh = settled(shrunken, views, FusionSettings(body="off"))
    after = silhouette_fit(mesh, views, 0.001)
    # Pixels of a millimetre that the rim crosses count as missed: that is 0.991 of an exact ball.
    assert np.mean(before.iou) < 0.983
    assert np.mean(after.iou) > 0.990
    assert np.linalg.norm(mesh.vertices, axis=1).max() < 0.2005


def test_settling_takes_ripples_off(ball, ring, views_of):
    rng = np.random.default_rng(0)
    even = remeshed(ball, 0.006)
    jitter = 1 + 0.001 * rng.standard_normal((len(even.vertices), 1))
    rough = Mesh(even.vertices * jitter, even.faces)
    smooth = settled(rough, views_of(ball, ring(8)), FusionSettings(body="off"))
    assert _normals_off_deg(smooth) < 0.6 * _normals_off_deg(rough)


def _normals_off_deg(mesh: Mesh) -> float:
    """Mean angle between a ball's face normals and the directions from its middle."""
    middles = mesh.vertices[mesh.faces].mean(axis=1)
    outward = middles / np.linalg.norm(middles, axis=1, keepdims=True)
    normals = mesh.face_normals()
    cosine = np.einsum("ij,ij->i", outward, normals) / np.linalg.norm(normals, axis=1)
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))).mean())


@pytest.mark.parametrize(("hull_loses", "from_hull"), [(0.0, True), (0.3, False)])
def test_a_lost_limb_is_looked_for_from_the_hull(
    ball, ring, views_of, tmp_path, monkeypatch, hull_loses, from_hull
):
    """The first start loses 19 % of the silhouettes; the hull's way is taken if it loses less."""
    views = views_of(ball, ring(4))
    method = mexecon_plus.configured(SMALL)
    scales = iter((0.9, np.sqrt(1 - hull_loses)))
    monkeypatch.setattr(module, "clothed", lambda shape, _: shape)
    monkeypatch.setattr(module, "start_surface", lambda *_: ball)
    monkeypatch.setattr(
        module,
        "fused_surface",
        lambda start, *_: Fused(replace(start, vertices=next(scales) * start.vertices), ()),
    )
    _, fused = method._fused(views, ball, context(tmp_path))
    assert fused.from_hull is from_hull
    assert fused.details()["from_hull"] is from_hull
    assert next(scales, None) is None

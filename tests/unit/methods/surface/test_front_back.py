"""A two-sided ellipsoid in closed form, and what each term of the joint integration does."""

from __future__ import annotations

import numpy as np
import pytest

from harness.core.errors import DataError
from methods.surface import BodyDepth, FrontBackParameters, integrate_front_back

SIZE = 256
EXACT = FrontBackParameters(thickness=0.0)


@pytest.fixture
def scene(camera_matrix, ellipsoid):
    """Build K, near and far side, in metres (perspective) or pixels (orthographic)."""

    def build(perspective: bool, size: int = SIZE):
        K = camera_matrix(size, 2.0) if perspective else None
        centre, radii = (
            ((0.0, 0.05, 3.0), (0.5, 0.62, 0.3))
            if perspective
            else ((size / 2, size / 2, 0), (0.35 * size, 0.45 * size, 0.2 * size))
        )
        return K, *ellipsoid(size, centre, radii, K)

    return build


@pytest.mark.parametrize("perspective", [False, True])
def test_two_sided_ellipsoid(perspective, scene) -> None:
    K, near, far = scene(perspective)
    prior = BodyDepth(near.depth, far.depth)
    result = integrate_front_back((near.normals, far.normals), near.mask, prior, K, EXACT)
    length = 2 * (0.62 if perspective else 0.45 * SIZE)
    # The rims are where depth jumps: there one pixel is several pixels deep.
    inner = (near.facing > 0.5) & (far.facing > 0.5)
    assert inner.sum() > 0.7 * near.mask.sum()
    assert np.abs(result.front - near.depth)[inner].max() < 1e-3 * length
    assert np.abs(result.back - far.depth)[inner].max() < 1e-3 * length


@pytest.mark.parametrize("perspective", [False, True])
def test_crossed_pixels_leave_both_sheets(perspective, scene) -> None:
    K, near, far = scene(perspective, 96)
    # A body turned inside out on its left half.
    swap = np.arange(96) < 40
    prior = BodyDepth(np.where(swap, far.depth, near.depth), np.where(swap, near.depth, far.depth))
    strong = {"thickness": 0.0, "prior_weight": 10.0}
    pair = (near.normals, far.normals)
    kept = integrate_front_back(
        pair, near.mask, prior, K, FrontBackParameters(cut_intersection=False, **strong)
    )
    cut = integrate_front_back(pair, near.mask, prior, K, FrontBackParameters(**strong))
    crossed = near.mask & (kept.front >= kept.back)
    assert kept.pixels_cut == 0
    assert cut.pixels_cut == crossed.sum() > 1000
    for sheet, whole in ((cut.front, kept.front), (cut.back, kept.back)):
        np.testing.assert_array_equal(np.isnan(sheet), ~near.mask | crossed)
        np.testing.assert_array_equal(sheet[near.mask & ~crossed], whole[near.mask & ~crossed])


@pytest.mark.parametrize("perspective", [False, True])
def test_thickness_moves_the_sheets_apart(perspective, scene) -> None:
    K, near, far = scene(perspective, 96)
    prior = BodyDepth(near.depth, far.depth)
    thick = FrontBackParameters(thickness=0.05, silhouette_weight=0.0)
    result = integrate_front_back((near.normals, far.normals), near.mask, prior, K, thick)
    inner = (near.facing > 0.5) & (far.facing > 0.5)
    moved = 0.05 if perspective else 0.05 * 256
    # In perspective, moving a surface towards the camera scales it, which the prior resists.
    assert (near.depth - result.front)[inner].mean() == pytest.approx(moved, rel=0.1)
    assert (result.back - far.depth)[inner].mean() == pytest.approx(moved, rel=0.1)


def test_silhouette_weight_closes_the_gap(scene) -> None:
    K, near, far = scene(True, 96)
    prior = BodyDepth(near.depth, far.depth)
    rim = near.mask & (near.facing < 0.2)

    def gap(weight: float) -> float:
        parameters = FrontBackParameters(silhouette_weight=weight, cut_intersection=False)
        result = integrate_front_back((near.normals, far.normals), near.mask, prior, K, parameters)
        return float(np.abs(result.back - result.front)[rim].mean())

    assert gap(1.0) < 0.5 * gap(0.0)


def test_parts_without_body_ride_on_the_sheet(scene) -> None:
    """A prior on a quarter of the mask is enough to place the whole."""
    K, near, far = scene(True, 128)
    known = np.zeros_like(near.mask)
    known[:64, :64] = True
    prior = BodyDepth(np.where(known, near.depth, np.nan), np.where(known, far.depth, np.nan))
    result = integrate_front_back((near.normals, far.normals), near.mask, prior, K, EXACT)
    inner = (near.facing > 0.5) & (far.facing > 0.5)
    assert np.abs(result.front - near.depth)[inner].max() < 5e-3
    assert np.abs(result.back - far.depth)[inner].max() < 5e-3


def test_weights_follow_the_resolution(scene) -> None:
    """A wrong body bends the surface equally at any number of pixels."""

    def pull(size: int) -> float:
        K, near, far = scene(True, size)
        wrong = BodyDepth(np.full(near.mask.shape, 2.8), np.full(near.mask.shape, 3.2))
        parameters = FrontBackParameters(thickness=0.0, prior_weight=1e-2)
        result = integrate_front_back((near.normals, far.normals), near.mask, wrong, K, parameters)
        inner = near.facing > 0.5
        return float((result.front - near.depth)[inner].std())

    assert pull(192) == pytest.approx(pull(96), rel=0.1)


@pytest.mark.parametrize(
    ("front", "back", "words"),
    [
        (np.full((4, 4), 2.0), np.full((8, 8), 3.0), "front depth does not match"),
        (np.full((8, 8), 2.0), np.full((8, 8), np.nan), "back depth has no pixel inside"),
        (np.full((8, 8), 0.01), np.full((8, 8), 3.0), "not in front of the camera"),
    ],
)
def test_a_body_that_cannot_guide_is_said(front, back, words) -> None:
    normals = np.broadcast_to([0.0, 0.0, 1.0], (8, 8, 3))
    K = np.array([[10.0, 0, 4], [0, 10.0, 4], [0, 0, 1]])
    with pytest.raises(DataError, match=words):
        integrate_front_back(
            (normals, -normals), np.ones((8, 8), dtype=bool), BodyDepth(front, back), K
        )


def test_back_normals_are_checked_by_name() -> None:
    normals = np.broadcast_to([0.0, 0.0, 1.0], (8, 8, 3))
    body = BodyDepth(np.full((8, 8), 2.0), np.full((8, 8), 3.0))
    with pytest.raises(DataError, match="back normal map has 64 pixels"):
        integrate_front_back((normals, normals * 0.5), np.ones((8, 8), dtype=bool), body)


@pytest.mark.parametrize("wrong", [{"k": 0.0}, {"thickness": -0.1}, {"max_iter": 0}])
def test_parameters_are_checked(wrong) -> None:
    with pytest.raises(DataError, match="cannot be integrated with these parameters"):
        FrontBackParameters(**wrong)


def test_published_defaults() -> None:
    defaults = FrontBackParameters()
    assert (defaults.k, defaults.prior_weight, defaults.silhouette_weight) == (4.0, 1e-4, 1e-6)
    assert (defaults.thickness, defaults.max_iter, defaults.tol) == (0.02, 150, 1e-4)


@pytest.mark.parametrize("device", ["cpu:0", "cuda"])
def test_every_device_gives_the_same_sheets(device, scene) -> None:
    """``cpu:0`` is torch's own processor: the code path of a GPU, on every machine."""
    import torch

    if device == "cuda" and not torch.cuda.is_available():
        pytest.skip("this machine has no GPU")
    K, near, far = scene(True, 96)
    pair, prior = (near.normals, far.normals), BodyDepth(near.depth, far.depth)
    ours = integrate_front_back(pair, near.mask, prior, K)
    theirs = integrate_front_back(pair, near.mask, prior, K, device=device)
    # Both solvers end at a residual of a thousandth, by paths of other rounding. Away from the rim
    # they differ by 0.1 mm at most; at the rim, which hangs on few equations, by up to 5 mm.
    inner = (near.facing > 0.5) & (far.facing > 0.5)
    for own, other in ((ours.front, theirs.front), (ours.back, theirs.back)):
        np.testing.assert_array_equal(np.isnan(own), np.isnan(other))
        np.testing.assert_allclose(own[inner], other[inner], atol=2e-4)
        np.testing.assert_allclose(own, other, atol=1e-2)

"""The proof accepts exact pictures and refuses shifted, mirrored, swollen and empty ones."""

from dataclasses import replace

import numpy as np
import pytest

from harness.core.artifacts import image_name
from harness.core.errors import DataError, MethodError
from harness.core.process.threads import silent
from harness.geometry.images import load_rgba, save_png
from harness.geometry.raycast import Raycaster
from renderers.proof import (
    ViewProof,
    _contour_distances,
    _covered,
    cut_warnings,
    prove,
    require_proof,
)
from renderers.raycast import RaycastRenderer


@pytest.fixture
def pictures(figure, recipe, tmp_path):
    RaycastRenderer().render(figure, recipe, tmp_path, silent)
    return tmp_path


def change(pictures, edit):
    for view in range(3):
        path = pictures / image_name(view)
        save_png(path, np.ascontiguousarray(edit(load_rgba(path))))


def test_exact_pictures_pass(figure, recipe, pictures):
    proofs = prove(figure, recipe.cameras(), pictures)
    require_proof(proofs, 0.999, "figure")
    for proof in proofs:
        assert proof.mask_iou > 0.999
        assert proof.outline_vertices > 50
        assert proof.reprojection_mean_px < 0.15
        assert proof.reprojection_p95_px < 0.5
        assert not proof.cut


@pytest.mark.parametrize("shift", [(2, 0), (0, 2)])
def test_cameras_that_are_two_pixels_off_fail(figure, recipe, pictures, shift):
    moved = [camera.cropped(*shift, camera.width, camera.height) for camera in recipe.cameras()]
    proofs = prove(figure, moved, pictures)
    assert all(proof.reprojection_mean_px > 0.6 for proof in proofs)
    with pytest.raises(MethodError, match=r"fails its proof.*at least 0\.98.*view 0: 0\.[89]"):
        require_proof(proofs, recipe.minimum_mask_iou, "figure")


@pytest.mark.parametrize(
    "edit",
    [
        pytest.param(lambda rgba: rgba[:, ::-1], id="mirrored"),
        pytest.param(lambda rgba: np.maximum(rgba, np.roll(rgba, 3, 0)), id="swollen"),
        pytest.param(np.zeros_like, id="empty"),
    ],
)
def test_other_pictures_fail(figure, recipe, pictures, edit):
    change(pictures, edit)
    with pytest.raises(MethodError, match="fails its proof"):
        require_proof(prove(figure, recipe.cameras(), pictures), 0.98, "figure")


def test_covered_pixels_are_those_of_nine_rays_each(figure, recipe):
    wide = figure.transformed(np.diag([2.5, 1.0, 1.0, 1.0]))  # the frame cuts it, too
    for mesh in (figure, wide):
        caster = Raycaster(mesh)
        for camera in recipe.cameras():
            covered = caster.coverage(camera, supersample=3) > 0.5
            assert 0.02 < covered.mean() < 0.98
            np.testing.assert_array_equal(_covered(caster, camera), covered)


def test_an_empty_picture_of_nothing_is_no_proof(figure, recipe, pictures):
    change(pictures, np.zeros_like)
    away = np.eye(4)
    away[1, 3] = 10.0
    (proof, *_) = prove(figure.transformed(away), recipe.cameras(), pictures)
    assert (proof.mask_iou, proof.reprojection_mean_px, proof.outline_vertices) == (0.0, None, 0)


def test_a_picture_of_another_size_is_refused(figure, recipe, pictures):
    with pytest.raises(DataError, match="another size than its camera"):
        prove(figure, replace(recipe, width=110).cameras(), pictures)


def test_a_subject_cut_by_the_frame_is_named(figure, recipe, tmp_path):
    wide = figure.transformed(np.diag([2.5, 1.0, 1.0, 1.0]))  # 1.5 m wide, in a 1.2 m frame
    RaycastRenderer().render(wide, recipe, tmp_path, silent)
    proofs = prove(wide, recipe.cameras(), tmp_path)
    require_proof(proofs, 0.99, "figure")
    assert [proof.cut for proof in proofs] == [True, False, False]
    assert cut_warnings(proofs) == ("the frame cuts the subject in view 0",)
    both = (replace(proofs[0], view=3), replace(proofs[0], view=7))
    assert cut_warnings(both) == ("the frame cuts the subject in views 3, 7",)
    assert cut_warnings([ViewProof(0, 1.0, None, None, 0, cut=False)]) == ()


def test_contour_distance_of_a_half_plane_is_the_closed_form():
    # Coverage 1 left of x = 10.25: the pixel from 10 to 11 is covered by a quarter.
    alpha = np.zeros((30, 20))
    alpha[:, :10], alpha[:, 10] = 1.0, 0.25
    points = np.array([[10.0, 15.0], [12.3, 15.7], [7.1, 3.3]])
    # Marching squares puts the step at 0.5 between the centres at 9.5 (1) and 10.5 (0.25).
    edge = 9.5 + 0.5 / 0.75
    assert _contour_distances(alpha, points) == pytest.approx(np.abs(points[:, 0] - edge))

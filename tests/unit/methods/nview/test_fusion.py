"""The whole fusion on shapes with known surfaces."""

from __future__ import annotations

import numpy as np
import pytest

from harness.core.errors import MethodError
from harness.core.mesh import Mesh
from harness.core.rigs import RingRig
from harness.geometry.coinciding import open_edges
from harness.geometry.raycast import Raycaster
from methods.closed.lattices import Lattice, winding
from methods.closed.surfaces import Surface
from methods.nview.fusion import fused_surface, moved_once
from methods.nview.settings import FusionSettings
from methods.nview.start import start_surface
from methods.nview.views import NormalTargets, checked_views, fusion_view

RADIUS = 0.2
#: As coarse as the bounds below allow: the time is in the number of faces and of pixels.
COARSE = FusionSettings(voxel_m=0.02, body="off")
#: Fine enough that a surface that ignores the normals misses the bounds.
FINER = FusionSettings(voxel_m=0.012, body="off")


@pytest.fixture(scope="module")
def half_ring(ring):
    """``half_ring(views)``: as ``ring``, with pixels of 4 mm."""
    return lambda views=8: tuple(each.resized(180, 240) for each in ring(views))


def fused(views, settings=COARSE):
    views = checked_views(views)
    start = start_surface(views, settings.voxel_m, None, settings.margin_m)
    return start, fused_surface(start, views, settings).mesh


def assert_sound(mesh: Mesh, views) -> None:
    """Watertight, one piece, outward, and nowhere outside an outline by more than 3 mm.

    The cut is at 2 mm; vertices are spread along the surface after it.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    assert open_edges(mesh) == 0
    assert mesh.signed_volume > 0
    first, second = mesh.faces[:, (0, 1)].ravel(), mesh.faces[:, (1, 2)].ravel()
    joined = coo_array((np.ones(len(first)), (first, second)), shape=(len(mesh.vertices),) * 2)
    assert connected_components(joined, directed=False)[0] == 1
    for view in views:
        assert view.outline.distances_m(mesh.vertices).min() > -0.003


def off_sphere_mm(mesh: Mesh, radius: float = RADIUS) -> np.ndarray:
    return 1000 * np.abs(np.linalg.norm(mesh.vertices, axis=1) - radius)


def normal_error_deg(mesh: Mesh, normals: np.ndarray) -> float:
    """Mean over the surface of the angle between faces and known normals (F, 3)."""
    vectors = mesh.face_normals()
    area = np.linalg.norm(vectors, axis=1)
    cosine = np.einsum("ij,ij->i", vectors, normals) / area
    angle = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    return float((angle * area).sum() / area.sum())


def radial(points: np.ndarray) -> np.ndarray:
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def genus(mesh: Mesh) -> int:
    pairs = mesh.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    edges = np.unique(np.sort(pairs, axis=1), axis=0)
    return 1 - (len(mesh.vertices) - len(edges) + len(mesh.faces)) // 2


def test_a_sphere_is_found_from_its_outlines_and_normals(ball, ring, views_of):
    views = views_of(ball, ring())
    start, mesh = fused(views, FINER)
    assert_sound(mesh, views)
    # The hull's corners stand out by up to 1 / cos(360 / 32) - 1 = 2 % of the radius, and its
    # poles, where no camera looks along the surface, by more.
    assert off_sphere_mm(start).max() > 4.0
    assert off_sphere_mm(mesh).mean() < 0.4
    assert off_sphere_mm(mesh).max() < 2.0
    assert normal_error_deg(mesh, radial(mesh.vertices[mesh.faces].mean(axis=1))) < 1.0


@pytest.mark.nightly
def test_equal_input_gives_equal_output(ball, half_ring, views_of):
    once, again = (fused(views_of(ball, half_ring(4)))[1] for _ in range(2))
    np.testing.assert_array_equal(once.vertices, again.vertices)
    np.testing.assert_array_equal(once.faces, again.faces)


@pytest.mark.nightly
def test_an_ellipsoid_is_found(shape, half_ring, views_of):
    radii = np.array([0.2, 0.3, 0.12])
    mesh = shape(lambda p: (1 - np.linalg.norm(p / radii, axis=1)) * radii.min(), 0.32, 0.006)
    views = views_of(mesh, half_ring())
    _, found = fused(views, FINER)
    assert_sound(found, views)
    # To first order the distance to the surface is that of the level function over its slope.
    level = np.linalg.norm(found.vertices / radii, axis=1)
    slope = np.linalg.norm(found.vertices / radii**2, axis=1) / level
    off_mm = 1000 * np.abs(level - 1) / slope
    assert off_mm.mean() < 0.5
    exact = radial(found.vertices[found.faces].mean(axis=1) / radii**2)
    assert normal_error_deg(found, exact) < 1.5


@pytest.mark.nightly
def test_folds_that_no_outline_shows_appear(shape, ring, views_of):
    """Flutes of 2 cm around a post of 7 cm, 4 mm deep: slopes of 32 degrees.

    Every outline runs along the tops, so that the surface settles 3 mm outside the mean, where the
    maps of neighbouring views are that much out of step: half of the depth is found.
    """
    around, radius, amplitude, half = 22, 0.07, 0.002, 0.025

    def post(points):
        inward = radius - np.hypot(points[:, 0], points[:, 2])
        angle = np.arctan2(points[:, 0], points[:, 2])
        return np.minimum(inward + amplitude * np.cos(around * angle), half - np.abs(points[:, 1]))

    views = views_of(shape(post, 0.08, 0.0025), ring())
    start, mesh = fused(views, FusionSettings(voxel_m=0.004, body="off"))
    assert_sound(mesh, views)

    def recovered(surface):
        """Share of the flutes' amplitude, by the Fourier series of the radius over the angle."""
        angle = 2 * np.pi * np.arange(16 * around) / (16 * around)
        outward = np.stack([np.sin(angle), np.zeros_like(angle), np.cos(angle)], axis=1)
        heights = np.linspace(-half / 2, half / 2, 9)
        origins = np.repeat(heights, len(angle))[:, None] * np.array([[0.0, 1.0, 0.0]])
        met = Raycaster(surface).answer(origins, np.tile(outward, (9, 1)))["t_hit"].numpy()
        profile = met.reshape(9, -1).mean(axis=0)
        return 2 * np.abs(np.fft.rfft(profile)[around]) / len(angle) / amplitude

    assert recovered(start) < 0.05
    assert 0.4 < recovered(mesh) < 1.1


@pytest.mark.nightly
def test_a_hole_stays_a_hole(shape, ring, views_of):
    def torus(points):
        around = np.hypot(points[:, 0], points[:, 1]) - 0.16
        return 0.06 - np.hypot(around, points[:, 2])

    views = views_of(shape(torus, 0.24, 0.005), ring())
    _, mesh = fused(views, FINER)
    assert_sound(mesh, views)
    assert genus(mesh) == 1
    around = np.hypot(mesh.vertices[:, 0], mesh.vertices[:, 1]) - 0.16
    off_mm = 1000 * np.abs(np.hypot(around, mesh.vertices[:, 2]) - 0.06)
    assert off_mm.mean() < 1.0


@pytest.fixture(scope="module")
def legs(shape) -> Mesh:
    """Two legs under a trunk, 3 cm apart, their gap between the directions of eight cameras."""
    turn = np.radians(22.5)
    across = np.array([np.cos(turn), 0.0, -np.sin(turn)])
    along = np.array([np.sin(turn), 0.0, np.cos(turn)])

    def inside(points):
        sides, deep = points @ across, points @ along
        leg = 0.06 * (1 - np.hypot((np.abs(sides) - 0.075) / 0.06, deep / 0.12))
        leg = np.minimum(leg, 0.2 - np.abs(points[:, 1]))
        top = 0.2 - np.linalg.norm((points - [0, 0.25, 0]) / [1.0, 0.6, 1.0], axis=1)
        return np.maximum(leg, top)

    return shape(inside, 0.38, 0.006)


GAP = Lattice(np.array([0.0, -0.15, 0.0]), 0.02, (1, 9, 1))


@pytest.mark.nightly
def test_a_body_keeps_limbs_apart_whose_gap_no_outline_shows(legs, half_ring, views_of):
    views = views_of(legs, half_ring())
    settings = FusionSettings(voxel_m=0.01, margin_m=0.01)
    start = start_surface(views, settings.voxel_m, legs, settings.margin_m)
    mesh = fused_surface(start, views, settings).mesh
    assert_sound(mesh, views)
    assert not winding(mesh, GAP).any()


def test_limbs_that_the_hull_joins_are_told(legs, ball, half_ring, views_of):
    """Without a body the gap stays filled, and the report says that the views contradict it."""
    settings = FusionSettings(voxel_m=0.015, body="off", rounds=1)

    def contradicted(mesh):
        views = views_of(mesh, half_ring())
        start = start_surface(views, settings.voxel_m, None, settings.margin_m)
        return winding(start, GAP).all(), moved_once(Surface(start), views, settings, 0)[1]

    joined, report = contradicted(legs)
    assert joined
    assert report.contradicted > 0.04
    assert contradicted(ball)[1].contradicted < 0.01


@pytest.mark.nightly
@pytest.mark.parametrize("count", [3, 4, 5, 16])
def test_any_number_of_views_will_do(count, ball, half_ring, views_of):
    views = views_of(ball, half_ring(count))
    # With many views the outlines alone are near the ball, and nearer on a coarse grid.
    _, mesh = fused(views, FINER if count > 5 else COARSE)
    assert_sound(mesh, views)
    # Three views leave a ring of the surface to two oblique ones.
    assert off_sphere_mm(mesh).mean() < (3.0 if count == 3 else 1.0)


@pytest.mark.nightly
def test_64_views_will_do(ball, ring, views_of):
    views = views_of(ball, [camera.resized(180, 240) for camera in ring(64)])
    _, mesh = fused(views, FINER)
    assert_sound(mesh, views)
    assert off_sphere_mm(mesh).mean() < 0.4


@pytest.mark.nightly
def test_views_may_be_uneven_pitched_and_of_different_sizes(ball, views_of):
    cameras = [
        RingRig(1, 1.2 + 0.1 * index, pitch, first_yaw_deg=yaw).cameras(120 + 20 * index, 240)[0]
        for index, (yaw, pitch) in enumerate(((0, 20), (50, -15), (110, 35), (200, 0), (290, 60)))
    ]
    views = views_of(ball, cameras)
    _, mesh = fused(views)
    assert_sound(mesh, views)
    assert off_sphere_mm(mesh).mean() < 1.0


@pytest.mark.nightly
def test_a_view_that_the_frame_cuts_does_not_carve(ball, half_ring, views_of):
    cameras = list(half_ring())
    left = cameras[2]
    cameras[2] = left.cropped(90, 0, 60, 240)  # half of the ball, and no outline on that side
    views = views_of(ball, cameras)
    _, mesh = fused(views)
    assert_sound(mesh, views)
    assert off_sphere_mm(mesh).mean() < 0.5


@pytest.mark.nightly
def test_masks_may_be_two_pixels_off(ball, ring, views_of):
    from scipy.ndimage import binary_dilation, binary_erosion

    def wrong(index, share):
        change = binary_erosion if index % 2 else binary_dilation
        return change(share > 0.5, iterations=2).astype(float)

    views = views_of(ball, ring(), coverage=wrong)
    _, mesh = fused(views)
    assert_sound(mesh, views)
    # Two pixels are 4.5 mm; the eroded masks decide.
    assert off_sphere_mm(mesh).mean() < 5.0
    # Squeezed by 4.5 mm from every other of eight sides, a ball has slopes of twice that over
    # an eighth of its circumference, 157 mm: 3 degrees, and more at the poles.
    assert normal_error_deg(mesh, radial(mesh.vertices[mesh.faces].mean(axis=1))) < 5.0


def test_weights_tell_which_normals_to_leave(ball, half_ring, views_of):
    """One view's normals are nonsense, and its weights say so."""
    views = views_of(ball, half_ring())
    given = views[0].targets
    shown = given.normals_world.any(axis=2)
    wrong = np.array([0.0, 0.6, -0.8]) @ views[0].camera.rotation
    maps = np.where(shown[..., None], wrong, 0).astype(np.float32)
    nothing = np.zeros(shown.shape, dtype=np.float32)
    distrusted = views[0].with_targets(NormalTargets(given.camera, maps, nothing))
    _, mesh = fused([distrusted, *views[1:]])
    assert off_sphere_mm(mesh).mean() < 0.6


@pytest.mark.nightly
def test_outlines_alone_give_the_hull_smoothed(ball, half_ring, views_of):
    views = [view.with_targets(None) for view in views_of(ball, half_ring())]
    _, mesh = fused(views)
    assert_sound(mesh, views)
    assert off_sphere_mm(mesh).mean() < 4.0


@pytest.mark.parametrize(
    ("bad", "said"),
    [
        ("two views", "from so many views"),
        ("one place", "from enough places"),
        ("contradictory masks", "inside the outlines of all views|no common volume"),
        ("partly contradictory masks", "contradict each other"),
        ("flipped normals", "point away from its camera"),
        ("mirrored normals", "mirrored from left to right"),
    ],
)
def test_bad_input_ends_in_a_sentence(bad, said, ball, half_ring, views_of):
    cameras = half_ring()
    views = views_of(ball, cameras)
    if bad == "two views":
        views = views[:2]
    elif bad == "one place":
        views = [views[0]] * 8
    elif bad == "contradictory masks":
        moved = Mesh(ball.vertices + np.array([0.0, 0.41, 0.0]), ball.faces)
        views[3] = views_of(moved, cameras)[3]
    elif bad == "partly contradictory masks":
        moved = Mesh(ball.vertices + np.array([0.0, 0.2, 0.0]), ball.faces)
        views[3] = views_of(moved, cameras)[3]
    elif bad == "flipped normals":
        views = views_of(ball, cameras, normals=lambda maps: -maps)
    else:
        # In each camera's own axes left and right are exchanged.
        views = [
            view.with_targets(
                NormalTargets(
                    view.camera,
                    (
                        view.targets.normals_world
                        @ view.camera.rotation.T
                        @ np.diag([-1.0, 1.0, 1.0])
                        @ view.camera.rotation
                    ).astype(np.float32),
                )
            )
            for view in views
        ]
    with pytest.raises(MethodError, match=said) as error:
        fused(views)
    assert "\n" not in str(error.value)


def test_cameras_in_the_wrong_order_are_refused(shape, half_ring, views_of):
    """Photos that were taken clockwise, with cameras that go the other way round."""

    def figure(points):
        trunk = 0.06 - np.linalg.norm(points * [1.0, 0.4, 1.0], axis=1)
        arm = 0.03 - np.hypot(points[:, 1] - 0.08, points[:, 2] - 0.4 * points[:, 0])
        arm = np.minimum(arm, 0.15 - np.abs(points[:, 0] - 0.15))
        return np.maximum(trunk, arm)

    mesh = shape(figure, 0.33, 0.006)
    taken = half_ring()
    caster = Raycaster(mesh)
    views = []
    for index, camera in enumerate(taken):
        believed = taken[-index % len(taken)]
        turned = caster.normals(camera, frame="world") @ camera.rotation.T @ believed.rotation
        targets = NormalTargets(believed, turned.astype(np.float32))
        views.append(fusion_view(index, believed, caster.coverage(camera), targets))
    with pytest.raises(MethodError, match="contradict each other|no common volume|mirrored"):
        fused(views)

"""Rays against closed forms: a sphere, a tilted plane and boxes at known places."""

import numpy as np
import pytest

from harness.core.camera import Camera, look_at
from harness.core.mesh import Mesh
from harness.core.rigs import RingRig
from harness.geometry.raycast import Raycaster
from harness.geometry.window import Window, is_cut

BOX_FACES = np.array(
    [
        [0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7], [0, 1, 5], [0, 5, 4],
        [2, 3, 7], [2, 7, 6], [1, 2, 6], [1, 6, 5], [0, 4, 7], [0, 7, 3],
    ]
)  # fmt: skip


def sphere(radius=0.4, centre=(0, 0, 0), rings=200, sectors=400):
    """A UV sphere; its vertices lie on the true sphere."""
    theta, phi = np.meshgrid(
        np.linspace(0, np.pi, rings + 1), np.linspace(0, 2 * np.pi, sectors + 1), indexing="ij"
    )
    points = np.stack([np.sin(theta) * np.sin(phi), np.cos(theta), np.sin(theta) * np.cos(phi)], -1)
    index = np.arange(points[..., 0].size).reshape(theta.shape)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)]).reshape(-1, 3)
    return Mesh(points.reshape(-1, 3) * radius + np.asarray(centre), faces, source="sphere")


def box(low, high):
    low, high = np.asarray(low, float), np.asarray(high, float)
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    corners = np.column_stack([np.tile(square, (2, 1)), np.repeat([0, 1], 4)])
    return Mesh(low + corners * (high - low), BOX_FACES, source="box")


def front(width=120, height=200, distance=3.0, target=(0, 0, 0)):
    focal = 50 / 36 * height
    K = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1.0]])
    position = np.add(target, (0, 0, distance))
    return Camera(K, look_at(position, target), width, height)


def sphere_depth(camera, radius, centre=(0, 0, 0)):
    """(H, W) depth of a perfect sphere: the nearer root of a quadratic, NaN where it misses."""
    pixels = camera.pixel_centres().reshape(-1, 2)
    directions = camera.ray_directions(pixels)
    offset = camera.position - np.asarray(centre, float)
    a = (directions**2).sum(1)
    b = directions @ offset
    with np.errstate(invalid="ignore"):
        depth = (-b - np.sqrt(b**2 - a * (offset @ offset - radius**2))) / a
    return depth.reshape(camera.height, camera.width)


@pytest.mark.parametrize("pitch_deg", [0.0, 25.0])
@pytest.mark.parametrize("centre", [(0, 0, 0), (0.1, -0.2, 0.05), (200.0, 100.0, -50.0)])
def test_depth_of_a_sphere_is_its_closed_form(pitch_deg, centre):
    # The last centre is far from the origin: float32 rays must not lose it.
    rig = RingRig(views=3, pitch_deg=pitch_deg)
    caster = Raycaster(sphere(0.4, centre))
    move = np.eye(4)
    move[:3, 3] = centre
    for camera in rig.cameras(120, 200):
        camera = camera.in_frame(move)
        depth, truth = caster.depth(camera), sphere_depth(camera, 0.4, centre)
        both = np.isfinite(depth) & np.isfinite(truth)
        assert both.sum() > 3000
        assert (np.isfinite(depth) != np.isfinite(truth)).sum() <= 4  # facets on the very rim
        inner = both & (truth < np.nanmin(truth) + 0.2)
        assert np.abs(depth - truth)[inner].max() < 2e-4


def test_projected_radius_of_a_sphere():
    # A sphere of radius r at distance d has the outline of half angle asin(r / d).
    camera = front()
    mask = Raycaster(sphere(0.4)).coverage(camera, supersample=8)
    radius_px = camera.K[0, 0] * np.tan(np.arcsin(0.4 / 3.0))
    assert np.sqrt(mask.sum() / np.pi) == pytest.approx(radius_px, abs=0.02)
    centroid = (camera.pixel_centres() * mask[..., None]).sum((0, 1)) / mask.sum()
    assert centroid == pytest.approx([60.0, 100.0], abs=0.01)


def test_mask_of_a_box_ends_at_the_projected_edges():
    # The front face of the box is 0.6 x 1.0 m at depth 2.5 m.
    camera = front()
    mask = Raycaster(box((-0.3, -0.5, -0.5), (0.3, 0.5, 0.5))).mask(camera)
    pixels, _ = camera.project([(-0.3, 0.5, 0.5), (0.3, -0.5, 0.5)])
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    assert [columns[0], rows[0]] == list(np.ceil(pixels[0] - 0.5))
    assert [columns[-1], rows[-1]] == list(np.floor(pixels[1] - 0.5))


def test_coverage_of_half_covered_pixels():
    # A box whose left edge runs through the middle of a column of pixels covers it by half.
    camera = front()
    x = camera.unproject([(50.5, 100.0)], [2.5])[0, 0]
    coverage = Raycaster(box((x, -0.3, 0.4), (0.2, 0.3, 0.5))).coverage(camera, supersample=4)
    assert coverage[100, 49:52] == pytest.approx([0.0, 0.5, 1.0])


def test_unprojected_depth_lies_on_the_surface():
    camera = RingRig(pitch_deg=15).cameras(90, 160)[3]
    mesh = box((-0.3, -0.5, -0.2), (0.3, 0.5, 0.2))
    depth = Raycaster(mesh).depth(camera)
    met = np.isfinite(depth)
    points = camera.unproject(camera.pixel_centres()[met], depth[met])
    excess = np.abs(points) - [0.3, 0.5, 0.2]
    assert np.abs(excess.max(axis=1)).max() < 2e-6


def test_normals_in_both_frames():
    mesh = sphere(0.4)
    caster = Raycaster(mesh)
    for view, camera in enumerate(RingRig(views=4, pitch_deg=20).cameras(120, 200)):
        hits = caster.cast(camera)
        points = camera.unproject(camera.pixel_centres()[hits.mask], hits.depth[hits.mask])
        in_world = caster.normals(camera, frame="world")
        assert np.abs(in_world[hits.mask] - points / 0.4).max() < 5e-3, view
        in_map = caster.normals(camera)
        # Right of the picture's centre the sphere's normals point right, above it up, and the
        # middle one towards the viewer.
        row, column = np.argwhere(hits.mask).mean(axis=0).astype(int)
        assert in_map[row, column] == pytest.approx([0, 0, 1], abs=0.05)
        assert in_map[row, column + 30, 0] > 0.5
        assert in_map[row - 30, column, 1] > 0.5
        assert not in_map[~hits.mask].any()
        assert np.linalg.norm(in_map[hits.mask], axis=1) == pytest.approx(1.0)


def test_cropped_and_resized_cameras_agree():
    camera = front(120, 200)
    caster = Raycaster(sphere(0.4))
    whole = caster.depth(camera)
    window = caster.depth(camera.cropped(30, 70, 50, 60))
    assert np.allclose(window, whole[70:130, 30:80], atol=2e-6, equal_nan=True)
    # Each fine pixel's 3 x 3 block has the coarse pixel's centre in its middle.
    fine = caster.depth(camera.resized(360, 600))[1::3, 1::3]
    assert np.allclose(fine, whole, atol=2e-6, equal_nan=True)


def test_the_window_leaves_nothing_out():
    mesh = box((-0.2, -0.9, -0.2), (0.7, 0.3, 0.2))  # out of the frame on the right
    camera = front()
    window = Window.around_points(mesh.vertices, camera)
    assert is_cut(mesh.vertices, camera)
    assert Raycaster(mesh).is_cut(camera)
    assert window.width * window.height < camera.width * camera.height
    depth = Raycaster(mesh).depth(camera)
    pixels = camera.pixel_centres().reshape(-1, 2)
    directions = camera.ray_directions(pixels)
    # The slow twin: slabs.
    with np.errstate(divide="ignore"):
        slabs = np.array([[-0.2, -0.9, -0.2], [0.7, 0.3, 0.2]])[:, None] - camera.position
        t = slabs / directions
    near, far = t.min(axis=0).max(axis=1), t.max(axis=0).min(axis=1)
    truth = np.where(near <= far, near, np.nan).reshape(depth.shape)
    assert np.allclose(depth, truth, atol=3e-6, equal_nan=True)


def test_a_mesh_outside_the_picture_gives_an_empty_answer():
    camera = front(target=(0, 0, 0))
    caster = Raycaster(box((5, 5, -0.1), (6, 6, 0.1)))
    assert caster.window(camera).is_empty
    assert not caster.mask(camera).any()
    assert np.isnan(caster.depth(camera)).all()


def test_a_mesh_round_the_camera_is_seen_from_inside():
    camera = front()
    depth = Raycaster(box((-5, -5, -5), (5, 5, 5))).depth(camera)
    assert depth == pytest.approx(np.full((200, 120), 8.0), abs=1e-5)


def test_visibility_knows_occlusion_frame_and_tolerance():
    camera = front()
    caster = Raycaster(box((-0.2, -0.2, -0.2), (0.2, 0.2, 0.2)))
    points = [
        (0, 0, 0.2),  # on the near face
        (0, 0, -0.2),  # on the far face
        (0, 0, 0.195),  # 5 mm inside
        (0.3, 0, -0.2),  # beside the box, nothing before it
        (5, 0, 0),  # out of the frame
        (0, 0, 3.5),  # behind the camera
    ]
    seen = caster.visible(points, camera, tolerance_m=0.001)
    assert seen.tolist() == [True, False, False, True, False, False]
    assert caster.visible(points, camera, tolerance_m=0.006)[2]


def test_interpolating_positions_gives_the_hit_points():
    mesh = sphere(0.4, rings=20, sectors=30)
    camera = RingRig(pitch_deg=30).cameras(60, 100)[1]
    hits = Raycaster(mesh).cast(camera)
    points = hits.interpolate(mesh.vertices, mesh.faces)[hits.mask]
    truth = camera.unproject(camera.pixel_centres()[hits.mask], hits.depth[hits.mask])
    assert np.abs(points - truth).max() < 1e-5  # rays graze the rim


def test_rays_through_chosen_pixels():
    camera = front()
    caster = Raycaster(box((-0.3, -0.5, -0.5), (0.3, 0.5, 0.5)))
    (x, y), *_ = camera.project([(0.3, 0.0, 0.5)])[0]
    assert caster.meets([(x - 0.01, y), (x + 0.01, y)], camera).tolist() == [True, False]

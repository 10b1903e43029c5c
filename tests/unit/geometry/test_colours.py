"""Colours from photos of solids whose colour is known everywhere."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from harness.core.arrays import Bytes, Floats
from harness.core.camera import Camera, look_at
from harness.core.errors import DataError
from harness.core.mesh import Mesh
from harness.core.rigs import RingRig
from harness.geometry.coinciding import concatenated, edges_of, open_edges
from harness.geometry.colouring import Colouring, coloured, finer, gains
from harness.geometry.images import linear_from_srgb, srgb_from_linear
from harness.geometry.photo import Photo
from harness.geometry.raycast import Raycaster
from tests.spheres import icosphere

#: A pixel spans 4.5 mm of the subject.
CAMERAS = RingRig(views=8).cameras(270, 480)
RADIUS = 0.5

Colour = Callable[[Floats], Floats]


def cube(side: float, cells: int = 24) -> tuple[Mesh, np.ndarray]:
    """A cube around the origin, each face a grid with vertices of its own; (V,) the face of each.

    Faces are +x, -x, +y, -y, +z, -z.
    """
    line = np.linspace(-1.0, 1.0, cells + 1)
    u, v = (grid.ravel() for grid in np.meshgrid(line, line, indexing="ij"))
    corner = np.arange((cells + 1) ** 2).reshape(cells + 1, -1)
    a, b, c, d = (
        part.ravel()
        for part in (corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:])
    )
    square = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    parts, faces = [], []
    for axis in range(3):
        for sign in (1.0, -1.0):
            points = np.empty((len(u), 3))
            points[:, axis], points[:, axis - 2], points[:, axis - 1] = sign, u, v
            faces.append((square if sign > 0 else square[:, ::-1]) + len(u) * len(parts))
            parts.append(points)
    mesh = Mesh(np.concatenate(parts) * side / 2, np.concatenate(faces), source="cube")
    assert mesh.signed_volume > 0
    return mesh, np.repeat(np.arange(6), len(u))


def photo_of(mesh: Mesh, camera: Camera, colour: Colour, exposure: float = 1.0) -> Photo:
    """An exact photo: ``colour`` of a world point is its sRGB, in linear light times exposure."""
    hits = Raycaster(mesh).cast(camera)
    points = hits.interpolate(mesh.vertices, mesh.faces)[hits.mask]
    rgba = np.zeros((camera.height, camera.width, 4))
    rgba[hits.mask, :3] = srgb_from_linear(
        np.clip(exposure * linear_from_srgb(colour(points)), 0, 1)
    )
    rgba[..., 3] = hits.mask
    return Photo(np.round(255 * rgba).astype(np.uint8), camera, Path("made"))


def waves(points: Floats) -> Floats:
    """(N, 3) sRGB of a texture that fills space, with waves of 25 to 40 cm."""
    phase = points @ (2 * np.pi / np.array([[0.40, 0.5, 0.6], [0.3, 0.25, 0.5], [0.5, 0.4, 0.30]]))
    return 0.55 + 0.3 * np.sin(phase)


def grey(points: Floats) -> Floats:
    """(N, 3) one grey."""
    return np.full((len(points), 3), 0.6)


def levels(colours: Bytes, expected: Floats) -> Floats:
    """(N,) largest difference of a channel, of 255."""
    return np.abs(colours - 255.0 * expected).max(axis=1)


def test_a_sphere_gets_its_texture_back():
    sphere = icosphere(RADIUS)
    photos = [photo_of(sphere, camera, waves) for camera in CAMERAS]
    result = coloured(sphere, photos)
    wrong = levels(result.colours, waves(sphere.vertices))
    assert result.seen_share > 0.9
    assert wrong[result.seen].mean() < 1.5
    assert np.quantile(wrong[result.seen], 0.99) < 8
    # The poles are on every photo's outline. A harmonic filling keeps within what is around it.
    y = sphere.vertices[:, 1] / RADIUS
    for pole in (y, -y):
        filled = ~result.seen & (pole > 0.8)
        assert filled.any()
        around = result.colours[result.seen & (pole > pole[filled].min() - 0.05)]
        assert (result.colours[filled] >= around.min(axis=0)).all()
        assert (result.colours[filled] <= around.max(axis=0)).all()


def test_a_cube_has_one_colour_on_each_face_up_to_its_edges():
    mesh, face = cube(0.8)
    palette = np.array([[0.9, 0.1, 0.1], [0.1, 0.8, 0.1], [0.1, 0.2, 0.9],
                        [0.5, 0.5, 0.5], [0.9, 0.8, 0.1], [0.7, 0.1, 0.8]])  # fmt: skip

    def colour(points: Floats) -> Floats:
        axis = np.abs(points).argmax(axis=1)
        below = points[np.arange(len(points)), axis] < 0
        return palette[2 * axis + below]

    cameras = RingRig(views=8, pitch_deg=25.0).cameras(270, 480)
    result = coloured(mesh, [photo_of(mesh, camera, colour) for camera in cameras])
    inner = np.sort(np.abs(mesh.vertices), axis=1)[:, 1] < 0.37
    shown = inner & (face != 3)
    assert result.seen[shown].all()
    # A pixel on the edge mixes two faces, and the smooth correction carries a little of it inward.
    assert levels(result.colours, palette[face])[shown].max() < 8
    # No photo shows the bottom: it has the colours of the sides, which lie in their range.
    assert not result.seen[inner & (face == 3)].any()
    sides = 255 * palette[[0, 1, 4, 5]]
    bottom = result.colours[face == 3]
    assert (bottom >= sides.min(axis=0) - 6).all()
    assert (bottom <= sides.max(axis=0) + 6).all()


@pytest.mark.parametrize(("texture", "most"), [(grey, 0.02), (waves, 0.06)])
def test_two_exposures_leave_no_seam(texture: Colour, most: float):
    sphere = icosphere(RADIUS)

    def taken(exposures: Sequence[float]) -> Colouring:
        photos = zip(CAMERAS, exposures, strict=True)
        return Colouring(
            sphere, [photo_of(sphere, camera, texture, each) for camera, each in photos]
        )

    uneven, even = taken([1.0, 0.6] * 4), taken([1.0] * 8)
    found = gains(uneven.sights)
    assert found[1::2].mean() - found[::2].mean() == pytest.approx(-np.log(0.6), abs=0.05)
    result, expected = uneven.from_photos(range(8)), even.from_photos(range(8))
    # One exposure between the two everywhere; without levelling, half is 67 % brighter.
    ratio = linear_from_srgb(result.colours / 255.0) / linear_from_srgb(expected.colours / 255.0)
    middle = float(np.median(ratio))
    assert middle == pytest.approx(np.sqrt(0.6), abs=0.04)
    assert np.quantile(np.abs(ratio[result.seen] / middle - 1.0), 0.99) < most


def two_colours(mesh: Mesh, split: int) -> Callable[[Mesh, Camera], Photo]:
    """Photographs a mesh whose first ``split`` vertices are red and whose others are white."""
    colours = np.ones((len(mesh.vertices), 3))
    colours[:split, 1:] = 0.0

    def take(scene: Mesh, camera: Camera) -> Photo:
        hits = Raycaster(scene).cast(camera)
        rgba = np.dstack([hits.interpolate(colours, scene.faces), hits.mask])
        return Photo(np.round(255 * rgba).astype(np.uint8), camera, Path("made"))

    return take


@pytest.mark.parametrize("views", [range(8), [0], [0, 1]])
def test_no_colour_comes_from_a_photo_that_does_not_see_the_point(views: Sequence[int]):
    ball = icosphere(0.08, 4, (0.0, 0.1, 0.45))
    scene = concatenated([ball, icosphere(0.3)])
    take = two_colours(scene, len(ball.vertices))
    result = coloured(scene, [take(scene, CAMERAS[view]) for view in views])
    white = slice(len(ball.vertices), None)
    assert result.colours[white].min() > 250
    red = result.colours[: len(ball.vertices)]
    assert red[:, 1:].max() < 5
    assert red[:, 0].min() > 250
    if list(views) == [0]:
        # Behind the ball, and the back.
        assert not result.seen[white][scene.vertices[white, 2] < 0].any()
        near_shadow = np.linalg.norm(scene.vertices[white, :2] - (0.0, 0.1), axis=1) < 0.05
        assert not result.seen[white][near_shadow].any()


def test_a_vertex_beyond_the_frame_or_outside_the_mask_is_not_coloured():
    sphere = icosphere(RADIUS, 4)
    photo = photo_of(sphere, CAMERAS[0], grey)
    half = photo.rgba.copy()
    half[:, :135, 3] = 0
    result = coloured(sphere, [Photo(half, photo.camera, photo.source)])
    assert not result.seen[sphere.vertices[:, 0] < 0].any()
    assert result.seen[(sphere.vertices[:, 0] > 0.05) & (sphere.vertices[:, 2] > 0.2)].all()


def test_a_mesh_that_no_photo_shows_is_grey_and_no_photo_at_all_is_refused():
    sphere = icosphere(RADIUS, 3)
    away = CAMERAS[0]
    turned = Camera(away.K, look_at((0, 0, 3), (0, 0, 9)), away.width, away.height)
    blank = Photo(np.zeros((turned.height, turned.width, 4), np.uint8), turned, Path("blank"))
    result = coloured(sphere, [blank])
    assert result.seen_share == 0
    assert len(np.unique(result.colours)) == 1
    with pytest.raises(DataError, match="without photos"):
        coloured(sphere, [])


def test_split_vertices_get_one_colour_and_equal_input_gives_equal_output():
    sphere = icosphere(RADIUS, 4)
    split = Mesh(sphere.vertices[sphere.faces.ravel()], np.arange(sphere.faces.size).reshape(-1, 3))
    photos = [photo_of(sphere, camera, waves) for camera in CAMERAS[:3]]
    whole = coloured(sphere, photos)
    again = coloured(split, photos)
    apart = np.abs(whole.colours[sphere.faces.ravel()].astype(int) - again.colours)
    assert apart.max() <= 1
    np.testing.assert_array_equal(coloured(sphere, photos).colours, whole.colours)


def test_a_finer_mesh_is_the_same_surface_with_edges_about_as_long_as_wanted():
    sphere = icosphere(RADIUS, 3)
    fine = finer(sphere, 0.03, 10**6)
    ends = edges_of(fine.faces).ends
    edge_m = np.median(np.linalg.norm(np.diff(fine.vertices[ends], axis=1), axis=2))
    assert 0.7 * 0.03 <= edge_m <= 1.42 * 0.03
    assert fine.area == pytest.approx(sphere.area)
    assert fine.signed_volume == pytest.approx(sphere.signed_volume)
    assert open_edges(fine) == 0
    assert finer(sphere, 0.03, len(sphere.vertices)).vertices.shape == sphere.vertices.shape

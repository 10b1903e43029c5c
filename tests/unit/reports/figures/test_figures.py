"""Figures show what they claim: the mesh where the camera sees it, errors in their colours."""

from dataclasses import replace

import numpy as np
import pytest

from harness.core.artifacts import Capture
from harness.core.errors import DataError, HarnessError
from harness.core.mesh import Mesh
from harness.core.rigs import RingRig
from harness.geometry.images import load_rgb, save_png
from harness.geometry.raycast import Raycaster
from harness.geometry.window import Window
from reports.figures.comparison import (
    MethodMesh,
    SubjectPanels,
    _front_and_back,
    overlay_figure,
    qualitative_grid,
)
from reports.figures.panels import ErrorScale, PanelWindow, heat, panel_windows, photo, shaded

WIDTH, HEIGHT = 54, 96


def ball(radius=0.5, shift=(0.0, 0.0, 0.0), steps=24):
    """A closed sphere of quads, fine enough to look round."""
    polar, azimuth = np.meshgrid(
        np.linspace(0, np.pi, steps), np.linspace(0, 2 * np.pi, 2 * steps), indexing="ij"
    )
    x, y, z = np.sin(polar) * np.sin(azimuth), np.cos(polar), np.sin(polar) * np.cos(azimuth)
    vertices = radius * np.stack([x, y, z], axis=-1).reshape(-1, 3) + shift
    row, column = np.meshgrid(np.arange(steps - 1), np.arange(2 * steps - 1), indexing="ij")
    a = (row * 2 * steps + column).ravel()
    b, c, d = a + 1, a + 2 * steps, a + 2 * steps + 1
    return Mesh(vertices, np.concatenate([np.stack(t, axis=1) for t in ((a, c, b), (b, c, d))]))


@pytest.fixture
def capture(tmp_path, monkeypatch):
    """Photos of a red ball, for small figures."""
    monkeypatch.setattr("reports.figures.comparison._LEAST_HEIGHT", 80)
    cameras = RingRig(views=8).cameras(WIDTH, HEIGHT)
    caster = Raycaster(ball())
    for view, camera in enumerate(cameras):
        rgba = np.zeros((HEIGHT, WIDTH, 4), dtype=np.uint8)
        rgba[..., 0] = 220
        rgba[..., 3] = np.round(255 * caster.coverage(camera))
        save_png(tmp_path / "rgb" / f"{view:02d}.png", rgba)
    return Capture("synthetic", "ball", "tiny", "key", tmp_path, cameras)


def test_clay_covers_what_the_camera_sees(capture):
    camera = capture.cameras[0]
    picture = shaded(Raycaster(ball()), camera)
    assert picture.shape == (HEIGHT, WIDTH, 4)
    assert np.abs(picture[..., 3] - Raycaster(ball()).coverage(camera, supersample=2)).max() == 0
    inside = picture[..., 3] == 1
    assert (picture[inside][:, :3] > 0.15).all()


def test_the_light_comes_from_the_upper_left(capture):
    picture = shaded(Raycaster(ball()), capture.cameras[0])[..., 0]
    brightest = np.unravel_index(np.argmax(picture), picture.shape)
    assert brightest[0] < HEIGHT / 2
    assert brightest[1] < WIDTH / 2


def test_an_error_has_its_colour(capture):
    mesh, scale = ball(), ErrorScale(limit=20.0)
    for error in (0.0, 7.0, 20.0, 500.0):
        picture = heat(
            Raycaster(mesh), capture.cameras[0], np.full(len(mesh.vertices), error), scale
        )
        inside = picture[..., 3] > 0
        assert inside.any()
        np.testing.assert_allclose(
            picture[inside][:, :3],
            np.broadcast_to(scale.rgb(np.array(error)), (int(inside.sum()), 3)),
            atol=1e-6,
        )
    assert np.array_equal(scale.rgb(np.array(20.0)), scale.rgb(np.array(500.0)))


@pytest.mark.parametrize("errors", [np.zeros(3), None])
def test_errors_that_do_not_fit_the_mesh_are_refused(capture, errors):
    mesh = ball()
    if errors is None:
        errors = np.full(len(mesh.vertices), np.nan)
    with pytest.raises(DataError, match="one per vertex"):
        heat(Raycaster(mesh), capture.cameras[0], errors, ErrorScale(20.0))


def test_an_error_scale_needs_a_range():
    with pytest.raises(DataError, match="no range"):
        ErrorScale(0.0)


def test_windows_have_one_size_and_hold_their_mesh(capture):
    meshes = [ball(0.3), ball(0.5, shift=(0.05, 0.1, 0.0))]
    frames = panel_windows([(mesh, capture.cameras[0]) for mesh in meshes], panel_inch=3.0)
    assert len({frame.window.size for frame in frames}) == 1
    for mesh, frame in zip(meshes, frames, strict=True):
        whole = Raycaster(mesh).mask(capture.cameras[0]).sum()
        assert Raycaster(mesh).mask(frame.of_camera(capture.cameras[0])).sum() == whole


@pytest.mark.parametrize("corner", [(-3, -5), (40, 80), (5, 7), (-200, 0), (500, 500)])
def test_the_window_of_a_photo_is_that_of_its_camera(capture, corner):
    image = photo(capture, 0)
    window = Window(*corner, 30, 40)
    cropped = PanelWindow(window).of_image(image)
    assert cropped.shape == (40, 30, 3)
    for row, column in ((0, 0), (20, 15), (39, 29)):
        y, x = row + window.top, column + window.left
        inside = 0 <= y < HEIGHT and 0 <= x < WIDTH
        assert np.array_equal(cropped[row, column], image[y, x] if inside else np.ones(3))


def test_a_small_photo_still_gets_a_sharp_mesh(capture):
    window = PanelWindow(Window(10, 10, 30, 40))
    camera = window.of_camera(capture.cameras[0], least_height=100)
    assert (camera.width, camera.height) == (90, 120)


def test_a_large_photo_is_shown_as_small_as_it_is_printed_and_its_mesh_with_it(capture):
    mesh = ball(0.45)
    panel = panel_windows([(mesh, capture.cameras[0])], panel_inch=0.2)[0]
    camera, image = panel.of_camera(capture.cameras[0]), panel.of_image(photo(capture, 0))
    window = panel.window
    assert image.shape == (30, camera.width, 3)
    assert camera.height == 30 < window.height
    photographed, seen = image.mean(axis=2) < 0.95, Raycaster(mesh).mask(camera)
    centres = [np.argwhere(inside).mean(axis=0) for inside in (photographed, seen)]
    full = np.argwhere(Raycaster(mesh).mask(capture.cameras[0])).mean(axis=0) + 0.5
    share = camera.height / window.height
    expected = share * (full - (window.top, window.left)) - 0.5
    np.testing.assert_allclose(centres[1], expected, atol=0.3)
    np.testing.assert_allclose(centres[0], expected, atol=1.0)


@pytest.mark.nightly
@pytest.mark.parametrize("suffix", [".png", ".pdf", ".svg"])
def test_the_grid_is_drawn(capture, tmp_path, suffix):
    mesh = ball(0.45)
    errors = np.full(len(mesh.vertices), 50.0)
    methods = (MethodMesh("small", mesh, errors), MethodMesh("without errors", ball(0.55)))
    subject = SubjectPanels(capture, ball(), methods)
    path = tmp_path / f"grid{suffix}"
    qualitative_grid([subject, subject], path, ErrorScale(60.0))
    first = path.read_bytes()
    assert len(first) > 5000
    if suffix != ".svg":  # matplotlib salts the ids of an SVG
        qualitative_grid([subject, subject], path, ErrorScale(60.0))
        assert path.read_bytes() == first


@pytest.mark.nightly
def test_equal_meshes_look_equal_in_all_columns(capture, tmp_path):
    methods = (MethodMesh("one", ball()), MethodMesh("two", ball()))
    path = tmp_path / "grid.png"
    qualitative_grid([SubjectPanels(capture, ball(), methods)], path, ErrorScale(60.0))
    picture = load_rgb(path)
    grey = (np.ptp(picture.astype(int), axis=2) < 25) & (picture.max(axis=2) < 235)
    # The two methods and the truth show the same ball, each from the front and from the back.
    columns = np.flatnonzero(grey.sum(axis=0) > 50)
    runs = np.split(columns, np.flatnonzero(np.diff(columns) > 1) + 1)
    widths = [len(run) for run in runs if len(run) > 50]
    assert len(widths) == 6
    assert max(widths) - min(widths) <= 2


def test_a_grid_needs_the_same_methods_everywhere(capture, tmp_path):
    one = SubjectPanels(capture, ball(), (MethodMesh("a", ball()),))
    two = SubjectPanels(capture, ball(), (MethodMesh("b", ball()),))
    for subjects in ([], [one, two]):
        with pytest.raises(HarnessError, match="same methods"):
            qualitative_grid(subjects, tmp_path / "grid.png", ErrorScale(60.0))


def green(path):
    picture = load_rgb(path).astype(int)
    return (picture[..., 1] > picture[..., 0] + 60) & (picture[..., 1] > picture[..., 2] + 60)


@pytest.mark.nightly
def test_the_outline_shows_a_wrong_camera(capture, tmp_path):
    """A right outline hides the photo's edge; a shifted one leaves photo outside it."""
    path = tmp_path / "overlay.png"

    def red_outside(shift_m):
        cameras = tuple(
            replace(camera, world_to_camera=camera.world_to_camera @ translation(shift_m))
            for camera in capture.cameras
        )
        overlay_figure(ball(), replace(capture, cameras=cameras), path)
        picture = load_rgb(path).astype(int)
        assert green(path).any()
        # Photo that the grey mesh does not cover keeps its full red.
        return int(((picture[..., 0] > 200) & (picture[..., 1] < 60)).sum())

    assert red_outside(0.0) < 0.05 * red_outside(0.1)


def translation(x):
    transform = np.eye(4)
    transform[0, 3] = x
    return transform


def test_a_mesh_outside_the_picture_draws_the_photo_alone(capture, tmp_path):
    overlay_figure(ball(0.1, shift=(0.0, 5.0, 0.0)), capture, tmp_path / "overlay.png")
    assert not green(tmp_path / "overlay.png").any()


def test_an_unknown_picture_format_is_refused(capture, tmp_path):
    with pytest.raises(HarnessError, match=r"\.png or \.pdf or \.svg; got \.bmp"):
        overlay_figure(ball(), capture, tmp_path / "overlay.bmp")


@pytest.mark.parametrize(("views", "back"), [(4, 2), (8, 4), (16, 8), (5, 2)])
def test_the_back_is_the_view_opposite_of_the_front(capture, views, back):
    ring = replace(capture, cameras=RingRig(views=views).cameras(30, 40), front_yaw_deg=0.0)
    assert _front_and_back(ring) == (0, back)

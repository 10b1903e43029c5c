"""Wrinkles of sheets whose surplus is known, and of one cut garment."""

import numpy as np
import pytest

from clothed_avatars.clothes.patterns import cut_top
from clothed_avatars.clothes.wardrobe import Fabric, loose_shirt
from clothed_avatars.clothes.weaves import WEAVES
from clothed_avatars.mesh.nearness import Nearness, pushed_off
from clothed_avatars.mesh.quads import grid, triangles
from clothed_avatars.people.body import AvatarBody
from clothed_avatars.wrinkles import garment
from clothed_avatars.wrinkles.crossings import crossing_share, crossing_vertices, uncrossed
from clothed_avatars.wrinkles.garment import _without_checks, wrinkled
from clothed_avatars.wrinkles.relaxation import Contact, Held, Steps, relaxed, springs
from clothed_avatars.wrinkles.ridges import ridges, surplus_of_vertices
from clothed_avatars.wrinkles.surplus import Tailoring
from harness.core.mesh import Mesh
from metrics.folds import PIXEL_M, fold_strength, true_normals

STEP = 0.005


def sheet(size=61):
    """A level sheet of quads, 5 mm wide each, facing +z."""
    y, x = np.mgrid[:size, :size] * STEP
    points, quads = grid(np.stack([x, y, 0 * x], axis=-1), closed=False)
    return points, quads


def lengths(points, net):
    return np.linalg.norm(points[net.ends[:, 0]] - points[net.ends[:, 1]], axis=1)


def free(points):
    return Held(np.zeros(len(points), bool), [])


def along_x(points, net):
    """1 for edges along x, 0 for those along y, one half for diagonals."""
    way = points[net.ends[:, 0]] - points[net.ends[:, 1]]
    return way[:, 0] ** 2 / (way**2).sum(1)


def test_every_edge_and_diagonal_is_a_spring_once():
    points, quads = sheet(5)
    net = springs(len(points), quads)
    assert len(net.ends) == 2 * 5 * 4 + 2 * 16
    np.testing.assert_allclose(
        net.difference @ points, points[net.ends[:, 0]] - points[net.ends[:, 1]]
    )


def test_cloth_that_fits_stays_where_it_is():
    points, quads = sheet(21)
    net = springs(len(points), quads)
    now = relaxed(points, points, lengths(points, net), net, Steps(50, 0.05), free(points))
    np.testing.assert_allclose(now, points, atol=1e-6)


def test_cloth_that_is_too_long_folds_and_takes_up_its_length():
    points, quads = sheet()
    net = springs(len(points), quads)
    border = (points[:, :2] < 1e-9).any(1) | (points[:, :2] > 60 * STEP - 1e-9).any(1)
    surplus = 0.10 * along_x(points, net)
    heights = ridges(net, 0.5 * surplus, lengths(points, net), 0.06, 3)
    start = points + heights[:, None] * [0, 0, 1]
    wanted = lengths(points, net) * (1 + surplus)
    now = relaxed(points, start, wanted, net, Steps(300, 0.02), Held(border, []))
    np.testing.assert_array_equal(now[border], points[border].astype(np.float32))
    along = along_x(points, net) > 0.9
    gained = (lengths(now, net) / lengths(points, net))[along].mean() - 1
    assert 0.05 < gained < 0.12
    assert np.abs(now - points).max() < 0.0251
    assert np.abs(now[:, 2]).max() > 0.004


def test_cloth_stays_off_what_it_lies_on():
    points, quads = sheet(31)
    net = springs(len(points), quads)
    noise = 0.004 * np.random.default_rng(1).normal(size=len(points))
    up = np.tile([0.0, 0, 1], (len(points), 1))
    floor = Contact(points - [0, 0, 0.003], up, np.full(len(points), 0.002))
    held = Held(np.zeros(len(points), bool), [floor])
    start = points + noise[:, None] * up
    now = relaxed(points, start, 1.1 * lengths(points, net), net, Steps(60, 0.05), held)
    assert now[:, 2].min() >= -0.001 - 1e-6
    assert now[:, 2].max() > 0.002


def test_ridges_run_across_the_direction_that_has_surplus():
    points, quads = sheet(121)
    net = springs(len(points), quads)
    for turned in (False, True):
        share = along_x(points, net)
        surplus = 0.08 * (1 - share if turned else share)
        heights = ridges(net, surplus, lengths(points, net), 0.06, 7).reshape(121, 121)
        over_y, over_x = (np.diff(heights, axis=axis).std() for axis in (0, 1))
        across, along = (over_y, over_x) if turned else (over_x, over_y)
        assert across > 2.5 * along


def test_ridges_are_as_wide_as_asked_and_make_cloth_longer_by_their_surplus():
    points, quads = sheet(241)
    net = springs(len(points), quads)
    surplus = 0.05 * along_x(points, net)
    for wave_m in (0.05, 0.10):
        heights = ridges(net, surplus, lengths(points, net), wave_m, 5).reshape(241, 241)
        middle = heights[:, 20:-20] - heights[:, 20:-20].mean()
        crossings_per_row = (np.diff(np.sign(middle), axis=1) != 0).sum(1).mean()
        found_m = 2 * (middle.shape[1] - 1) * STEP / crossings_per_row
        assert found_m == pytest.approx(wave_m, rel=0.35)
        slope = np.diff(heights, axis=1) / STEP
        assert 0.5 * (slope**2).mean() == pytest.approx(0.05, rel=0.5)


def test_a_checkerboard_goes_and_folds_stay():
    points, quads = sheet(41)
    row, column = np.divmod(np.arange(41 * 41), 41)
    checks, folds = 0.002 * (-1.0) ** (row + column), 0.01 * np.sin(2 * np.pi * column / 8)
    rough = points + (checks + folds)[:, None] * [0, 0, 1]
    found = _without_checks(rough, quads)[:, 2].reshape(41, 41)[5:-5, 5:-5]
    wanted = folds.reshape(41, 41)[5:-5, 5:-5]
    assert np.abs(found - wanted).max() < 0.0004


def test_without_surplus_there_are_no_ridges():
    points, quads = sheet(21)
    net = springs(len(points), quads)
    nothing = np.zeros(len(net.ends))
    assert not surplus_of_vertices(net, nothing).any()
    assert not ridges(net, nothing, lengths(points, net), 0.05, 1).any()


def test_a_sheet_crosses_nothing_and_two_that_cut_each_other_do():
    points, quads = sheet(21)
    assert crossing_share(points, quads) == 0
    upright = points[:, [0, 2, 1]] + [0.0012, 0.0523, -0.0512]
    both = np.concatenate([points, upright])
    all_quads = np.concatenate([quads, quads + len(points)])
    found = crossing_vertices(both, all_quads)
    assert found.any()
    # What crosses lies on the line y = 0.0523 of the one and z = 0 of the other.
    assert np.abs(both[found][:, 1] - 0.0523).max() <= STEP + 1e-9
    assert np.abs(both[found][:, 2]).max() <= STEP + 1e-9
    assert 0 < crossing_share(both, all_quads) < 0.1


def test_displacements_that_make_cloth_cross_itself_are_taken_back():
    points, quads = sheet(31)
    net = springs(len(points), quads)
    moved = np.zeros_like(points)
    bump = np.exp(-((points[:, :2] - 0.075) ** 2).sum(1) / 0.012**2)
    moved[:, 0] = -4 * bump * (points[:, 0] - 0.075)  # turned inside out around the middle
    moved[:, 2] = 0.3 * bump * (points[:, 1] - 0.075)
    assert crossing_share(points + moved, quads) > 0
    less = uncrossed(points, moved, quads, net.means)
    assert crossing_share(points + less, quads) < 0.5 * crossing_share(points + moved, quads)
    far = bump < 1e-6
    np.testing.assert_allclose(less[far], moved[far], atol=1e-8)


def test_a_push_moves_only_what_is_too_near():
    points, quads = sheet(21)
    surface = Nearness(points, quads)
    offsets = np.array([[0, 0, -0.002], [0, 0, 0.001], [0, 0, 0.004], [0, 0, 0.02]])
    above = points[200:204] + offsets
    moved = pushed_off(above, surface, 0.004)
    np.testing.assert_allclose(moved[:, 2], [0.004, 0.004, 0.004, 0.02], atol=1e-6)
    np.testing.assert_allclose(moved[:, :2], above[:, :2], atol=1e-6)


@pytest.fixture(scope="module")
def shirt():
    """A shirt as it was cut, on its unposed body: a drape without folds.

    Of short sleeves and above the waist, which leaves half the cloth.
    """
    names = ("gender", "age", "height", "weight", "muscle", "proportions")
    body = AvatarBody(dict(zip(names, (0.1, 0.67, 0.4, 0.5, 0.5, 0.6), strict=True)))
    skin = Nearness(body.vertices, body.quads("skin"))
    cut = loose_shirt(Fabric((90, 90, 90)), sleeve=0.15, hem=-0.1)
    return body, cut_top(body, cut, skin), skin


def creased_shirt(shirt, weave, seed=11, strength=1.0):
    body, piece, skin = shirt
    tailoring = Tailoring(body, piece, WEAVES[weave], strength, seed)
    return wrinkled(tailoring, piece.vertices, piece.vertices, [skin])


def strength_of(shirt):
    mesh = Mesh(shirt.vertices, triangles(shirt.quads))
    return fold_strength(*true_normals(mesh), PIXEL_M).mean_deg


@pytest.mark.nightly
def test_weaves_crease_in_their_order_and_keep_off_the_body(shirt):
    weaves = ("jersey", "poplin", "crumpled cotton")
    found = [creased_shirt(shirt, weave) for weave in weaves]
    jersey, middle, crumpled = map(strength_of, found)
    assert jersey + 2 < middle
    assert middle + 5 < crumpled
    for each in found:
        height, _ = shirt[2].height(each.vertices)
        assert (height < -0.001).mean() < 0.001
        assert each.crossing < 0.005
        assert len(each.open_loops()) == 3


@pytest.mark.nightly
def test_equal_seeds_give_equal_wrinkles_and_no_strength_gives_none(shirt, monkeypatch):
    # The third level takes two thirds of the time and does again what the second does.
    monkeypatch.setattr(garment, "_LEVELS", 2)
    first, again, other = (creased_shirt(shirt, "poplin", seed) for seed in (11, 11, 12))
    np.testing.assert_array_equal(first.vertices, again.vertices)
    assert np.abs(first.vertices - other.vertices).max() > 0.003
    still = creased_shirt(shirt, "poplin", strength=0.0)
    assert strength_of(still) < 0.6 * strength_of(first)

"""What landmarks and outlines do alone, and what is refused or left out by them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates, maximum_filter
from scipy.spatial.transform import Rotation

from harness.core.errors import DataError, MethodError
from harness.core.process.threads import silent
from harness.core.rigs import RingRig
from methods.body.photos.detection import Detections
from methods.cameras import estimate, search
from methods.cameras.adjustment import Rig, Solved, solved
from methods.cameras.checks import (
    _joined,
    check_matches,
    check_round,
    check_sure,
    misfit,
    spreads,
    swayed,
)
from methods.cameras.landmarks import by_landmarks
from methods.cameras.matches import LEAST_MATCHES, Matches, MatchRows, contradiction_m, met
from methods.cameras.values import Focal, PhotoView, turn_sds_deg
from tests.unit.methods.cameras.conftest import Taken, errors_deg, landmarks, turned
from tests.unit.methods.cameras.test_derivatives import exact_matches


def sizes(taken: Taken) -> list[tuple[int, int]]:
    return [photo.size for photo in taken.photos]


def given_focal(taken: Taken) -> Focal:
    return Focal(tuple(float(camera.K[0, 0]) for camera in taken.cameras))


def test_landmarks_alone_are_degrees_off(taken):
    found, _ = by_landmarks(Rig.of(taken.cameras), taken.marks)
    assert errors_deg(found.cameras(sizes(taken)), taken.cameras).max() < 8.0


@pytest.mark.slow
def test_left_and_right_are_exchanged_where_they_were(taken):
    """Where landmarks in space hardly tell front from back, outlines do."""
    wrong = np.arange(8) == 2
    group = estimate._group(taken.photos, given_focal(taken), taken.marks.mirrored(wrong))
    known = tuple(taken.cameras[number] for number in group.numbers)
    _, rig, given = estimate._by_landmarks(group, taken.height_m)
    missed, found, _ = estimate._begun(rig, given)
    assert missed < 0.0006
    assert errors_deg(found.cameras(sizes(taken)), known).max() < 1.0


@pytest.mark.slow
def test_a_view_planted_25_degrees_off_is_found(taken):
    """Coherence tells that it is wrong, and the search over views brings it back."""
    group = estimate._group(taken.photos, given_focal(taken), taken.marks)
    known = tuple(taken.cameras[number] for number in group.numbers)
    _, _, given = estimate._by_landmarks(group, taken.height_m)
    good = replace(Rig.of(known), points=landmarks())
    planted = search._led_round(good, 3, 25.0)
    assert given.misses_m(planted)[0] > 5 * given.misses_m(good)[0]
    missed, found, _ = estimate._begun(planted, given)
    assert missed < 0.0006
    assert errors_deg(found.cameras(sizes(taken)), known).max() < 1.0


@pytest.mark.nightly
@pytest.mark.parametrize("seed", [0, 2, 3])
def test_a_view_led_astray_is_brought_back(taken, seed):
    """Turned by 140 degrees about any axis, its own neighbourhood has wrong minima alone."""
    group = estimate._group(taken.photos, given_focal(taken), taken.marks)
    known = tuple(taken.cameras[number] for number in group.numbers)
    _, _, given = estimate._by_landmarks(group, taken.height_m)
    good = replace(Rig.of(known), points=landmarks())
    axis = np.random.default_rng(seed).normal(size=3)
    turn = Rotation.from_rotvec(np.radians(140) * axis / np.linalg.norm(axis)).as_matrix()
    middle, before = good.points.mean(axis=0), good.rotations[3]
    away = good.shifts[3] + before @ middle - before @ turn @ middle
    led = replace(good, rotations=(before @ turn)[None], shifts=away[None])
    found, held = search.brought_back(good.with_views([3], led), given, 3)
    assert held.misses_m(found)[0] < 0.0006
    assert errors_deg(found.cameras(sizes(taken)), known).max() < 1.0


def wobbling(photo: PhotoView, seed: int, amplitude_px: float) -> PhotoView:
    """A photo whose outline goes in and out in waves of some pixels."""
    rng, alpha = np.random.default_rng(seed), photo.rgba[..., 3].astype(float)
    off = [gaussian_filter(rng.normal(size=alpha.shape), 6) for _ in range(2)]
    places = np.mgrid[: alpha.shape[0], : alpha.shape[1]]
    moved = [place + amplitude_px * o / o.std() for place, o in zip(places, off, strict=True)]
    shown = map_coordinates(alpha, moved, order=1, mode="nearest")
    return PhotoView(photo.name, np.dstack([photo.rgba[..., :3], shown.astype(np.uint8)]))


@pytest.mark.nightly
def test_noisy_outlines_leave_no_photo_out_and_one_wrong_one_does(taken):
    """All miss alike, by more than exact ones do; one that is too wide makes most of it alone."""
    photos = tuple(wobbling(photo, n, 1.2) for n, photo in enumerate(taken.photos))
    rng = np.random.default_rng(0)

    def by_outlines(these):
        group = estimate._group(these, given_focal(taken), taken.marks)
        return estimate._by_outlines(*estimate._by_landmarks(group, taken.height_m), rng)

    group, rig, given = by_outlines(photos)
    assert estimate._COHERENT_M < given.misses_m(rig)[0] < estimate._NOISY_M
    assert group.left_out == {}
    shown = taken.photos[2].rgba
    wide = np.dstack([shown[..., :3], maximum_filter(shown[..., 3], 25)])
    group, _, _ = by_outlines((*taken.photos[:2], PhotoView("2.png", wide), *taken.photos[3:]))
    assert list(group.left_out) == [2]


def test_one_side_is_refused_and_gaps_are_told():
    ring = Rig.of(RingRig(views=8).cameras(100, 100))
    ring = replace(ring, points=landmarks())
    five = Rig.of(RingRig(views=5).cameras(100, 100))
    assert check_round(ring) == ()
    assert "cannot be matched" in check_round(replace(five, points=landmarks()))[0]
    with pytest.raises(MethodError, match="do not go round the person.*22. degrees"):
        check_round(ring.at([0, 1, 2, 7]))


def held_by(taken: Taken, told: Matches) -> Solved:
    """The true cameras, as sure as matches make them."""
    rig = Rig.of(taken.cameras)
    return replace(solved(rig, [MatchRows(told)], 1), rig=replace(rig, points=np.zeros((33, 3))))


def test_a_photo_like_none_of_its_neighbours_is_named(taken):
    told = exact_matches(taken, 1200)
    found = held_by(taken, told)
    assert misfit(found, told) is None
    silent = told.of(~(told.views == 5).any(axis=1))
    assert misfit(found, silent) == (5, "it looks like none of its neighbours")
    few = told.of(np.arange(len(told)) < 40)
    assert misfit(found, few) is None
    assert "plain clothes" in check_matches(found.rig, few)[0]


def test_groups_of_photos_that_no_matches_join_are_told(taken):
    """A ring may miss one pair of neighbours; without two it falls apart."""
    told = exact_matches(taken, 1200)
    half = np.isin(told.views, [0, 1, 2, 3])
    across = np.flatnonzero(half[:, 0] != half[:, 1])
    one = (told.views[across] == told.views[across[0]]).all(axis=1)
    for gone, groups in ((across[:0], 1), (across[one], 1), (across, 2)):
        kept = told.of(~np.isin(np.arange(len(told)), gone))
        warned = [each for each in check_matches(held_by(taken, kept).rig, kept) if "join" in each]
        assert warned == [] if groups == 1 else f"join {groups} groups" in warned[0]
    assert _joined(3, {(0, 1): LEAST_MATCHES, (1, 2): LEAST_MATCHES - 1}) == 2
    assert _joined(3, {}) == 3


def test_the_one_photo_whose_camera_is_left_open_is_named(taken):
    told = exact_matches(taken, 1200)
    its = np.flatnonzero((told.views == 3).any(axis=1))
    kept = np.ones(len(told), dtype=bool)
    kept[its[6:]] = False
    found = held_by(taken, told.of(kept))
    left = misfit(found, told)
    assert left is not None
    assert left[0] == 3
    assert left[1].endswith("degrees only")
    assert turn_sds_deg(spreads(found)[0])[[0, 1, 5, 6]].max() < 1.0


def test_the_one_photo_whose_matches_miss_is_named(taken):
    """Neighbours share its matches, so that theirs miss by more, too."""
    told = with_noise(exact_matches(taken, 1200), 0.2)
    found = held_by(taken, told)
    assert misfit(found, told) is None
    its = (told.views == 4).any(axis=1)
    worse = with_noise(told, 2.0)
    mixed = replace(
        told,
        first=np.where(its[:, None], worse.first, told.first),
        second=np.where(its[:, None], worse.second, told.second),
    )
    left = misfit(found, mixed)
    assert left is not None
    assert left[0] == 4
    assert "matches miss by" in left[1]


@pytest.mark.parametrize(
    ("every", "is_taken"), [pytest.param(2, True, marks=pytest.mark.nightly), (4, False)]
)
def test_a_finer_search_that_finds_little_is_not_taken(taken, monkeypatch, every, is_taken):
    """A few matches of noisy photos would leave cameras open that the coarser ones hold."""
    group = estimate._group(taken.photos, given_focal(taken), taken.marks)
    known = tuple(taken.cameras[number] for number in group.numbers)
    _, _, given = estimate._by_landmarks(group, taken.height_m)
    told = exact_matches(replace(taken, cameras=known), 1200)
    some = told.of(told.place % every == 0)
    searches = iter([told, some, some, some, some])
    monkeypatch.setattr(estimate, "find_matches", lambda *_: next(searches))
    rig = replace(Rig.of(known), points=landmarks())
    steps = estimate._Steps(len(known), silent)
    _, matches = estimate._by_photos(group.photos, rig, given, taken.height_m, steps)
    assert len(matches) == len(some if is_taken else told)


def test_matches_that_contradict_the_cameras_are_refused(taken):
    told = exact_matches(taken, 1200)
    rig = replace(Rig.of(taken.cameras), points=np.zeros((33, 3)))
    assert not any("plain" in text for text in check_matches(rig, told))
    wrong = replace(Rig.of(turned(taken.cameras, 2.0, 3)), points=np.zeros((33, 3)))
    with pytest.raises(MethodError, match="the person moved"):
        check_matches(wrong, told)
    once = np.ones(len(told), dtype=bool)
    once[told.twice[10:, 1]] = False
    assert 0 < len(told.of(once).twice) < LEAST_MATCHES
    assert np.isnan(contradiction_m(wrong, told.of(once)))


def with_noise(told: Matches, px: float) -> Matches:
    rng = np.random.default_rng(0)
    first, second = (each + rng.normal(0, px, each.shape) for each in (told.first, told.second))
    return replace(told, first=first, second=second)


def facing(taken: Taken, told: Matches) -> Matches:
    """Those of places that both photos could see."""
    points = met(Rig.of(taken.cameras), told).points
    eyes = np.stack([camera.position for camera in taken.cameras])[told.views]
    ways = eyes - points[:, None]
    ways /= np.linalg.norm(ways, axis=2, keepdims=True)
    return told.of(np.einsum("mvi,mi->mv", ways, told.normals).min(axis=1) > 0.5)


@pytest.mark.parametrize(
    ("lean_mm", "bend_mm", "is_told"), [(0, 0, False), (10, 0, False), (0, 5, True)]
)
def test_a_person_who_bends_from_photo_to_photo_is_told(taken, lean_mm, bend_mm, is_told):
    """One who leans is not: the cameras take that up, and nothing is off."""
    rng = np.random.default_rng(3)
    low, high = taken.mesh.bounds[:, 1]
    feet = taken.mesh.vertices - (0.0, low, 0.0)
    height = feet[:, 1:2] / (high - low)
    moved = []
    for _ in taken.cameras:
        lean, bend = 1e-3 * rng.normal(size=(2, 3)) * (1, 0, 1)
        turn = Rotation.from_rotvec(lean_mm * lean / (high - low)).as_matrix()
        moved.append(feet @ turn.T - feet + bend_mm * np.sin(np.pi * height) * bend)
    told = facing(taken, with_noise(exact_matches(taken, 8000, moved), 0.1))
    rig = replace(Rig.of(taken.cameras), points=landmarks())
    rig = solved(rig, [MatchRows(told)], 20).rig
    bent, apart = swayed(rig, told)
    assert (bent > 5.0) is is_told
    assert (bent < 2.0) is not is_told
    assert (apart > 1.2) is is_told
    assert (0.8 < apart < 1.05) is not is_told
    assert any("swayed" in text for text in check_matches(rig, told)) is is_told


def test_covariances_tell_what_is_left(taken):
    """Noise of a third of a pixel: errors are as large as the covariances say."""
    noisy = with_noise(exact_matches(taken, 1200), 0.2)
    known = Rig.of(taken.cameras)
    found = solved(known, [MatchRows(noisy)], 20)
    own, factor_sd = spreads(found)
    off = errors_deg(found.rig.cameras(sizes(taken)), taken.cameras)
    sd = turn_sds_deg(own)
    assert factor_sd == 0.0
    assert 0.1 < np.median(off / sd) < 1.5


def test_cameras_that_are_left_open_are_refused_and_weak_ones_told():
    some = {"0.png": 0.2, "1.png": 0.3, "2.png": 0.4}
    assert check_sure(some, 0.0009, ()) == ()
    (text,) = check_sure({**some, "1.png": 0.62}, 0.0009, ())
    assert text == "cameras are weak, sure to 0.6 degrees only: 1.png"
    with pytest.raises(MethodError, match=r"got 1.2 degrees, 0.5 mm; 3.png: it moved\)"):
        check_sure({**some, "1.png": 1.23, "2.png": 1.5}, 0.0005, ["3.png: it moved"])
    half = dict.fromkeys(some, 0.6)
    assert "weak" in check_sure(half, 0.0007, ())[0]
    assert "weak" in check_sure(half, np.nan, ())[0]
    with pytest.raises(
        MethodError, match=r"or to 0.5 where matches miss by 0.8 mm; got 0.6 degrees, 0.9 mm"
    ):
        check_sure(half, 0.0009, ())


def test_too_few_photos_and_nobody_in_them(taken):
    focal = given_focal(taken)
    with pytest.raises(MethodError, match="expected 5 to 64; got 4"):
        estimate.estimate_cameras(
            taken.photos[:4],
            focal=Focal(focal.px[:4]),
            height_m=1.7,
            landmarks=taken.marks.at(range(4)),
        )
    nobody = Detections(
        taken.marks.pixels,
        taken.marks.points_camera,
        np.where(np.arange(8)[:, None] < 4, 0.0, taken.marks.confidence),
        taken.marks.hands,
    )
    with pytest.raises(MethodError, match="3.png: no person was detected"):
        estimate.estimate_cameras(taken.photos, focal=focal, height_m=1.7, landmarks=nobody)


def test_the_order_of_photos_plays_no_role(taken):
    order = [3, 0, 7, 5, 1, 2, 6, 4]
    focal = given_focal(taken)
    one = estimate._group(taken.photos, focal, taken.marks)
    other = estimate._group(
        [taken.photos[n] for n in order],
        Focal(tuple(focal.px[n] for n in order)),
        taken.marks.at(order),
    )
    assert [photo.name for photo in one.photos] == [photo.name for photo in other.photos]
    assert np.array_equal(one.told.pixels, other.told.pixels)


def test_values_are_checked():
    with pytest.raises(DataError, match="is not a photo with a mask"):
        PhotoView("a.png", np.zeros((4, 4, 3), np.uint8))
    with pytest.raises(DataError, match="focal lengths are not usable"):
        Focal((100.0, -1.0))

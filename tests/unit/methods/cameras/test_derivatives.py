"""Exact derivatives against differences, and what exact cameras leave."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from methods.cameras.adjustment import Block, Rig, solved
from methods.cameras.coherence import DistanceMap, OutlineRows, distance_map
from methods.cameras.landmarks import LandmarkRows, landmark_spans
from methods.cameras.matches import Matches, MatchRows, contradiction_m, met
from methods.stereo.membrane import Neighbourhood
from methods.stereo.narrow import outward
from tests.unit.methods.cameras.conftest import Taken, around, errors_deg, turned

STEP = 1e-6


def with_points(taken: Taken) -> Rig:
    """The true cameras, with points off the landmarks."""
    rng = np.random.default_rng(2)
    return replace(Rig.of(taken.cameras), points=rng.normal(0, 0.3, (33, 3)), factor_sd=0.1)


def differences(block: Block, rig: Rig, unknowns: np.ndarray) -> np.ndarray:
    columns = []
    for unknown in unknowns:
        step = np.zeros(rig.size)
        step[unknown] = STEP
        ahead, behind = block.rows(rig.moved(step)), block.rows(rig.moved(-step))
        columns.append((ahead.residuals - behind.residuals) / (2 * STEP))
    return np.stack(columns, axis=1)


def exact_matches(
    taken: Taken, count: int = 600, moved: Sequence[np.ndarray] | None = None
) -> Matches:
    """Places of the figure in each pair of neighbouring photos; what hides them does not count.

    In each photo all vertices may have ``moved`` by (N, 3) metres.
    """
    rng = np.random.default_rng(4)
    rows = rng.choice(len(taken.mesh.vertices), count, replace=False)
    points = taken.mesh.vertices[rows]
    yaws = np.argsort([np.arctan2(c.position[0], c.position[2]) for c in taken.cameras])
    ring = list(zip(yaws, np.roll(yaws, -1), strict=True))
    # Each place in two pairs.
    parts = [
        (np.tile(pair, (len(mine), 1)), mine)
        for number, pair in enumerate(ring)
        for mine in (np.flatnonzero(np.isin(np.arange(count) % 8, (number, (number + 1) % 8))),)
    ]
    views, place = (np.concatenate([part[k] for part in parts]) for k in (0, 1))
    by = moved or [np.zeros_like(taken.mesh.vertices)] * len(taken.cameras)
    seen = [c.project(points + m[rows])[0] for c, m in zip(taken.cameras, by, strict=True)]
    first, second = (
        np.stack([seen[v][p] for v, p in zip(views[:, k], place, strict=True)]) for k in (0, 1)
    )
    normals = outward(Neighbourhood(taken.mesh))[rows]
    return Matches(views, first, second, place, normals[place])


def test_landmarks(taken):
    rig = with_points(taken)
    block = LandmarkRows(taken.marks, landmark_spans(rig), 0.015)
    unknowns = np.array([0, 4, 5, 8, 11, 47, 48, 49 + 3 * 23, 50 + 3 * 24, 51 + 3 * 7])
    exact = block.rows(rig).jacobian.toarray()[:, unknowns]
    assert np.allclose(exact, differences(block, rig, unknowns), rtol=1e-4, atol=1e-3)


def test_matches(taken):
    rig = replace(Rig.of(taken.cameras), factor_sd=0.1)
    block = MatchRows(exact_matches(taken))
    unknowns = np.arange(rig.size)
    exact = block.rows(rig).jacobian.toarray()
    assert np.allclose(exact, differences(block, rig, unknowns), rtol=1e-4, atol=0.05)
    assert np.abs(exact).max() > 100


def outlines(taken: Taken, rig: Rig) -> OutlineRows:
    maps = [
        distance_map(photo, span, 0.001)
        for photo, span in zip(taken.photos, landmark_spans(rig), strict=True)
    ]
    return OutlineRows.of(maps, 60, (np.zeros(3), 0.8), 0.008)


def test_outlines():
    """On outlines whose distance has a slope everywhere: circles of unequal size."""
    cameras = around(6, (200, 200), 2)
    y, x = np.indices((200, 200)) + 0.5
    angles = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    maps = []
    for number, camera in enumerate(cameras):
        middle, radius = camera.project(np.zeros((1, 3)))[0][0], 30.0 + 2.0 * number
        values = 0.01 * (radius - np.hypot(x - middle[0], y - middle[1]))
        contour = middle + radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        one, none = np.ones(2), np.zeros(2)
        maps.append(DistanceMap(values.astype(np.float32), one, none, 0.01, contour))
    rig = replace(Rig.of(cameras), points=np.zeros((1, 3)), factor_sd=0.1)
    block = OutlineRows.of(maps, 60, (np.zeros(3), 0.8), 0.008)
    missed = block.held(rig).value < -0.002
    exact = block.rows(rig).jacobian.toarray()[missed[block.held(rig).value < 0], : 6 * 6 + 1]
    step, columns = 3e-4, []
    for unknown in range(6 * 6 + 1):
        by = np.zeros(rig.size)
        by[unknown] = step
        ahead, behind = block.held(rig.moved(by)), block.held(rig.moved(-by))
        columns.append((ahead.value - behind.value)[missed] / (2 * step))
    wanted = np.stack(columns, axis=1)
    off = np.abs(exact - wanted).max(axis=1) / np.abs(wanted).max(axis=1)
    assert len(off) > 100
    assert np.median(off) < 0.02
    assert np.mean(off < 0.1) > 0.9


def test_exact_cameras_leave_nothing_in_outlines(taken):
    rig = replace(Rig.of(taken.cameras), points=np.zeros((1, 3)))
    right = outlines(taken, rig).held(rig).missed_m
    wrong = replace(Rig.of(turned(taken.cameras, 1.0, 1)), points=np.zeros((1, 3)))
    assert right < 0.0003
    assert outlines(taken, rig).held(wrong).missed_m > 5 * right


def test_exact_matches_bring_cameras_back(taken):
    """From five degrees off to a hundredth."""
    told = exact_matches(taken)
    start = Rig.of(turned(taken.cameras, 5.0, 6))
    known = Rig.of(taken.cameras)
    assert np.abs(met(known, told).off_px).max() < 1e-6
    assert contradiction_m(known, told) < 1e-9
    found = solved(start, [MatchRows(told)], 60).rig
    sizes = [camera.size for camera in taken.cameras]
    assert errors_deg(start.cameras(sizes), taken.cameras).max() > 2.0
    assert errors_deg(found.cameras(sizes), taken.cameras).max() < 0.01


def test_focal_length_is_found_from_matches(taken):
    told = exact_matches(taken)
    start = Rig.of(turned(taken.cameras, 2.0, 7))
    start = replace(start, base_focal=start.base_focal * 0.9, factor_sd=0.3)
    found = solved(start, [MatchRows(told)], 100).rig
    assert found.focal[0, 0] == pytest.approx(taken.cameras[0].K[0, 0], rel=0.01)

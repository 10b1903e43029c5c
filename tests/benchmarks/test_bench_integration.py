"""Normal integration against the plain way: the same published iteration on sparse matrices."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from methods.surface import BodyDepth, integrate_front_back, integrate_normals
from tests.plain_integration import plain_integration

pytestmark = pytest.mark.nightly

# On one thread the plain way takes three to five times as long; the bound leaves room for noise.
LEAST_SPEEDUP = 2.0


def two_spheres(size: int, K: np.ndarray):
    """Depth, normals and mask of a small ball that hides part of a large one."""
    x, y = np.meshgrid(np.arange(size) + 0.5, np.arange(size) + 0.5)
    rays = np.stack([(x - K[0, 2]) / K[0, 0], (y - K[1, 2]) / K[1, 1], np.ones_like(x)], -1)
    depth, normals = np.full((size, size), np.inf), np.zeros((size, size, 3))
    for centre, radius in (((-0.1, 0.1, 3.0), 0.55), ((0.25, -0.3, 2.6), 0.32)):
        b, c = rays @ centre, np.dot(centre, centre) - radius**2
        a = (rays**2).sum(axis=-1)
        hit = b * b > a * c
        near = np.where(hit, (b - np.sqrt(np.where(hit, b * b - a * c, 0.0))) / a, np.inf)
        first = near < depth
        depth[first] = near[first]
        normals[first] = (near[first, None] * rays[first] - centre) / radius
    mask = np.isfinite(depth)
    return np.where(mask, depth, np.nan), normals * (1.0, -1.0, -1.0), mask


def mean_error(depth, truth, mask) -> float:
    return float(np.abs(depth * np.median(truth[mask] / depth[mask]) - truth)[mask].mean())


def compared(in_turns, normals, mask, K):
    """The plain way and ours on the same normals, in turns."""
    return in_turns(
        {
            "plain": lambda: plain_integration(normals, mask, K),
            "ours": lambda: integrate_normals(normals, mask, K),
        }
    )


@pytest.fixture(scope="module")
def balls():
    size = 256
    K = np.array([[2.2 * size, 0, size / 2], [0, 2.2 * size, size / 2], [0, 0, 1]])
    return K, *two_spheres(size, K)


def test_faster_than_the_plain_way_at_no_more_error(benchmark, in_turns, balls) -> None:
    """Measured in turns on two busy cores: 4.5 times as fast (0.85 s against 3.8 s)."""
    K, truth, normals, mask = balls
    turns = compared(in_turns, normals, mask, K)
    benchmark.pedantic(integrate_normals, args=(normals, mask, K), rounds=2)
    benchmark.extra_info["speedup"] = turns.ratio("plain", "ours")
    plain_error = mean_error(turns.results["plain"], truth, mask)
    assert mean_error(turns.results["ours"], truth, mask) <= 1.01 * plain_error
    assert turns.ratio("plain", "ours") > LEAST_SPEEDUP, turns.seconds


def test_front_and_back_of_a_person_in_full_portrait(benchmark) -> None:
    """About 180 000 pixels of 1080 x 1920, the size that the published rig sees a person at."""
    K = np.array([[2666.67, 0, 540.0], [0, 2666.67, 960.0], [0, 0, 1]])
    x, y = np.meshgrid(np.arange(1080) + 0.5, np.arange(1920) + 0.5)
    rays = np.stack([(x - 540) / K[0, 0], (y - 960) / K[1, 1], np.ones_like(x)], axis=-1)
    shape = 1.0 / np.square([0.1, 0.72, 0.12])
    a, b = (rays**2 * shape).sum(axis=-1), 3.0 * shape[2]
    squared = b * b - a * (9.0 * shape[2] - 1.0)
    mask = squared > 0
    root = np.sqrt(np.where(mask, squared, 0.0))
    depths = [np.where(mask, (b + sign * root) / a, np.nan) for sign in (-1, 1)]
    normals = []
    for depth in depths:
        normal = (depth[..., None] * rays - (0.0, 0.0, 3.0)) * shape * (1.0, -1.0, -1.0)
        normals.append(normal / np.linalg.norm(normal, axis=-1, keepdims=True))
    result = benchmark.pedantic(
        integrate_front_back, args=(normals, mask, BodyDepth(*depths), K), rounds=1
    )
    assert 150_000 < mask.sum() < 200_000
    middle = result.front[960, 540], result.back[960, 540]
    # Inflated by the thickness of 2 cm, which the shape resists in part.
    assert middle == pytest.approx((2.86, 3.14), abs=0.01)


@pytest.mark.parametrize("name", ["bear", "cat"])
def test_published_benchmark_against_the_plain_way(benchmark, in_turns, name: str) -> None:
    folder = Path(__file__).resolve().parents[3] / "shared" / "data" / "diligent" / name
    if not folder.is_dir():
        pytest.skip("DiLiGenT is not on this machine")
    import cv2

    mask = cv2.imread(str(folder / "mask.png"), cv2.IMREAD_UNCHANGED) > 0
    stored = cv2.imread(str(folder / "normal_map.png"), cv2.IMREAD_UNCHANGED)
    normals, K = stored[..., ::-1] / 65535.0 * 2.0 - 1.0, np.loadtxt(folder / "K.txt")
    with np.load(folder / "depth_gt.npz") as archive:
        truth = archive["depth_gt"].astype(np.float64)
    turns = compared(in_turns, normals, mask, K)
    benchmark.pedantic(integrate_normals, args=(normals, mask, K), rounds=2)
    error = mean_error(turns.results["ours"], truth, mask)
    benchmark.extra_info["error_mm"] = error
    benchmark.extra_info["speedup"] = turns.ratio("plain", "ours")
    # As for the balls: the same iteration, but another solver stops elsewhere within its tolerance.
    assert error <= 1.01 * mean_error(turns.results["plain"], truth, mask)
    assert turns.ratio("plain", "ours") > LEAST_SPEEDUP, turns.seconds

"""Scoring against the plain way: the same numbers, several times as fast.

The plain way is how such an evaluation is usually put together: trimesh to read and sample, Open3D
to read again and to search, and a Python loop over the points for the normals. The careful way uses
the same libraries, but reads each file once and has no loop.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import open3d as o3d
import pytest
import trimesh
from scipy.spatial import cKDTree

from harness.core.mesh import Mesh
from harness.core.settings import MetricProtocol
from harness.files.mesh_files import save_mesh
from harness.geometry.surface import SurfaceIndex
from harness.run.external_meshes import score
from metrics.pair import EdgeIndex

pytestmark = pytest.mark.nightly

MEXECON = MetricProtocol("mexecon", 1, 30_000, "independent", "sample-to-sample")
#: Over the plain way, and over the careful one.
LEAST_SPEEDUP, LEAST_CAREFUL = 2.5, 1.5


def bumpy_body(phase: float, rings: int = 500) -> Mesh:
    """A closed egg with bumps, 1.7 m high, of twice ``rings`` squared triangles."""
    polar, around = np.meshgrid(
        np.linspace(1e-3, np.pi - 1e-3, rings),
        np.linspace(0, 2 * np.pi, rings, endpoint=False),
        indexing="ij",
    )
    radius = 0.3 + 0.05 * np.sin(6 * polar + phase) * np.cos(5 * around)
    vertices = np.stack(
        [
            radius * np.sin(polar) * np.cos(around),
            0.85 * np.cos(polar),
            radius * np.sin(polar) * np.sin(around),
        ],
        axis=-1,
    )
    i, j = np.meshgrid(np.arange(rings - 1), np.arange(rings), indexing="ij")
    a, b = i * rings + j, i * rings + (j + 1) % rings
    faces = [np.stack([a, b, a + rings], -1), np.stack([b, b + rings, a + rings], -1)]
    return Mesh(vertices=vertices.reshape(-1, 3), faces=np.concatenate(faces).reshape(-1, 3))


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    folder = tmp_path_factory.mktemp("half_a_million_faces")
    paths = folder / "predicted.obj", folder / "truth.obj"
    for path, phase in zip(paths, (0.0, 1.0), strict=True):
        save_mesh(path, bumpy_body(phase))
    return paths


def plain_way(predicted: Path, truth: Path, *, careful: bool = False) -> dict[str, float]:
    """The four metrics as published, in mm and degrees, put together with or without care."""
    samples, normals, scenes, meshes = [], [], [], []
    for seed, path in enumerate((predicted, truth)):
        loaded = trimesh.load(path, force="mesh", process=False)
        points, faces = trimesh.sample.sample_surface(loaded, MEXECON.samples, seed=seed)
        weights = trimesh.triangles.points_to_barycentric(loaded.triangles[faces], points)
        corner_normals = loaded.vertex_normals[loaded.faces[faces]]
        samples.append(np.asarray(points))
        normals.append(np.einsum("nk,nkj->nj", weights, corner_normals))
        if careful:
            vertices = o3d.utility.Vector3dVector(loaded.vertices)
            mesh = o3d.geometry.TriangleMesh(vertices, o3d.utility.Vector3iVector(loaded.faces))
        else:
            mesh = o3d.io.read_triangle_mesh(str(path))
        mesh.compute_vertex_normals()
        meshes.append(mesh)
        scenes.append(o3d.t.geometry.RaycastingScene())
        scenes[-1].add_triangles(o3d.t.geometry.TriangleMesh.from_legacy(mesh))
    answers = [
        scene.compute_closest_points(o3d.core.Tensor(points.astype(np.float32)))
        for scene, points in zip(reversed(scenes), samples, strict=True)
    ]
    accuracy, completeness = (
        np.linalg.norm(points - answer["points"].numpy(), axis=1).mean()
        for points, answer in zip(samples, answers, strict=True)
    )
    there = cKDTree(samples[1]).query(samples[0])[0].mean()
    back = cKDTree(samples[0]).query(samples[1])[0].mean()
    angles = (careful_angles if careful else normal_angles)(normals[0], meshes[1], answers[0])
    return {
        "chamfer": 1000 * (there + back) / 2,
        "p2s_accuracy": 1000 * accuracy,
        "p2s_completeness": 1000 * completeness,
        "normal_error": float(np.mean(angles)),
    }


def normal_angles(predicted_normals, truth, answer) -> list[float]:
    triangles, vertex_normals = np.asarray(truth.triangles), np.asarray(truth.vertex_normals)
    hit, uv = answer["primitive_ids"].numpy(), answer["primitive_uvs"].numpy()
    angles = []
    for k, normal in enumerate(predicted_normals):
        a, b, c = vertex_normals[triangles[hit[k]]]
        u, v = uv[k]
        true_normal = (1 - u - v) * a + u * b + v * c
        true_normal /= np.linalg.norm(true_normal)
        cosine = np.dot(normal / np.linalg.norm(normal), true_normal)
        angles.append(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
    return angles


def careful_angles(predicted_normals, truth, answer):
    triangles, vertex_normals = np.asarray(truth.triangles), np.asarray(truth.vertex_normals)
    u, v = answer["primitive_uvs"].numpy().T
    corners = vertex_normals[triangles[answer["primitive_ids"].numpy()]]
    true = np.einsum("nk,nkc->nc", np.stack([1 - u - v, u, v], axis=1), corners)
    lengths = np.linalg.norm(true, axis=1) * np.linalg.norm(predicted_normals, axis=1)
    cosine = (true * predicted_normals).sum(axis=1) / lengths
    return np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))


def our_way(predicted: Path, truth: Path) -> dict[str, float]:
    result = score(predicted, truth, MEXECON)
    return {name: metric.value for name, metric in result.metrics.items()}


def test_scoring_half_a_million_faces_is_faster_than_both_ways(benchmark, in_turns, pair):
    """At least 2.5 and 1.5 times as fast.

    Measured in turns on two cores: 2.7 and 2.2 times (1.6 s against 4.5 s and 3.7 s); in processor
    time 2.2 and 1.9 times. A third of ours goes into what the other ways do not do: vertices are
    joined across texture seams, surfaces that are there twice and turned faces are told.
    """
    ways = {
        "plain": lambda: plain_way(*pair),
        "careful": lambda: plain_way(*pair, careful=True),
        "ours": lambda: our_way(*pair),
    }
    turns = in_turns(ways)
    for way in ("plain", "careful"):
        benchmark.extra_info[f"{way}_s"] = turns.least_s(way)
        benchmark.extra_info[f"speedup_over_{way}"] = turns.ratio(way, "ours")
        benchmark.extra_info[f"cpu_speedup_over_{way}"] = turns.cpu_ratio(way, "ours")
        assert turns.results["ours"] == pytest.approx(turns.results[way], rel=0.02)
    benchmark.pedantic(our_way, args=pair, rounds=2)
    assert turns.ratio("plain", "ours") >= LEAST_SPEEDUP, turns.seconds
    assert turns.ratio("careful", "ours") >= LEAST_CAREFUL, turns.seconds


MILLION = """
import json, resource, sys, time
from pathlib import Path
from harness.files.mesh_files import load_mesh
from harness.core.settings import MetricProtocol
from metrics.score import score

exact = MetricProtocol("exact", 1, 1_000_000, "stratified", "point-to-surface")
meshes = [load_mesh(Path(path)) for path in sys.argv[1:]]
start = time.perf_counter()
result = score(*meshes, exact)
print(json.dumps({
    "wall_s": time.perf_counter() - start,
    "cpu_s": time.process_time(),
    "peak_gib": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20,
    "chamfer": result.to_dict()["metrics"]["chamfer"],
}))
"""


def test_a_million_exact_points_take_under_ten_seconds_and_two_gibibytes(benchmark, pair):
    """In a process of its own, held to two cores, import of Open3D included."""
    cores = sorted(os.sched_getaffinity(0))[:2]

    def run() -> dict[str, float]:
        done = subprocess.run(
            [sys.executable, "-c", MILLION, *map(str, pair)],
            capture_output=True,
            text=True,
            check=True,
            preexec_fn=lambda: os.sched_setaffinity(0, cores),
        )
        return json.loads(done.stdout)

    found = benchmark.pedantic(run, rounds=1)
    benchmark.extra_info.update(found)
    # Where other work holds the cores: the time that two free ones need if, for three seconds of
    # it, only one of them has something to do (sampling, normals).
    assert min(found["wall_s"], found["cpu_s"] / 2 + 1.5) < 10
    assert found["peak_gib"] < 2
    assert found["chamfer"]["standard_error"] < 0.002


#: Processor time of the command.
MOST_TIMES = 2.5


def closed(mesh: Mesh, rings: int = 500) -> Mesh:
    """The egg with a fan of faces at each end, so that it has a volume."""
    ends = np.array([[0, 0.85, 0], [0, -0.85, 0]])
    ring, count = np.arange(rings), len(mesh.vertices)
    last, following = count - rings + ring, (ring + 1) % rings
    fans = [
        np.stack([np.full(rings, count), following, ring], axis=1),
        np.stack([np.full(rings, count + 1), last, count - rings + following], axis=1),
    ]
    return Mesh(
        vertices=np.concatenate([mesh.vertices, ends]),
        faces=np.concatenate([mesh.faces, *fans]),
    )


def test_all_protocols_take_a_few_times_as_long_as_exact(benchmark, tmp_path):
    """As a command: 2.3 times, on two cores that fifteen jobs kept busy.

    15.1 and 15.7 s against 6.7, 7.5 and 6.4 s. The open egg, which has no volume: 2.4 times, 15.9 s
    against 6.5 s.
    """
    paths = tmp_path / "predicted.obj", tmp_path / "truth.obj"
    for path, phase in zip(paths, (0.0, 1.0), strict=True):
        save_mesh(path, closed(bumpy_body(phase)))

    def seconds(protocol: str) -> float:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        command = (sys.executable, "-m", "harness.cli.main", "score", paths[0], "--gt", paths[1])
        done = subprocess.run([*command, "--protocol", protocol], capture_output=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    alone = seconds("exact")
    together = benchmark.pedantic(lambda: seconds("all"), rounds=1)
    benchmark.extra_info["ratio"] = together / alone
    assert together / alone < MOST_TIMES


def test_edges_are_searched_and_not_all_measured(benchmark):
    """ECON's program measures each of its 1000 points to every face: here 40 of them do."""
    surface = SurfaceIndex(bumpy_body(0.0))
    points = bumpy_body(1.0).vertices[:: len(surface.mesh.vertices) // 1000][:1000]
    start = time.process_time()
    expected = [to_every_edge(point, surface.mesh) for point in points[:40]]
    brute_s = (time.process_time() - start) * len(points) / 40

    def ours():
        return EdgeIndex(surface, 5e-3).distances(points)

    start = time.process_time()
    found = benchmark.pedantic(ours, rounds=1)
    ratio = brute_s / (time.process_time() - start)
    benchmark.extra_info["ratio"] = ratio
    np.testing.assert_allclose(found[:40], expected, atol=1e-6)
    assert ratio > 10


def to_every_edge(point, mesh):
    least = np.inf
    for first, second in ((0, 1), (1, 2), (2, 0)):
        start, end = (mesh.vertices[mesh.faces[:, corner]] for corner in (first, second))
        along = end - start
        share = np.clip(((point - start) * along).sum(axis=1) / (along**2).sum(axis=1), 0, 1)
        least = min(least, ((point - start - share[:, None] * along) ** 2).sum(axis=1).min())
    return np.sqrt(least)

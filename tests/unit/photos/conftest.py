"""A person of ellipsoids, one arm up, photographed all round."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from harness.core.artifacts import Capture, image_name
from harness.core.files.atomic import write_json
from harness.core.files.hashing import file_sha256
from harness.core.mesh import Mesh
from harness.core.rigs import RingRig
from harness.geometry.images import save_png
from harness.geometry.raycast import Raycaster

RIG = RingRig(views=8, radius_m=3.0, pitch_deg=8.0, lens_mm=50.0)
SIZE = (90, 160)
#: Centre and radii, metres: head, trunk, raised left arm, right arm, legs.
PARTS = (
    ((0.0, 0.72, 0.02), (0.09, 0.12, 0.10)),
    ((0.0, 0.25, 0.0), (0.18, 0.36, 0.12)),
    ((0.22, 0.62, 0.0), (0.06, 0.36, 0.06)),
    ((-0.22, 0.22, 0.08), (0.07, 0.32, 0.09)),
    ((0.1, -0.45, 0.0), (0.09, 0.45, 0.09)),
    ((-0.1, -0.45, 0.06), (0.09, 0.45, 0.09)),
)


def ellipsoid(centre, radii, rings=12, sectors=18):
    polar = np.linspace(0, np.pi, rings)[1:-1]
    around = np.linspace(0, 2 * np.pi, sectors, endpoint=False)
    t, p = np.meshgrid(polar, around, indexing="ij")
    ring = np.stack([np.sin(t) * np.sin(p), np.cos(t), np.sin(t) * np.cos(p)], -1).reshape(-1, 3)
    points = np.vstack([[0, 1, 0], ring, [0, -1, 0]]) * radii + centre
    faces, last = [], len(points) - 1
    for k in range(sectors):
        n = (k + 1) % sectors
        faces += [(0, 1 + k, 1 + n), (last, last - sectors + n, last - sectors + k)]
        for r in range(rings - 3):
            a, b = 1 + r * sectors + k, 1 + r * sectors + n
            faces += [(a, a + sectors, b), (b, a + sectors, b + sectors)]
    return points, np.array(faces)


def person() -> Mesh:
    vertices, faces, start = [], [], 0
    for centre, radii in PARTS:
        points, triangles = ellipsoid(centre, radii)
        vertices.append(points)
        faces.append(triangles + start)
        start += len(points)
    return Mesh(np.vstack(vertices), np.vstack(faces))


def photographed(directory: Path, rig: RingRig = RIG) -> Capture:
    """A capture as a renderer leaves it."""
    caster, cameras = Raycaster(person()), rig.cameras(*SIZE)
    for view, camera in enumerate(cameras):
        alpha = np.round(255 * caster.coverage(camera)).astype(np.uint8)
        colour = np.full((*alpha.shape, 3), (180, 120, 90), np.uint8)
        colour[alpha == 0] = 0
        save_png(directory / image_name(view), np.dstack([colour, alpha]))
    names = [image_name(view) for view in range(len(cameras))]
    images = {name: file_sha256(directory / name) for name in names}
    capture = Capture("toy", "t", "r", "key", directory, cameras, provenance={"images": images})
    write_json(directory / "capture.json", capture.to_dict())
    return capture


@pytest.fixture(scope="session")
def native(tmp_path_factory) -> Capture:
    return photographed(tmp_path_factory.mktemp("native"))

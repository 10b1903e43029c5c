"""A small made-up dataset for the examples: three textured figures and a manifest.

Nothing is downloaded. The scans lie in the folder layout of THuman, and the recipe ``tiny``
photographs them by ray casting, so that no example starts Blender.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from harness import Mesh, save_mesh

#: The subjects of the dataset ``toy`` and their heights in metres.
SUBJECTS = {"t1": 1.6, "t2": 1.7, "t3": 1.8}

_MANIFEST = """\
schema: 1
datasets:
  toy:
    title: Toy figures
    kind: thuman
    licence: CC0-1.0
    root: scans
    scale: metres
    facing: "+z"
    subjects: [t1, t2, t3]
rigs:
  ring8: {views: 8, radius_m: 3.0, lens_mm: 50.0, sensor_mm: 36.0}
recipes:
  tiny: {rig: ring8, width: 108, height: 192, renderer: raycast, minimum_mask_iou: 0.95}
protocols:
  exact: {version: 1, samples: 20000, sampling: stratified, chamfer: point-to-surface}
"""

#: Centre and radii of each body part, as shares of the figure's height.
_PARTS = (
    ((0.0, 0.92, 0.0), (0.07, 0.08, 0.08)),  # head
    ((0.0, 0.66, 0.0), (0.13, 0.20, 0.09)),  # torso
    ((-0.2, 0.62, 0.02), (0.045, 0.20, 0.045)),  # right arm
    ((0.2, 0.62, 0.02), (0.045, 0.20, 0.045)),  # left arm
    ((-0.08, 0.25, 0.0), (0.06, 0.25, 0.06)),  # right leg
    ((0.08, 0.25, 0.0), (0.06, 0.25, 0.06)),  # left leg
)


def ellipsoid(
    centre_m: tuple[float, float, float], radii_m: tuple[float, float, float], rings: int = 16
) -> Mesh:
    """A closed ellipsoid with texture coordinates, in metres."""
    v, u = np.meshgrid(np.linspace(0, 1, rings + 1), np.linspace(0, 1, rings + 1), indexing="ij")
    polar, around = np.pi * v, 2 * np.pi * u
    points = np.stack(
        [np.sin(polar) * np.sin(around), np.cos(polar), np.sin(polar) * np.cos(around)], axis=-1
    )
    index = np.arange((rings + 1) ** 2).reshape(rings + 1, rings + 1)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)]).reshape(-1, 3)
    return Mesh(
        vertices=points.reshape(-1, 3) * radii_m + centre_m,
        faces=faces,
        uv=np.stack([u, 1 - v], axis=-1).reshape(-1, 2).astype(np.float64),
        face_uv=faces,
    )


def figure(height_m: float, thicker_by_m: float = 0.0) -> Mesh:
    """A standing person of six ellipsoids, centred at the origin and facing +Z.

    Args:
        height_m: From the soles to the top of the head.
        thicker_by_m: Added to every radius, as a reconstruction that is too thick.
    """
    vertices: list[NDArray[np.float64]] = []
    faces: list[NDArray[np.int64]] = []
    uv: list[NDArray[np.float64]] = []
    for centre, radii in _PARTS:
        x, y, z = (height_m * value for value in centre)
        rx, ry, rz = (height_m * value + thicker_by_m for value in radii)
        part = ellipsoid((x, y - height_m / 2, z), (rx, ry, rz))
        faces.append(part.faces.astype(np.int64) + sum(map(len, vertices)))
        vertices.append(part.vertices)
        if part.uv is not None:
            uv.append(part.uv)
    joined = np.concatenate(faces)
    return Mesh(np.concatenate(vertices), joined, uv=np.concatenate(uv), face_uv=joined)


def make_world(folder: Path) -> None:
    """Write ``data_manifest.yaml`` and the scans of all subjects into a folder."""
    (folder / "data_manifest.yaml").write_text(_MANIFEST, encoding="utf-8")
    for subject, height_m in SUBJECTS.items():
        place = folder / "scans" / "model" / subject
        place.mkdir(parents=True)
        save_mesh(place / f"{subject}.obj", figure(height_m))
        (place / "material0.mtl").write_text("newmtl material0\nmap_Kd material0.jpeg\n")
        ramp = np.linspace(60, 220, 64, dtype=np.uint8)
        pixels = np.stack(np.broadcast_arrays(ramp[:, None], ramp[None], np.uint8(120)), axis=-1)
        Image.fromarray(np.ascontiguousarray(pixels)).save(place / "material0.jpeg")


def run_harness(world: Path, *arguments: str, on_path: Path | None = None) -> int:
    """Run ``harness ...`` in a folder as you would in a shell, print its output, return its code.

    Args:
        world: Folder with ``data_manifest.yaml``; receives ``captures/`` and ``runs/``.
        arguments: What follows ``harness`` on the command line.
        on_path: A folder of Python modules that the command can import.
    """
    # The world is the workspace, whatever else you work in.
    environment = {**os.environ, "HARNESS_WORKSPACE": str(world)}
    if on_path is not None:
        old = environment.get("PYTHONPATH")
        environment["PYTHONPATH"] = os.pathsep.join([str(on_path), *([old] if old else [])])
    print(f"$ harness {' '.join(arguments)}")
    done = subprocess.run(
        [sys.executable, "-m", "harness.cli.main", *arguments],
        cwd=world,
        env=environment,
        stdout=subprocess.PIPE,
        text=True,
        check=False,
    )
    print(done.stdout.replace(str(world.resolve()), "."))
    return done.returncode

"""A closed figure without any symmetry, with a texture of known colours, and a small recipe."""

import numpy as np
import pytest

from harness.core.artifacts import Scan
from harness.core.mesh import Mesh
from harness.core.rigs import RingRig
from harness.core.settings import RenderRecipe
from harness.geometry.images import save_png


@pytest.fixture(scope="session")
def figure(tmp_path_factory):
    """About 1.4 m high; bulges to the upper left of the front view, so a mirror image shows."""
    v, u = np.meshgrid(np.linspace(0, 1, 61), np.linspace(0, 1, 81), indexing="ij")
    polar, around = np.pi * v, 2 * np.pi * u
    direction = np.stack(
        [np.sin(polar) * np.sin(around), np.cos(polar), np.sin(polar) * np.cos(around)], axis=-1
    )
    bulge = np.exp(6 * (direction @ np.array([-0.6, 0.7, 0.4]) / 1.005 - 1))
    points = direction * [0.25, 0.7, 0.2] * (1 + 0.5 * bulge[..., None])
    points -= (points.reshape(-1, 3).min(0) + points.reshape(-1, 3).max(0)) / 2
    index = np.arange(v.size).reshape(v.shape)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)]).reshape(-1, 3)
    # Red at the top, green below: linear colours are then known at every height.
    colours = np.zeros((64, 64, 3), dtype=np.uint8)
    colours[:32], colours[32:] = (200, 30, 30), (30, 160, 30)
    texture = tmp_path_factory.mktemp("texture") / "texture.png"
    save_png(texture, colours)
    uv = np.stack([u, 1 - v], axis=-1).reshape(-1, 2)
    return Mesh(points.reshape(-1, 3), faces, uv, faces, texture, source="figure")


@pytest.fixture
def recipe():
    return RenderRecipe(
        "tiny",
        RingRig(views=3),
        108,
        192,
        renderer="raycast",
        light_strength=0.5,
        key_light_strength=0.5,
        minimum_mask_iou=0.98,
    )


@pytest.fixture
def scan(tmp_path):
    return Scan(
        dataset="toy",
        subject="t1",
        mesh_path=tmp_path / "t1.obj",
        scale_rule="metres",
        facing_rule="+z",
        scan_to_world=np.eye(4),
        sha256={"t1.obj": "0" * 64},
        warnings=("unusually small",),
    )

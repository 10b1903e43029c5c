"""A method from another package hands out normal maps; they come out as a table and a figure."""

from __future__ import annotations

import json
import os

import numpy as np
import pytest

from harness.files.mesh_files import load_mesh

PARTS = ("head", "torso", "dress", "dress", "legs", "legs")
MODULE = """
import numpy as np

from harness.core.artifacts import NormalMaps, Reconstruction
from harness.core.mesh import Mesh
from harness.core.protocols import Privilege
from harness.core.protocols import MethodInfo


class Peeking:
    info = MethodInfo("peeking", "Peeking", (0, 4), (), (Privilege.ORACLE_NORMALS,))

    def reconstruct(self, capture, context):
        maps = []
        for view in self.info.views:
            camera = capture.cameras[view].resized(216, 384)
            oracle = context.privileged["oracle_normals"]
            near, far = oracle(camera), oracle(camera, side="far")
            flat = np.where(near.any(axis=2)[..., None], [0.0, 0.0, 1.0], 0.0)
            maps.append(NormalMaps(view, camera, near.any(axis=2), near, far, flat, -flat))
        corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]) - 0.5
        faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
        return Reconstruction(Mesh(corners, faces), normals=tuple(maps))


peeking = Peeking()
"""


@pytest.fixture
def plugin(tmp_path_factory, monkeypatch):
    """A package with a method, on the path of the commands that are run."""
    folder = tmp_path_factory.mktemp("plugin")
    (folder / "peeking.py").write_text(MODULE)
    about = folder / "peeking-1.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: peeking\nVersion: 1\n")
    (about / "entry_points.txt").write_text("[harness.methods]\npeeking = peeking:peeking\n")
    monkeypatch.setenv("PYTHONPATH", str(folder), prepend=os.pathsep)


@pytest.mark.usefixtures("photographed")
@pytest.mark.nightly
@pytest.mark.usefixtures("plugin")
def test_from_maps_to_a_table_and_a_figure(world, eval_toy, harness):
    folder = world / "scans" / "model" / "t1"
    count = len(load_mesh(folder / "t1.obj").faces)
    names = tuple(dict.fromkeys(PARTS))
    labels = np.repeat([names.index(part) for part in PARTS], count // len(PARTS))
    np.savez(folder / "labels.npz", face_labels=labels.astype(np.int16), names=np.array(names))

    done = eval_toy("peeking,gt", "--subjects", "t1")
    assert done.returncode == 0, done.stderr
    report = harness("report", "--table", "normals", "--format", "json")
    assert report.returncode == 0, report.stderr
    document = json.loads(report.stdout)
    assert [row["title"].split(": ")[1] for row in document["rows"]] == [
        f"{photo} photo, {side} side" for side in ("near", "far") for photo in ("front", "back")
    ]
    for row in document["rows"]:
        cells = row["metrics"]
        assert cells["error"]["mean"] < 1e-3 < 20 < cells["body_error"]["mean"] < 60
        assert 0 < cells["pixels"]["mean"] < 5000
    assert any("Ground truth" in remark for remark in document["remarks"])

    drawn = harness("report", "--figure", "normals", "--method", "peeking", "-o", "normals.png")
    assert drawn.returncode == 0, drawn.stderr
    assert (world / "normals.png").stat().st_size > 10_000


@pytest.mark.usefixtures("measured")
@pytest.mark.nightly
def test_without_maps_the_table_and_the_figure_say_so(eval_toy, harness):
    assert eval_toy("gt", "--subjects", "t1").returncode == 0
    table, figure = (
        harness("report", "--table", "normals"),
        harness("report", "--figure", "normals"),
    )
    assert table.returncode == figure.returncode == 2
    assert "the method makes none" in table.stderr
    assert "no method has normal maps of all of t1" in figure.stderr

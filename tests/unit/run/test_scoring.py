"""Files made elsewhere are read with what their protocol needs."""

from dataclasses import replace

import numpy as np
import pytest

from harness.core.mesh import Mesh
from harness.core.settings import MetricProtocol
from harness.files.mesh_files import save_mesh
from harness.run.external_meshes import score

SPLIT = MetricProtocol("mexecon", 2, 3000, "independent", "sample-to-sample", texture_seams="split")


def roof() -> Mesh:
    """Two slopes that meet at a right angle, each with a texture of its own."""
    vertices = np.array([[0, 1, 0], [0, 1, 1], [1, 0, 0], [1, 0, 1], [-1, 0, 0], [-1, 0, 1.0]])
    faces = np.array([[0, 1, 3], [0, 3, 2], [1, 0, 4], [1, 4, 5]])
    return Mesh(
        vertices=vertices,
        faces=faces,
        uv=np.array([[0.25, 0.5], [0.75, 0.5]]),
        face_uv=np.repeat([[0], [0], [1], [1]], 3, axis=1),
    )


def test_the_seams_of_both_files_count_where_the_protocol_says_so(tmp_path):
    """No image is needed: seams are a matter of texture coordinates alone."""
    save_mesh(tmp_path / "textured.obj", roof())
    save_mesh(tmp_path / "plain.obj", roof().geometry())

    def error(predicted: str, truth: str, protocol: MetricProtocol) -> float:
        outcome = score(tmp_path / predicted, tmp_path / truth, protocol)
        return outcome.metrics["normal_error"].value

    smooth = replace(SPLIT, texture_seams="smooth")
    assert error("textured.obj", "textured.obj", SPLIT) == pytest.approx(0, abs=0.01)
    assert error("plain.obj", "textured.obj", SPLIT) > 15
    assert error("textured.obj", "plain.obj", SPLIT) > 15
    assert error("plain.obj", "textured.obj", smooth) == pytest.approx(0, abs=0.01)

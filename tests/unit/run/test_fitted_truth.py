"""The body of a scan's fit as its true body, where the model that it refers to is imported."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from harness.core.errors import DataError
from harness.core.mesh import Mesh
from harness.core.truth import true_body
from harness.data.manifest import load_manifest
from harness.run.sources import Source
from harness.run.workspace import Workspace
from methods.body.models.smplx_part import SMPLX
from methods.parts.kind import ImportOptions

SCALE, SHIFT, YAW = 0.47, np.array([0.3, -0.1, 0.2]), 0.6
MANIFEST = """\
schema: 1
datasets:
  t: {{title: T, kind: thuman, licence: own, root: {root}, scale: fit, facing: fit,
    subjects: ["0021", "0022"]}}
rigs: {{r: {{views: 8}}}}
recipes: {{tiny: {{rig: r, width: 54, height: 96, renderer: raycast}}}}
protocols: {{exact: {{version: 1, samples: 100, sampling: independent, chamfer: point-to-surface}}}}
"""


@pytest.fixture(scope="module")
def model(stand_in, tmp_path_factory) -> Path:
    return stand_in("licensed_files").write_smplx(tmp_path_factory.mktemp("m") / "SMPLX_MALE.npz")


@pytest.fixture
def posed(model) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and joints of the model, turned about its root, in a scan's units."""
    with np.load(model) as arrays:
        vertices = arrays["v_template"]
        joints = arrays["J_regressor"] @ vertices
    cos, sin = np.cos(YAW), np.sin(YAW)
    turn = np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]])
    return tuple(
        ((each - joints[0]) @ turn.T + joints[0]) * SCALE + SHIFT for each in (vertices, joints)
    )


@pytest.fixture
def source(stand_in, model, posed, tmp_path, monkeypatch) -> Source:
    monkeypatch.setenv("HARNESS_PARTS", str(tmp_path / "parts"))
    tree = stand_in("thuman_tree")
    with np.load(model) as arrays:
        faces = arrays["f"].astype(np.int64)
    # A scan has other vertices than its body: one more, which no face uses.
    points = np.concatenate([posed[0], posed[0][:1]])
    scan = Mesh(points, faces, uv=np.zeros((1, 2)), face_uv=0 * faces)
    for subject, shift in (("0021", SHIFT), ("0022", SHIFT + np.array([0.3, 0, 0]))):
        fit = tree.fit_bytes(SCALE, shift, global_orient=np.array([0, YAW, 0]))
        tree.write_subject(tmp_path, subject, scan, None, fit)
    path = tmp_path / "manifest.yaml"
    path.write_text(MANIFEST.format(root=tmp_path / tree.SCANS))
    return Source.select(load_manifest(path), Workspace(tmp_path), "t", (), "tiny")


def test_without_the_model_there_is_no_true_body(source):
    scan = source.locate("0021")
    assert scan.body_path is None
    assert scan.truth_identity() == scan.identity()


@pytest.mark.nightly
def test_the_fits_body_is_the_true_one(source, model, posed):
    SMPLX.add(model, ImportOptions())
    located, (scan, mesh) = source.locate("0021"), source.load("0021")
    assert scan.truth_identity() == located.truth_identity() != scan.identity()
    truth = true_body(scan)
    assert truth is not None
    place = scan.scan_to_world
    for found, given in zip((truth.vertices, truth.joints), posed, strict=True):
        np.testing.assert_allclose(found, given @ place[:3, :3].T + place[:3, 3], atol=1e-5)
    np.testing.assert_allclose(truth.vertices, mesh.vertices[:-1], atol=1e-5)
    assert truth.joint_names[:2] == ("pelvis", "left_hip")
    # It is made once.
    before = scan.body_path.stat().st_mtime_ns
    assert source.locate("0021").body_path.stat().st_mtime_ns == before
    off = source.locate("0022")
    assert off.body_path is None
    assert "off the scan on average, and is not taken" in off.warnings[-1]
    fit = source.root().parent / "THuman2.1_Release Smpl-X Paras_new/smplx/0021/smplx_param.pkl"
    fit.write_bytes(fit.read_bytes().replace(b"betas", b"beths"))
    with pytest.raises(DataError, match="fit cannot be read.*10 finite numbers 'betas'"):
        source.locate("0021")

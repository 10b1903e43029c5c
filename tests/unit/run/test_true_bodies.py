"""True bodies beside scans: those that the model gives, and those that were moved off it."""

from pathlib import Path

import numpy as np
import pytest

from harness.core.artifacts import Body, Scan
from harness.core.errors import DataError
from harness.core.truth import true_body, true_parameters
from harness.run.body_scores import _against_truth
from harness.run.calibration import true_posed

VERTICES = np.arange(12.0).reshape(4, 3)
JOINTS = np.arange(6.0).reshape(2, 3)


def scan_with(folder: Path, **more) -> Scan:
    path = folder / "body.npz"
    arrays = {
        "vertices": VERTICES,
        "joints": JOINTS,
        "joint_names": np.array(["hip", "knee"]),
        "pose_parameters": np.tile(np.eye(4), (2, 1, 1)),
        "phenotype": np.array([0.3]),
        "phenotype_names": np.array(["height"]),
    }
    np.savez(path, **arrays, **more)
    return Scan(
        dataset="d",
        subject="s01",
        mesh_path=folder / "s01.obj",
        scale_rule="metres",
        facing_rule="+z",
        sha256={},
        scan_to_world=np.eye(4),
        body_path=path,
    )


def fitted():
    return Body(
        model="anny",
        vertices=VERTICES + np.array([0.003, 0, 0]),
        faces=np.array([[0, 1, 2]]),
        joints=JOINTS + np.array([0.002, 0, 0]),
        joint_names=("hip", "knee"),
        main_joints=np.array([0, 1]),
    )


def test_a_body_of_the_model_has_no_distance_from_it(tmp_path):
    scan = scan_with(tmp_path)
    assert true_body(scan).off_model_mm == 0
    assert true_parameters(scan).off_model_m == 0
    assert set(_against_truth(fitted(), true_body(scan)).by_id()) == {"joint_error", "vertex_error"}


def test_a_body_off_the_model_says_how_far(tmp_path):
    scan = scan_with(tmp_path, off_model_rms_m=np.array(0.0061))
    assert true_body(scan).off_model_mm == pytest.approx(6.1)
    assert true_parameters(scan).off_model_m == pytest.approx(0.0061)
    found = _against_truth(fitted(), true_body(scan))
    assert found.off_model.value == pytest.approx(6.1)
    assert found.off_model.unit == "mm"
    assert found.joint_error.value == pytest.approx(2.0)
    assert found.vertex_error.value == pytest.approx(3.0)


def test_landmarks_are_not_learned_from_bodies_off_the_model(tmp_path):
    scan = scan_with(tmp_path, off_model_rms_m=np.array(0.0061))
    with pytest.raises(DataError, match=r"s01 is none that the body model can give.*6\.1 mm off"):
        true_posed(None, scan)

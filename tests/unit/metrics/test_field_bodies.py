"""MPJPE and its kin against closed forms and SciPy."""

import numpy as np
import pytest
from scipy.spatial import procrustes as scipy_procrustes
from scipy.spatial.transform import Rotation

from harness.core.errors import DataError
from metrics.body import BODY_PROTOCOLS, BodyPose, body_numbers

EMDB, THREEDPW14 = BODY_PROTOCOLS["body-emdb"], BODY_PROTOCOLS["body-3dpw14"]


STRAIGHT = np.eye(3)


def body(protocol, seed=0, turn=STRAIGHT, scale=1.0, shift=(0, 0, 0)):
    random = np.random.default_rng(seed)
    names = dict.fromkeys((*protocol.joints, *protocol.root))
    joints = random.normal(size=(len(names), 3)) * [0.3, 0.8, 0.2]
    vertices = random.normal(size=(500, 3)) * [0.3, 0.8, 0.2]
    spins = Rotation.random(len(names), random_state=seed).as_matrix()
    place = lambda points: scale * points @ turn.T + np.array(shift)  # noqa: E731
    return BodyPose(
        dict(zip(names, place(joints), strict=True)),
        place(vertices),
        dict(zip(names, turn @ spins, strict=True)),
    )


@pytest.mark.parametrize("protocol", [EMDB, THREEDPW14], ids=lambda each: each.name)
def test_a_shift_costs_nothing_and_a_similarity_nothing_after_procrustes(protocol):
    true = body(protocol)
    shifted = body_numbers(body(protocol, shift=(1, 2, 3)), true, protocol)
    assert all(value.value == pytest.approx(0, abs=1e-6) for value in shifted.values())
    turn = Rotation.from_euler("xyz", [10, 20, 30], degrees=True).as_matrix()
    similar = body_numbers(body(protocol, turn=turn, scale=1.2, shift=(1, 0, 0)), true, protocol)
    assert similar["mpjpe"].value > 50
    for name in ("pa_mpjpe", "pa_pve"):
        assert similar[name].value == pytest.approx(0, abs=1e-6)


def test_angles_are_those_of_the_turn_and_vanish_with_it():
    turn = Rotation.from_rotvec(np.radians(25) * np.array([0.6, 0.0, 0.8])).as_matrix()
    found = body_numbers(body(EMDB, turn=turn), body(EMDB), EMDB)
    assert found["mpjae"].value == pytest.approx(25)
    assert found["mpjae"].n == 9
    assert found["pa_mpjae"].value == pytest.approx(0, abs=1e-5)
    assert "mpjae" not in body_numbers(body(THREEDPW14), body(THREEDPW14), THREEDPW14)


def test_the_roots_differ_between_the_protocols():
    """EMDB's is between the hips, 3DPW's the pelvis: a moved pelvis moves all of the latter."""
    true = body(THREEDPW14)
    moved = BodyPose({**true.joints, "pelvis": true.joints["pelvis"] + [0.01, 0, 0]})
    assert body_numbers(moved, true, THREEDPW14)["mpjpe"].value == pytest.approx(10)
    true = body(EMDB)
    moved = BodyPose({**true.joints, "pelvis": true.joints["pelvis"] + [0.024, 0, 0]})
    assert body_numbers(moved, true, EMDB)["mpjpe"].value == pytest.approx(1)


def test_procrustes_is_scipys():
    mine, true = body(EMDB, 1), body(EMDB, 2)
    found = body_numbers(mine, true, EMDB)["pa_mpjpe"].value
    points = [np.stack([each.joints[name] for name in EMDB.joints]) for each in (true, mine)]
    first, second, _ = scipy_procrustes(*points)
    size = np.linalg.norm(points[0] - points[0].mean(axis=0))
    expected = 1000 * size * np.linalg.norm(first - second, axis=1).mean()
    # SciPy may mirror, which can only come nearer.
    assert found >= expected - 1e-6
    assert found < 1.3 * expected


def test_a_missing_joint_is_named():
    true = body(EMDB)
    joints = {name: place for name, place in true.joints.items() if name != "neck"}
    with pytest.raises(DataError, match="no neck"):
        body_numbers(BodyPose(joints), true, EMDB)

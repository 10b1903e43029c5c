"""Expected errors against true ones, on answers that are known."""

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from normal_training.learning.calibration import measured, write_reliability  # noqa: E402
from normal_training.learning.networks.network import Answer  # noqa: E402
from normal_training.learning.samples import Samples  # noqa: E402

SIZE = 32
TILTS_DEG = (10.0, 30.0)


class Guess(torch.nn.Module):
    """Answers with the body's normals, and expects to be off as it was told."""

    def __init__(self, expected_deg):
        super().__init__()
        self.chords = 2 * torch.sin(torch.deg2rad(torch.tensor(expected_deg)) / 2)

    def forward(self, image, mask, body_front, body_back):
        left = torch.arange(SIZE).view(1, 1, 1, SIZE) < SIZE // 2
        error = torch.where(left, self.chords[0], self.chords[1]).expand_as(mask)
        return Answer(body_front, body_back, error, error)


@pytest.fixture(name="samples", scope="module")
def _samples():
    draw = np.random.default_rng(0)
    angle = np.radians(np.where(np.arange(SIZE) < SIZE // 2, *TILTS_DEG))
    turn = draw.uniform(0, 2 * np.pi, (1, SIZE, SIZE))
    tilted = np.stack(
        [np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), np.cos(angle) + 0 * turn], -1
    )
    ahead = np.zeros((1, SIZE, SIZE, 3))
    ahead[..., 2] = 1.0
    arrays = {
        "rgb": np.zeros((1, SIZE, SIZE, 3), np.uint8),
        "mask": np.ones((1, SIZE, SIZE), bool),
        "front": np.round(127 * ahead).astype(np.int8),
        "back": np.round(-127 * ahead).astype(np.int8),
        "body_front": np.round(127 * tilted).astype(np.int8),
        "body_back": np.round(-127 * tilted).astype(np.int8),
    }
    return Samples([arrays], ["toy"])


def test_a_network_that_knows_its_error_is_on_the_diagonal(samples, tmp_path):
    front, back = measured(Guess(TILTS_DEG), samples)
    for side in (front, back):
        assert sum(part.pixels for part in side.bins) == SIZE * SIZE
        assert [round(part.actual_deg) for part in side.bins] == [10] * 5 + [30] * 5
        assert side.calibration_error_deg == pytest.approx(0.0, abs=0.3)
    write_reliability(tmp_path / "calibration.csv", (front, back))
    lines = (tmp_path / "calibration.csv").read_text().split()
    assert lines[0] == "side,expected_deg,actual_deg,pixels"
    assert len(lines) == 21


def test_one_that_is_too_sure_is_off_by_as_much(samples):
    front, _ = measured(Guess((5.0, 10.0)), samples)
    assert front.calibration_error_deg == pytest.approx((5 + 20) / 2, abs=0.3)

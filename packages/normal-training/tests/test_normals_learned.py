"""Both networks trained together: what each of them sees, is asked for, and learns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from normal_training.learning.batch_sampler import Drawer  # noqa: E402
from normal_training.learning.loop import judged, train  # noqa: E402
from normal_training.learning.networks.detailed import Detailed  # noqa: E402
from normal_training.learning.networks.export import export_network  # noqa: E402
from normal_training.learning.networks.learned import Together  # noqa: E402
from normal_training.learning.networks.network import NormalNetwork  # noqa: E402
from normal_training.learning.networks.starting import both_started_from  # noqa: E402
from normal_training.learning.samples import Samples  # noqa: E402
from normal_training.learning.settings import (  # noqa: E402
    FaultShares,
    NetworkPart,
    TrainingSettings,
    Turning,
    Windows,
)
from normal_training.learning.variations.drawing import drawn  # noqa: E402

HEIGHT, WIDTH = 192, 96
NEAR = Windows(near_px=(32, 64), near_count=3)
SETTINGS = TrainingSettings(steps=4, batch=2, judge_every=2, rate=3e-3, windows=NEAR)
TOGETHER = SETTINGS.of(NetworkPart.BOTH)
STILL = replace(TOGETHER, faults=FaultShares(0, 0, 0, 0, 0, 0, 0), turning=Turning(0.0), relit=0.0)


def tiny():
    return NormalNetwork(8, (16, 16, 16, 16))


@pytest.fixture(name="samples")
def _samples():
    """A wide body under cloth that leans backward by 25 degrees."""
    draw = np.random.default_rng(0)
    count = 3
    mask = np.zeros((count, HEIGHT, WIDTH), bool)
    mask[:, 30:170, 24:72] = True
    inside = mask[..., None]
    towards = np.zeros((count, HEIGHT, WIDTH, 3))
    towards[..., 2] = 1.0
    leaning = np.zeros_like(towards)
    leaning[..., 1], leaning[..., 2] = np.sin(np.radians(25)), np.cos(np.radians(25))

    def packed(normals):
        return np.round(127 * normals * inside).astype(np.int8)

    arrays = {
        "rgb": draw.integers(0, 256, (count, HEIGHT, WIDTH, 3), dtype=np.uint8) * inside,
        "mask": mask,
        "front": packed(leaning),
        "back": packed(-leaning),
        "body_front": packed(towards),
        "body_back": packed(-towards),
        "albedo": np.full((count, HEIGHT, WIDTH, 3), 128, np.uint8) * inside,
        "lights": np.full((count, HEIGHT, WIDTH, 4), 180, np.uint8) * inside,
        "coverage": np.full((count, HEIGHT, WIDTH), 255, np.uint8) * mask,
    }
    return Samples([arrays], ["toy"])


class Seen(NormalNetwork):
    """Keeps what it is given."""

    def __init__(self):
        super().__init__(8, (16, 16, 16, 16))
        self.given = []

    def forward(self, *scene):
        self.given.append(scene)
        return super().forward(*scene)


def test_the_first_one_sees_people_and_the_second_one_windows_of_them(samples):
    torch.manual_seed(0)
    together = Together(make=Seen)
    network = together.network()
    draw = torch.Generator().manual_seed(1)
    batch = drawn(samples, STILL, draw)
    assert batch.image.shape == (2, 3, HEIGHT, WIDTH)
    loss = together.loss(network, batch, STILL, draw)
    whole = network.first.whole.network.given[0]
    assert whole[0].shape == (2, 3, 2 * HEIGHT // 3, 2 * WIDTH // 3)
    (image, mask, front, _) = network.detail.given[0]
    # Three windows of each of two people, around pixels of theirs.
    assert image.shape == (6, 3, 64, 32)
    assert (mask.sum(dim=(1, 2, 3)) > 0).all()
    # At the start a network answers with the body, here seen from in front.
    towards = torch.tensor([0.0, 0.0, 1.0]).view(1, 3, 1, 1) * mask
    off = (front - towards).abs().amax(dim=1)
    # But at its corners, where enlarging it finds less of it.
    assert (off > 0.01).float().mean() < 0.001
    loss.backward()
    moved = [name for name, each in network.named_parameters() if each.grad is not None]
    assert any(name.startswith("detail.") for name in moved)
    assert any(name.startswith("first.whole.") for name in moved)


def test_the_loss_is_that_of_both_answers(samples):
    # Bodies as an answer: 25 degrees off on either side, for the first one and for the second.
    together = Together(make=tiny)
    draw = torch.Generator().manual_seed(1)
    weights = replace(STILL.losses, steps=0.0, expected=0.0)
    settings = replace(STILL, losses=weights)
    batch = drawn(samples, settings, draw)
    value = float(together.loss(together.network(), batch, settings, draw).detach())
    chord = 2 * np.sin(np.radians(25) / 2)
    assert value == pytest.approx(2 * (1 + weights.back) * chord, rel=0.02)


def test_nobody_in_the_picture_is_no_error(samples):
    together = Together(make=tiny)
    draw = torch.Generator().manual_seed(1)
    batch = drawn(samples, STILL, draw)
    empty = replace(batch, **{name: 0 * getattr(batch, name) for name in batch.__slots__})
    assert torch.isfinite(together.loss(together.network(), empty, STILL, draw))


@pytest.mark.nightly
def test_both_learn(samples, tmp_path):
    settings = replace(TOGETHER, steps=40, judge_every=40, batch=2, rate=5e-3)
    torch.manual_seed(0)
    trained = train(
        samples, samples, settings, tmp_path / "one", lambda *_: None, Together(make=tiny)
    )
    angles = judged(trained.network.cpu(), samples, torch.device("cpu"))
    assert angles.body_front_deg == pytest.approx(25.0, abs=0.5)
    assert angles.front_deg < 12.0
    assert bool(trained.device) == torch.cuda.is_available()


@pytest.mark.nightly
def test_a_file_of_two_is_where_both_start(tmp_path):
    torch.manual_seed(0)
    pair = Detailed(NormalNetwork(), NormalNetwork())
    with torch.no_grad():
        for parameter in pair.parameters():
            parameter.add_(0.01 * torch.randn_like(parameter))
    export_network(pair, tmp_path / "pair.onnx", {"name": "pair"})
    found = both_started_from(tmp_path / "pair.onnx")
    fresh = Detailed(NormalNetwork(), NormalNetwork())
    fresh.load_state_dict({**fresh.state_dict(), **found})
    for mine, yours in zip(pair.parameters(), fresh.parameters(), strict=True):
        torch.testing.assert_close(mine, yours, rtol=1e-3, atol=1e-4)


def test_what_is_picked_ahead_is_what_is_drawn_in_turn(samples):
    processor = torch.device("cpu")
    ahead, in_turn = (
        Drawer(samples, TOGETHER, processor, parts=2, ahead=ahead) for ahead in (True, False)
    )
    for step in (1, 2, 3):
        for part in (0, 1):
            (early, _), (late, _) = (each.batch(step, part) for each in (ahead, in_turn))
            assert len(early.mask) == 1
            for name in early.__slots__:
                assert torch.equal(getattr(early, name), getattr(late, name)), name


def test_windows_are_no_larger_than_the_sample(samples):
    settings = replace(STILL, windows=replace(STILL.windows, near_px=(128, 64)))
    draw = torch.Generator().manual_seed(1)
    network = Together(make=Seen).network()
    batch = drawn(samples, settings, draw)
    assert torch.isfinite(Together().loss(network, batch, settings, draw))
    image, mask, _, _ = network.detail.given[0]
    assert image.shape == (6, 3, 64, WIDTH)
    assert (mask.sum(dim=(1, 2, 3)) > 0).all()


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a graphics processor")
def test_a_graphics_processor_learns_the_same_again(samples, tmp_path):
    settings = replace(TOGETHER, steps=12, judge_every=6)
    trained = [
        train(samples, samples, settings, tmp_path / name, lambda *_: None, Together(seeded()))
        for name in "ab"
    ]
    first, second = (each.network.state_dict() for each in trained)
    for name, values in first.items():
        assert torch.equal(values, second[name]), name


def seeded():
    torch.manual_seed(3)
    return Detailed(NormalNetwork(), NormalNetwork()).state_dict()


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a graphics processor")
def test_a_graphics_processor_draws_what_the_processor_draws(samples):
    settings = replace(TOGETHER, relit=0.0, faults=replace(TOGETHER.faults, grain=0.0))
    here, there = (
        drawn(samples, settings, torch.Generator().manual_seed(7), torch.device(kind))
        for kind in ("cpu", "cuda")
    )
    for name in here.__slots__:
        off = (getattr(here, name) - getattr(there, name).cpu()).abs()
        # Where a turned rim is as near to inside as to outside, rounding decides.
        assert float((off > 0.02).float().mean()) < 0.002, name

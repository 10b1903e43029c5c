"""Training on toy samples: it learns, goes on where it stopped, and refuses what is not its own."""

from __future__ import annotations

import csv
from dataclasses import replace

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from harness.core.errors import DataError, HarnessError  # noqa: E402
from normal_training.learning import loop  # noqa: E402
from normal_training.learning.loop import judged, train  # noqa: E402
from normal_training.learning.networks.export import export_network  # noqa: E402
from normal_training.learning.networks.learned import Alone  # noqa: E402
from normal_training.learning.networks.network import Averaged, NormalNetwork  # noqa: E402
from normal_training.learning.networks.starting import blended, started_from  # noqa: E402
from normal_training.learning.samples import Samples  # noqa: E402
from normal_training.learning.settings import (  # noqa: E402
    FaultShares,
    TrainingSettings,
    Turning,
    Windows,
)
from normal_training.learning.variations.drawing import drawn  # noqa: E402

SIZE = 32
SETTINGS = TrainingSettings(steps=6, batch=2, judge_every=2, rate=3e-3)
STILL = replace(
    SETTINGS,
    faults=FaultShares(0, 0, 0, 0, 0, 0, 0),
    turning=Turning(0.0),
    windows=Windows(strip_px=SIZE),
    relit=0.0,
)


def toy(count=4, tilt_deg=25.0, seed=0):
    """Flat bodies under cloth that is tilted backward: the truth is the body's normal, turned."""
    draw = np.random.default_rng(seed)
    mask = np.zeros((count, SIZE, SIZE), bool)
    mask[:, 4:28, 8:28] = True
    towards = np.zeros((count, SIZE, SIZE, 3))
    towards[..., 2] = 1.0
    angle = np.radians(tilt_deg)
    tilted = np.zeros_like(towards)
    tilted[..., 1], tilted[..., 2] = np.sin(angle), np.cos(angle)
    inside = mask[..., None]
    arrays = {
        "rgb": draw.integers(0, 256, (count, SIZE, SIZE, 3), dtype=np.uint8) * inside,
        "mask": mask,
        "front": tilted * inside,
        "back": -tilted * inside,
        "body_front": towards * inside,
        "body_back": -towards * inside,
        "albedo": np.full((count, SIZE, SIZE, 3), 128, np.uint8) * inside,
        "lights": np.full((count, SIZE, SIZE, 4), 180, np.uint8) * inside,
        "coverage": np.full((count, SIZE, SIZE), 255, np.uint8) * mask,
    }
    return {
        name: np.round(127 * values).astype(np.int8) if values.dtype == float else values
        for name, values in arrays.items()
    }


@pytest.fixture(name="samples")
def _samples(tmp_path):
    np.savez(tmp_path / "toy.npz", key=np.array("toy"), **toy())
    return Samples.load([tmp_path / "toy.npz"])


def small():
    return NormalNetwork(8, (16, 16, 16, 16))


@pytest.fixture(autouse=True)
def _small(monkeypatch):
    monkeypatch.setattr(loop, "Alone", lambda: Alone(make=small))


def silent(steps, line):
    pass


@pytest.mark.nightly
def test_it_learns_a_tilt(samples, tmp_path):
    settings = TrainingSettings(steps=60, batch=4, judge_every=60, rate=5e-3)
    trained = train(samples, samples, settings, tmp_path / "run", silent)
    angles = judged(trained.network.cpu(), samples, torch.device("cpu"))
    assert angles.body_front_deg == pytest.approx(25.0, abs=0.5)
    assert angles.front_deg < 8.0
    assert angles.back_deg < 12.0


def test_a_stopped_training_goes_on_to_the_same_network(samples, tmp_path, monkeypatch):
    whole = train(samples, samples, SETTINGS, tmp_path / "whole", silent)

    class Stop(Exception):
        pass

    def stop_at_four(steps, line):
        if line.startswith("step 4"):
            raise Stop

    with pytest.raises(Stop):
        train(samples, samples, SETTINGS, tmp_path / "parts", stop_at_four)
    lines = []
    parts = train(
        samples, samples, SETTINGS, tmp_path / "parts", lambda steps, line: lines.append(line)
    )
    assert lines[0] == "going on after step 4"
    for mine, yours in zip(whole.network.parameters(), parts.network.parameters(), strict=True):
        torch.testing.assert_close(mine, yours, rtol=0, atol=1e-6)
    with parts.curve.open() as stream:
        assert [int(row["step"]) for row in csv.DictReader(stream)] == [2, 4, 6]


def test_a_repeated_training_gives_the_same_weights(samples, tmp_path):
    start = NormalNetwork(8, (16, 16, 16, 16)).state_dict()
    first, second = (
        train(samples, samples, SETTINGS, tmp_path / name, silent, Alone(start, small))
        for name in "ab"
    )
    other = train(
        samples, samples, replace(SETTINGS, seed=1), tmp_path / "c", silent, Alone(start, small)
    )
    for mine, yours in zip(first.network.parameters(), second.network.parameters(), strict=True):
        assert torch.equal(mine, yours)
    differ = [
        not torch.equal(mine, yours)
        for mine, yours in zip(first.network.parameters(), other.network.parameters(), strict=True)
    ]
    assert any(differ)


def test_another_training_is_not_gone_on_with(samples, tmp_path):
    train(samples, samples, SETTINGS, tmp_path, silent)
    other = TrainingSettings(steps=6, batch=2, judge_every=2, rate=1e-3)
    with pytest.raises(HarnessError, match="another training"):
        train(samples, samples, other, tmp_path, silent)


def test_a_damaged_checkpoint_is_refused(samples, tmp_path):
    (tmp_path / "checkpoint.pt").write_bytes(b"not a checkpoint")
    with pytest.raises(DataError, match="no checkpoint"):
        train(samples, samples, SETTINGS, tmp_path, silent)


def test_mirrored_samples_are_mirrored_scenes(samples):
    plain = samples.at(range(4))
    for seed in range(20):
        draw = torch.Generator().manual_seed(seed)
        batch = drawn(samples, replace(STILL, batch=4), draw)
        for name in ("front", "back", "body_front", "body_back"):
            normals = getattr(batch, name)
            # Tilted backward, not sideways: a mirror leaves the tilt, and the mask's offset moves.
            torch.testing.assert_close(
                normals.abs().amax((2, 3)),
                plain.front.abs().amax((2, 3))
                if name in ("front", "back")
                else plain.body_front.abs().amax((2, 3)),
            )
        left = batch.mask[:, 0, 16, 6] > 0
        assert torch.equal(left, batch.body_front[:, 2, 16, 6] != 0)
        assert batch.image[(batch.mask == 0).expand_as(batch.image)].abs().max() == 0


def test_a_mirror_turns_sideways_normals(tmp_path):
    arrays = toy(count=1)
    arrays["front"][..., 0], arrays["front"][..., 1] = arrays["front"][..., 1], 0
    np.savez(tmp_path / "side.npz", key=np.array("side"), **arrays)
    samples = Samples.load([tmp_path / "side.npz"])
    signs = set()
    for seed in range(12):
        batch = drawn(samples, replace(STILL, batch=1), torch.Generator().manual_seed(seed))
        mirrored = bool(batch.mask[0, 0, 16, 6] == 1)
        sign = float(batch.front[0, 0, 16, 16].sign())
        signs.add((mirrored, sign))
    assert signs <= {(False, 1.0), (True, -1.0)}
    assert len(signs) == 2


def test_files_of_other_sizes_or_kinds_are_refused(tmp_path):
    np.savez(tmp_path / "one.npz", key=np.array("one"), **toy())
    small = {name: values[:, ::2, ::2] for name, values in toy().items()}
    np.savez(tmp_path / "two.npz", key=np.array("two"), **small)
    with pytest.raises(DataError, match="different sizes"):
        Samples.load([tmp_path / "one.npz", tmp_path / "two.npz"])
    np.savez(tmp_path / "three.npz", rgb=np.zeros(3))
    with pytest.raises(DataError, match="holds no training samples"):
        Samples.load([tmp_path / "three.npz"])


def test_a_cut_keeps_the_maps_together(samples):
    for seed in range(5):
        batch = drawn(
            samples,
            replace(STILL, batch=4, windows=Windows(strip_px=16)),
            torch.Generator().manual_seed(seed),
        )
        assert batch.image.shape == (4, 3, SIZE, 16)
        assert torch.equal(batch.mask > 0, batch.body_front[:, 2:] != 0)


def test_what_is_seen_from_nearby_is_the_subject_in_as_many_pixels(tmp_path):
    arrays = {
        name: np.pad(values, [(0, 0), (64, 64), (32, 32)] + [(0, 0)] * (values.ndim - 3))
        for name, values in toy(count=6).items()
    }
    np.savez(tmp_path / "wide.npz", key=np.array("wide"), **arrays)
    samples = Samples.load([tmp_path / "wide.npz"])
    near = Windows(strip_px=64, near_share=1.0, near_px=(32, 40), rim_px=8)
    batch = drawn(samples, replace(STILL, windows=near), torch.Generator().manual_seed(0))
    # Two strips of 64 x 160 pixels, divided into windows of 32 x 40.
    assert batch.image.shape == (16, 3, 40, 32)
    # Each is around a pixel of the subject, of which few are in a strip.
    assert (batch.mask.sum(dim=(1, 2, 3)) > 0).all()
    strips = drawn(
        samples,
        replace(STILL, windows=replace(near, near_share=0.0)),
        torch.Generator().manual_seed(0),
    )
    assert batch.mask.mean() > 2 * strips.mask.mean()
    assert torch.equal(batch.mask > 0, batch.body_front[:, 2:] != 0)


def test_another_light_leaves_all_but_the_photo(samples):
    lit = replace(STILL, relit=1.0, batch=4)
    plain = drawn(samples, STILL, torch.Generator().manual_seed(3))
    first, second = (drawn(samples, lit, torch.Generator().manual_seed(seed)) for seed in (3, 4))
    assert plain.image.shape[1:] == first.image.shape[1:]
    inside = (first.mask > 0).expand_as(first.image)
    assert not first.image[~inside].any()
    # One albedo and the same light everywhere: an even picture, of another brightness each time.
    means = {round(float(picture[:, 4:28, 8:24].mean()), 2) for picture in first.image}
    means |= {round(float(picture[:, 4:28, 8:24].mean()), 2) for picture in second.image}
    assert len(means) > 4
    turned = first.front[first.front_inside.expand_as(first.front) > 0].abs().unique()
    assert len(turned) <= 3


@pytest.mark.nightly
def test_a_training_starts_from_a_network_of_fewer_blocks(tmp_path):
    torch.manual_seed(0)
    shallow = NormalNetwork(depths=(1, 2, 2, 2), lifted=(1, 1, 1), sharp=(0, 0))
    with torch.no_grad():
        for parameter in shallow.parameters():
            parameter.add_(0.01 * torch.randn_like(parameter))
    export_network(Averaged(shallow), tmp_path / "shallow.onnx", {"name": "shallow"})
    found = started_from(tmp_path / "shallow.onnx")
    deep = NormalNetwork()
    deep.load_state_dict({**deep.state_dict(), **found})
    assert len(deep.state_dict()) > len(found)
    scene = [torch.randn(1, channels, 64, 32) for channels in (3, 1, 3, 3)]
    with torch.no_grad():
        for mine, yours in zip(deep(*scene), shallow.eval()(*scene), strict=True):
            torch.testing.assert_close(mine, yours, rtol=0, atol=2e-3)
    wider = NormalNetwork(fine=32)
    export_network(Averaged(wider), tmp_path / "wider.onnx", {"name": "wider"})
    with pytest.raises(DataError, match="cannot start from"):
        started_from(tmp_path / "wider.onnx")


def test_a_blend_lies_between_start_and_end():
    torch.manual_seed(0)
    start, end = NormalNetwork(), NormalNetwork()
    state = {name: value for name, value in start.state_dict().items() if "look" not in name}
    before = {name: value.clone() for name, value in end.state_dict().items()}
    quarter = blended(end, state, 0.25).state_dict()
    for name, value in quarter.items():
        # Blocks that the start had not are as training left them.
        wanted = before[name] if name not in state else 0.25 * state[name] + 0.75 * before[name]
        torch.testing.assert_close(value, wanted)
        torch.testing.assert_close(end.state_dict()[name], before[name], rtol=0, atol=0)
    assert any("look" in name for name in quarter)
    for name, value in blended(end, state, 0.0).state_dict().items():
        torch.testing.assert_close(value, before[name], rtol=0, atol=0)

"""Folds made stronger: closed forms of waves, and what stays as it is."""

import math

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from methods.normals.onnx_estimator import OnnxNormals  # noqa: E402
from metrics.folds import fold_strength  # noqa: E402
from normal_training.learning.networks.export import export_network  # noqa: E402
from normal_training.learning.networks.folds import StrongerFolds  # noqa: E402
from normal_training.learning.networks.network import Averaged, NormalNetwork  # noqa: E402

SIZE = 96
INSIDE = slice(36, -36)
BLUR_PX = 4.0


def wave(slope, length_px):
    """(1, 3, H, W) normals of cloth that waves along x, and a mask without an edge in sight."""
    x = torch.arange(SIZE, dtype=torch.float32)
    across = slope * torch.sin(2 * math.pi * x / length_px)
    normals = torch.stack([across, torch.zeros(SIZE), torch.ones(SIZE)])
    normals = torch.nn.functional.normalize(normals, dim=0)
    return normals[None, :, None].repeat(1, 1, SIZE, 1), torch.ones(1, 1, SIZE, SIZE)


def expected(degrees, mask):
    """Errors that a network expects, the same at all pixels of a mask and greater beside it."""
    return math.radians(degrees) * (2.0 - mask)


def stronger(gain, normals, mask, degrees=20.0):
    return StrongerFolds(gain)(normals, expected(degrees, mask), mask)


@pytest.mark.parametrize("gain", [0.5, 1.3, 2.0])
@pytest.mark.parametrize("length_px", [6.0, 16.0, 40.0])
@pytest.mark.parametrize(
    ("degrees", "share"), [(40.0, 1.0), (15.0, 1.0), (12.0, 0.4096), (3.0, 0.0016)]
)
def test_a_wave_grows_by_what_the_blur_takes_and_by_how_unsure_the_network_is(
    gain, length_px, degrees, share
):
    normals, mask = wave(0.05, length_px)
    found = torch.nn.functional.normalize(stronger(gain, normals, mask, degrees), dim=1)
    taken = 1.0 - math.exp(-0.5 * (2 * math.pi / length_px * BLUR_PX) ** 2)
    wanted = 1.0 + (gain - 1.0) * share * taken
    size = found[0, 0, INSIDE, INSIDE].abs().max() / normals[0, 0, INSIDE, INSIDE].abs().max()
    assert float(size) == pytest.approx(wanted, rel=0.01)


def test_each_map_of_a_batch_has_a_factor_of_its_own():
    normals, mask = wave(0.3, 16.0)
    errors = [expected(degrees, mask) for degrees in (5.0, 20.0)]
    twice = (torch.cat([normals] * 2), torch.cat(errors), torch.cat([mask] * 2))
    both = StrongerFolds(1.5)(*twice)
    for one, error in zip(both.split(1), errors, strict=True):
        torch.testing.assert_close(one, StrongerFolds(1.5)(normals, error, mask))
    assert (both[0] - both[1]).abs().max() > 0.01


def test_a_plane_stays_and_so_does_everything_with_a_gain_of_one():
    normals, mask = wave(0.0, 10.0)
    torch.testing.assert_close(stronger(1.7, normals, mask), normals, atol=1e-6, rtol=0)
    waving, _ = wave(0.3, 10.0)
    assert stronger(1.0, waving, mask) is waving


def test_normals_at_the_edge_and_beside_the_subject_stay():
    normals, mask = wave(0.3, 16.0)
    mask[..., :40] = 0.0
    found = stronger(1.5, normals, mask)
    # Three pixels: there a fifth of the blur is on the other side.
    torch.testing.assert_close(found[..., :43], normals[..., :43], atol=1e-6, rtol=0)
    whole = stronger(1.5, normals, torch.ones_like(mask))
    torch.testing.assert_close(found[..., 54:], whole[..., 54:], atol=1e-5, rtol=0)
    assert (whole - found)[..., 43:50].abs().max() > 0.01


def test_lengths_of_the_answer_do_not_matter():
    normals, mask = wave(0.3, 16.0)
    once = stronger(1.5, normals, mask)
    torch.testing.assert_close(stronger(1.5, 3.0 * normals, mask), once, atol=1e-5, rtol=0)


def test_half_precision_around_it_changes_nothing():
    normals, mask = wave(0.05, 16.0)
    once = stronger(1.5, normals, mask)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        found = stronger(1.5, normals, mask)
    assert found.dtype == torch.float32
    assert torch.equal(found, once)


@pytest.mark.nightly
def test_the_exported_file_has_stronger_folds(tmp_path):
    torch.manual_seed(0)
    network = NormalNetwork(8, (16, 24, 24, 32))
    about = {"name": "test", "licence": "CC0-1.0"}
    normals, mask = wave(0.3, 8.0)
    body = normals[0].permute(1, 2, 0).double().numpy()
    inside = mask[0, 0].double().numpy()
    folds = []
    for gain in (1.0, 1.5):
        path = tmp_path / f"{gain}.onnx"
        # Untrained, it answers with the body.
        export_network(Averaged(network, gain), path, about)
        found = OnnxNormals(path)(np.full((SIZE, SIZE, 3), 0.5), inside, body, body)
        folds.append(fold_strength(found.front, inside > 0, 0.004).mean_deg)
        np.testing.assert_allclose(found.back, body, atol=1e-4)
    assert folds[1] / folds[0] == pytest.approx(1.5, rel=0.08)

"""Folds made stronger: closed forms of waves, and what stays as it is."""

import math

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from methods.normals.onnx_estimator import OnnxNormals  # noqa: E402
from methods.normals.training.export import export_network  # noqa: E402
from methods.normals.training.folds import StrongerFolds  # noqa: E402
from methods.normals.training.network import Mirrored, NormalNetwork  # noqa: E402
from metrics.folds import fold_strength  # noqa: E402

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


@pytest.mark.parametrize("gain", [0.5, 1.3, 2.0])
@pytest.mark.parametrize("length_px", [6.0, 16.0, 40.0])
def test_a_wave_grows_by_what_the_blur_takes_from_it(gain, length_px):
    normals, mask = wave(0.05, length_px)
    found = torch.nn.functional.normalize(StrongerFolds(gain)(normals, mask), dim=1)
    kept = math.exp(-0.5 * (2 * math.pi / length_px * BLUR_PX) ** 2)
    wanted = 1.0 + (gain - 1.0) * (1.0 - kept)
    size = found[0, 0, INSIDE, INSIDE].abs().max() / normals[0, 0, INSIDE, INSIDE].abs().max()
    assert float(size) == pytest.approx(wanted, rel=0.01)


def test_a_plane_stays_and_so_does_everything_with_a_gain_of_one():
    normals, mask = wave(0.0, 10.0)
    torch.testing.assert_close(StrongerFolds(1.7)(normals, mask), normals, atol=1e-6, rtol=0)
    waving, _ = wave(0.3, 10.0)
    assert StrongerFolds(1.0)(waving, mask) is waving


def test_normals_at_the_edge_and_beside_the_subject_stay():
    normals, mask = wave(0.3, 16.0)
    mask[..., :40] = 0.0
    found = StrongerFolds(1.5)(normals, mask)
    # Three pixels: there a fifth of the blur is on the other side.
    torch.testing.assert_close(found[..., :43], normals[..., :43], atol=1e-6, rtol=0)
    whole = StrongerFolds(1.5)(normals, torch.ones_like(mask))
    torch.testing.assert_close(found[..., 54:], whole[..., 54:], atol=1e-5, rtol=0)
    assert (whole - found)[..., 43:50].abs().max() > 0.01


def test_lengths_of_the_answer_do_not_matter():
    normals, mask = wave(0.3, 16.0)
    once = StrongerFolds(1.5)(normals, mask)
    torch.testing.assert_close(StrongerFolds(1.5)(3.0 * normals, mask), once, atol=1e-5, rtol=0)


def test_half_precision_around_it_changes_nothing():
    normals, mask = wave(0.05, 16.0)
    once = StrongerFolds(1.5)(normals, mask)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        found = StrongerFolds(1.5)(normals, mask)
    assert found.dtype == torch.float32
    assert torch.equal(found, once)


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
        export_network(Mirrored(network, gain), path, about)
        found = OnnxNormals(path)(np.full((SIZE, SIZE, 3), 0.5), inside, body, body)
        folds.append(fold_strength(found.front, inside > 0, 0.004).mean_deg)
        np.testing.assert_allclose(found.back, body, atol=1e-4)
    assert folds[1] / folds[0] == pytest.approx(1.5, rel=0.08)

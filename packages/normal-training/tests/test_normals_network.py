"""The open network's shape, its start, and that its file answers as it does."""

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from harness.core.errors import DataError  # noqa: E402
from methods.normals.onnx_estimator import MULTIPLE, OnnxNormals  # noqa: E402
from normal_training.learning.networks import starting  # noqa: E402
from normal_training.learning.networks.export import export_network  # noqa: E402
from normal_training.learning.networks.network import Answer, Averaged, NormalNetwork  # noqa: E402

ABOUT = {"name": "test", "licence": "CC0-1.0", "training_set": "none", "window": "mask"}


def inputs(height, width, seed=0):
    draw = torch.Generator().manual_seed(seed)
    return [torch.randn(1, channels, height, width, generator=draw) for channels in (3, 1, 3, 3)]


@pytest.fixture(name="stirred", scope="module")
def _stirred():
    """A small network whose answer is not just the body's normals."""
    torch.manual_seed(1)
    network = NormalNetwork(8, (16, 24, 24, 32))
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.add_(0.05 * torch.randn(parameter.shape))
    return network.eval()


def test_an_untrained_network_answers_with_the_body():
    _, _, front, back = maps = inputs(2 * MULTIPLE, 3 * MULTIPLE)
    answer = NormalNetwork(8, (16, 24, 24, 32))(*maps)
    torch.testing.assert_close(answer.front, front)
    torch.testing.assert_close(answer.back, back)
    for error in (answer.front_error, answer.back_error):
        assert error.shape == (1, 1, 2 * MULTIPLE, 3 * MULTIPLE)
        torch.testing.assert_close(
            torch.rad2deg(error), torch.full_like(error, 20.0), rtol=0.01, atol=0
        )


def test_every_input_matters_to_both_sides(stirred):
    maps = inputs(MULTIPLE, MULTIPLE)
    before = stirred(*maps)
    for k in range(4):
        other = [value + (0.5 if k == j else 0.0) for j, value in enumerate(maps)]
        for now, then in zip(stirred(*other), before, strict=True):
            assert (now - then).abs().max() > 1e-4


def test_it_looks_at_far_pixels_but_answers_in_place(stirred):
    maps = inputs(4 * MULTIPLE, 4 * MULTIPLE)
    moved = [value.roll(MULTIPLE, dims=3) for value in maps]
    plain, rolled = stirred(*maps)[0], stirred(*moved)[0].roll(-MULTIPLE, dims=3)
    # Away from the borders the answer moves along with the picture.
    middle = slice(MULTIPLE + 30, -MULTIPLE - 30)
    nearer = (plain - rolled)[..., middle].abs().mean()
    assert nearer < 0.1 * (plain - plain.roll(MULTIPLE, dims=3)).abs().mean()


def test_a_mirrored_scene_has_the_mirrored_answer(stirred):
    turn = torch.tensor([-1.0, 1.0, 1.0]).view(1, 3, 1, 1)
    image, mask, front, back = inputs(MULTIPLE, 2 * MULTIPLE)
    mirrored = (image.flip(3), mask.flip(3), front.flip(3) * turn, back.flip(3) * turn)
    both = Averaged(stirred)
    for plain, other in zip(both(image, mask, front, back), both(*mirrored), strict=True):
        turned = other.flip(3) * (turn if other.shape[1] == 3 else 1.0)
        torch.testing.assert_close(plain, turned, atol=1e-5, rtol=1e-4)
    assert (
        stirred(image, mask, front, back)[0] - both(image, mask, front, back)[0]
    ).abs().max() > 0.01


class Grid(torch.nn.Module):
    """Answers with the body, and in front with a grid that stays where it is and not the photo."""

    def forward(self, image, mask, body_front, body_back):
        error = torch.full_like(mask, 0.1)
        grid = torch.zeros_like(body_front)
        grid[..., ::MULTIPLE, ::MULTIPLE] = 1.0
        return Answer(body_front + grid, body_back, error, 2.0 * error)


@pytest.mark.parametrize("every", [True, False])
def test_what_comes_from_the_networks_own_grid_is_averaged_away(every):
    image, mask, front, back = inputs(2 * MULTIPLE, 3 * MULTIPLE)
    found = Averaged(Grid(), every=every)(image, mask, front, back)
    torch.testing.assert_close(found.back, back)
    torch.testing.assert_close(found.front_error, torch.full_like(mask, 0.1))
    torch.testing.assert_close(found.back_error, torch.full_like(mask, 0.2))
    # In the picture, in the one that is moved, and in the mirror images of both.
    up, across = MULTIPLE - 3, MULTIPLE - 13
    places = [(0, 0), (up, across), (0, MULTIPLE - 1), (up, MULTIPLE - 1 - across)]
    if not every:
        places = [places[0], places[3]]
    wanted = torch.zeros_like(mask[0, 0])
    for row, column in places:
        wanted[row::MULTIPLE, column::MULTIPLE] = 1.0 / len(places)
    torch.testing.assert_close((found.front - front)[0, 1], wanted, atol=1e-6, rtol=0)


def test_the_shipped_file_fits_in_twenty_megabytes():
    # Weights are stored with two bytes each.
    count = sum(parameter.numel() for parameter in NormalNetwork().parameters())
    assert 2 * count < 20e6


def test_another_training_can_start_from_the_exported_file(stirred, tmp_path, monkeypatch):
    monkeypatch.setattr(starting, "NormalNetwork", lambda: NormalNetwork(8, (16, 24, 24, 32)))
    export_network(Averaged(stirred), tmp_path / "network.onnx", ABOUT)
    found = starting.started_from(tmp_path / "network.onnx")
    assert set(found) == set(stirred.state_dict())
    for name, value in stirred.state_dict().items():
        torch.testing.assert_close(found[name], value, rtol=0, atol=0)
    monkeypatch.setattr(starting, "NormalNetwork", lambda: NormalNetwork(8, (16, 24, 24, 16)))
    with pytest.raises(DataError, match="cannot start from"):
        starting.started_from(tmp_path / "network.onnx")
    (tmp_path / "other.onnx").write_bytes(b"nothing")
    with pytest.raises(DataError, match="not an ONNX network"):
        starting.started_from(tmp_path / "other.onnx")


def test_the_exported_file_is_an_estimator(stirred, tmp_path):
    path = tmp_path / "network.onnx"
    export_network(Averaged(stirred), path, ABOUT)
    estimator = OnnxNormals(path)
    assert (estimator.part.name, estimator.part.licence) == ("test", "CC0-1.0")
    draw = np.random.default_rng(0)
    mask = np.zeros((90, 70))
    mask[20:80, 10:60] = 1.0
    body = draw.normal(size=(2, 90, 70, 3)) * mask[..., None]
    body /= np.linalg.norm(body, axis=3, keepdims=True) + (mask == 0)[..., None]
    found = estimator(draw.random((90, 70, 3)), mask, body[0], body[1])
    for normals in (found.front, found.back):
        np.testing.assert_allclose(np.linalg.norm(normals, axis=2), mask, atol=1e-6)
    assert np.abs(found.front - body[0]).max() > 0.01
    for expected_deg in (found.front_error_deg, found.back_error_deg):
        assert expected_deg is not None
        assert ((expected_deg > 0) == (mask > 0)).all()
        assert expected_deg.max() < 180

"""Two networks one after the other: what the second is given, and that its file says the same."""

from __future__ import annotations

import pytest

torch = pytest.importorskip("torch")
onnx = pytest.importorskip("onnx")

from normal_training.learning.networks.detailed import Detailed, _Reduced  # noqa: E402
from normal_training.learning.networks.export import export_network  # noqa: E402
from normal_training.learning.networks.network import NormalNetwork  # noqa: E402
from normal_training.learning.networks.starting import started_from  # noqa: E402

SMALL = (8, (16, 24, 24, 32))


def unit(normals):
    return normals / normals.norm(dim=1, keepdim=True)


def sphere(height, width):
    """A scene: image, mask, and a ball's normals on both sides, which are smooth."""
    down, right = torch.meshgrid(
        torch.linspace(-1.2, 1.2, height), torch.linspace(-1.2, 1.2, width), indexing="ij"
    )
    mask = ((right**2 + down**2) < 0.9).float()[None, None]
    depth = (1.0 - right**2 - down**2).clamp(min=0.01).sqrt()
    front = unit(torch.stack([right, -down, depth])[None]) * mask
    back = front * torch.tensor([1.0, 1.0, -1.0]).view(1, 3, 1, 1)
    image = torch.stack([right, down, right * down])[None].clamp(-1, 1) * mask
    return [image, mask, front, back]


def stirred(network, seed, by=0.03):
    """The network with an answer that is not just what it is given."""
    torch.manual_seed(seed)
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.add_(by * torch.randn(parameter.shape))
    return network.eval()


@pytest.fixture(name="both", scope="module")
def _both():
    return Detailed(stirred(NormalNetwork(*SMALL), 1), stirred(NormalNetwork(*SMALL), 2), 1.3)


def test_a_reduced_pixel_is_the_mean_of_what_it_covers():
    maps = torch.zeros(1, 10, 6, 6)
    maps[0, 0] = torch.arange(36.0).view(6, 6)
    maps[0, 9, 2, 2] = 9.0
    small = _Reduced()(maps)
    assert small.shape == (1, 10, 4, 4)
    # Sums are kept: each small pixel has 9/4 of a large one's area.
    torch.testing.assert_close(small.sum((2, 3)) * 9 / 4, maps.sum((2, 3)))
    # The first row and the half of the second that belongs to it have a mean of 2.
    row = 2.0 + torch.tensor([1.0, 5.0, 10.0, 14.0]) / 3
    torch.testing.assert_close(small[0, 0, 0], row)
    # The third of three belongs to the second of two.
    assert small[0, 9].nonzero().tolist() == [[1, 1]]
    assert small[0, 9, 1, 1] == 4.0


@pytest.mark.parametrize("size", [(96, 192), (128, 160)])
def test_untrained_networks_answer_with_the_body_twice(size):
    scene = sphere(*size)
    both = Detailed(NormalNetwork(*SMALL), NormalNetwork(*SMALL)).eval()
    with torch.no_grad():
        first = both.first(*scene)
        answer = both(*scene)
    mask = scene[1][0, 0] > 0
    inner = torch.nn.functional.avg_pool2d(scene[1], 9, 1, 4)[0, 0] > 0.999
    for given, found, said in zip(scene[2:], first, (answer.front, answer.back), strict=True):
        assert found.shape == given.shape
        assert not found[0, :, ~mask].any()
        # A ball's normals hardly change between neighbouring pixels.
        torch.testing.assert_close(found[0, :, inner], given[0, :, inner], atol=0.03, rtol=0)
        torch.testing.assert_close(said, found)


def test_the_second_one_is_given_the_first_ones_answer(both):
    scene = sphere(96, 96)
    with torch.no_grad():
        front, back = both.first(*scene)
        wanted = both.stronger(
            (answer := both.detail(scene[0], scene[1], front, back)).front,
            answer.front_error,
            scene[1],
        )
        found = both(*scene)
        bare = both.detail(*scene)
    torch.testing.assert_close(found.front, wanted)
    torch.testing.assert_close(found.back, answer.back)
    assert (found.back - bare.back).abs().max() > 1e-3


@pytest.mark.nightly
def test_both_are_read_again_from_their_file(tmp_path):
    # Two that are stirred more make what rounding differs by larger than an export allows.
    networks = [stirred(NormalNetwork(), seed, 0.01) for seed in (3, 4)]
    path = tmp_path / "both.onnx"
    # Writing compares the file's answers with the networks'.
    export_network(Detailed(*networks, 1.5), path, {"name": "both", "licence": "CC0-1.0"})
    assert "ConvTranspose" not in {node.op_type for node in onnx.load(path).graph.node}
    for network, detail in zip(networks, (False, True), strict=True):
        state = started_from(path, detail=detail)
        for name, value in network.state_dict().items():
            torch.testing.assert_close(state[name], value)


@pytest.mark.nightly
def test_a_second_network_starts_where_the_first_one_is(tmp_path):
    from normal_training.learning.networks.network import Averaged

    network = stirred(NormalNetwork(), 5)
    path = tmp_path / "one.onnx"
    export_network(Averaged(network), path, {"name": "one", "licence": "CC0-1.0"})
    whole, detail = started_from(path), started_from(path, detail=True)
    assert whole.keys() == detail.keys() == network.state_dict().keys()
    for name, value in whole.items():
        torch.testing.assert_close(detail[name], value)

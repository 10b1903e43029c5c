"""Pictures and normals that are turned and enlarged: known answers."""

import math

import pytest

torch = pytest.importorskip("torch")

from normal_training.learning.settings import Turning  # noqa: E402
from normal_training.learning.variations.turning import Placement, drawn_placement  # noqa: E402


def place(angle_deg, zoom=1.0):
    return Placement(torch.tensor([math.radians(angle_deg)]), torch.tensor([zoom]))


def picture_at(placement, maps):
    return placement.moved([maps], [False])[0]


def normals_at(placement, maps):
    return placement.moved([maps], [True])[0]


def dot(row, column, size=(41, 31)):
    picture = torch.zeros(1, 1, *size)
    picture[0, 0, row, column] = 1.0
    return picture


def where(picture):
    index = int(picture.flatten().argmax())
    return divmod(index, picture.shape[3])


def test_nothing_moves_by_nothing():
    picture = torch.rand(1, 3, 20, 30)
    assert torch.equal(picture_at(place(0.0), picture), picture)


def test_a_quarter_turn_takes_what_is_right_up():
    # Middle at row 20, column 15; the dot lies ten pixels to its right.
    assert where(picture_at(place(90.0), dot(20, 25))) == (10, 15)
    assert where(picture_at(place(180.0), dot(20, 25))) == (20, 5)


def test_an_enlarged_picture_moves_outward():
    assert where(picture_at(place(0.0, 1.5), dot(26, 15))) == (29, 15)


def test_normals_turn_with_the_picture():
    right = torch.tensor([0.6, 0.0, 0.8]).view(1, 3, 1, 1).expand(1, 3, 21, 21)
    found = normals_at(place(90.0), right)
    torch.testing.assert_close(
        found[0, :, 10, 10], torch.tensor([0.0, 0.6, 0.8]), atol=1e-6, rtol=0
    )
    torch.testing.assert_close(normals_at(place(0.0, 1.3), right), right, atol=1e-6, rtol=0)


def test_a_plane_s_slope_and_its_normals_stay_one():
    # Heights over a picture, and the normals that they have; x right and y up.
    rows, columns = torch.meshgrid(torch.arange(61.0), torch.arange(61.0), indexing="ij")
    height = 0.01 * (columns - 30) ** 2 + 0.004 * (columns - 30) * (rows - 30)
    place_ = place(25.0)

    def normals(values):
        across = (values[1:-1, 2:] - values[1:-1, :-2]) / 2
        down = (values[2:, 1:-1] - values[:-2, 1:-1]) / 2
        found = torch.stack([-across, down, torch.ones_like(down)])
        return found / found.norm(dim=0)

    turned = normals_at(place_, torch.nn.functional.pad(normals(height), (1, 1, 1, 1))[None])
    afterwards = normals(picture_at(place_, height[None, None])[0, 0])
    middle = slice(20, 40)
    off = turned[0, :, middle, middle] - afterwards[:, 19:39, 19:39]
    assert float(off.norm(dim=0).mean()) < 0.03


def test_half_a_normal_is_one_and_less_is_none():
    normals = torch.zeros(1, 3, 1, 4)
    normals[:, 2, :, :2] = 1.0
    found = normals_at(place(180.0), 0.55 * normals)
    torch.testing.assert_close(found[0, 2, 0], torch.tensor([0.0, 0.0, 1.0, 1.0]))
    assert not normals_at(place(180.0), 0.45 * normals).any()


def test_the_share_of_moved_pictures():
    picture = torch.rand(1, 1, 16, 16).expand(200, 1, 16, 16)
    draw = torch.Generator().manual_seed(0)
    placement = drawn_placement(200, Turning(0.5, 10.0, 0.1), draw)
    moved = picture_at(placement, picture) != picture
    assert 0.4 < moved.flatten(1).any(1).float().mean() < 0.6

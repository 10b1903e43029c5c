"""What cameras and masks do to a sample: each fault alone."""

from dataclasses import replace

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from normal_training.learning.samples import Samples  # noqa: E402
from normal_training.learning.settings import (  # noqa: E402
    FaultShares,
    TrainingSettings,
    Turning,
)
from normal_training.learning.variations.drawing import drawn  # noqa: E402
from normal_training.learning.variations.photo_faults import spoilt  # noqa: E402

NONE = FaultShares(0, 0, 0, 0, 0, 0, 0)
SIZE = 40


def scene():
    """A grey square with a bright line on it, on black."""
    mask = torch.zeros(1, SIZE, SIZE)
    mask[:, 8:32, 10:30] = 1.0
    image = torch.full((3, SIZE, SIZE), -0.2)
    image[:, :, 20] = 0.8
    return image * mask, mask


def made(seed=0, **shares):
    image, mask = scene()
    draw = torch.Generator().manual_seed(seed)
    return spoilt(image, mask, draw, replace(NONE, **shares))


def test_without_faults_a_picture_is_itself():
    image, mask = scene()
    found, same = made()
    torch.testing.assert_close(found, image)
    assert torch.equal(same, mask)


@pytest.mark.parametrize("fault", ["blur", "small", "grain", "sharp", "packed"])
def test_a_camera_s_fault_leaves_the_mask_and_the_brightness(fault):
    image, mask = scene()
    inner = torch.zeros_like(mask, dtype=torch.bool)
    inner[:, 12:28, 14:26] = True
    for seed in range(5):
        found, same = made(seed, **{fault: 1.0})
        assert torch.equal(same, mask)
        assert not found[(mask == 0).expand_as(found)].any()
        assert found.abs().max() <= 1.0
        assert float((found - image).abs().max()) > 0.01
        apart = found[inner.expand_as(found)].mean() - image[inner.expand_as(image)].mean()
        assert abs(float(apart)) < 0.12


def test_blur_takes_contrast_and_sharpening_gives_it():
    def contrast(image):
        return float(image[0, 20, 20] - image[0, 20, 17])

    plain = contrast(scene()[0])
    for seed in range(5):
        assert contrast(made(seed, blur=1.0)[0]) < plain - 0.02
        assert contrast(made(seed, sharp=1.0)[0]) > plain + 0.02


def test_a_rim_is_a_pixel_or_two():
    area = float(scene()[1].sum())
    grown = set()
    for seed in range(24):
        found, mask = made(seed, rim=1.0)
        # 20 x 24 pixels, one or two more or fewer on each side.
        assert float(mask.sum()) in {18 * 22, 16 * 20, 22 * 26, 24 * 28}
        grown.add(float(mask.sum()) > area)
        beyond = (mask > 0) & (scene()[1] == 0)
        if beyond.any():
            # The background shows there, in one colour.
            colours = found[:, beyond[0]]
            assert float(colours.std(dim=1).max()) < 1e-5
    assert grown == {True, False}


def test_a_cut_loses_head_or_feet():
    ends = set()
    for seed in range(24):
        found, mask = made(seed, cut=1.0)
        rows = torch.nonzero(mask[0].any(dim=1))[:, 0]
        assert 24 * 0.69 < len(rows) <= 23
        ends.add("feet" if int(rows[0]) == 8 else "head")
        assert not found[(mask == 0).expand_as(found)].any()
    assert ends == {"feet", "head"}


def test_nothing_is_asked_where_nothing_is_seen():
    mask = np.zeros((6, 30, 20), bool)
    mask[:, 4:26, 4:16] = True
    normals = np.zeros((6, 30, 20, 3), np.int8)
    normals[..., 2] = 127
    arrays = {
        "rgb": np.full((6, 30, 20, 3), 90, np.uint8) * mask[..., None],
        "mask": mask,
        **dict.fromkeys(("front", "back", "body_front", "body_back"), normals),
    }
    samples = Samples([arrays], ["toy"])
    draw = torch.Generator().manual_seed(0)
    settings = TrainingSettings(
        batch=6, relit=0.0, faults=replace(NONE, cut=1.0, rim=1.0), turning=Turning(0.0)
    )
    batch = drawn(samples, settings, draw)
    for inside in (batch.front_inside, batch.back_inside):
        assert not inside[batch.mask == 0].any()
        assert not inside[:, :, :4].any()
    empty = ~(batch.mask.amax(dim=3) > 0)[:, 0]
    for body in (batch.body_front, batch.body_back):
        assert not body.movedim(1, -1)[empty].any()
        assert body.movedim(1, -1)[~empty].any()

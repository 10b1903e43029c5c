"""Masks that are made: outlines move to the photo's edges, and other people are told."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from harness.photos import masks


def network(monkeypatch, name, mask, landmarks=True):
    answer = SimpleNamespace(segmentation_mask=mask, pose_landmarks=landmarks or None)
    found = SimpleNamespace(process=lambda rgb: answer)
    monkeypatch.setattr(masks, name, lambda: found)


@pytest.fixture
def photo():
    """A red person before a grey wall, 120 x 80, with a little noise; and where the person is."""
    inside = np.zeros((120, 80), dtype=bool)
    inside[20:110, 25:55] = True
    noise = np.random.default_rng(0).integers(-6, 7, size=(120, 80, 3))
    rgb = np.where(inside[..., None], (190, 40, 40), (140, 140, 140)) + noise
    return rgb.astype(np.uint8), inside


@pytest.mark.parametrize("aside", [-1, 0, 1])
def test_a_rough_outline_moves_to_the_edge_of_the_photo(monkeypatch, photo, aside):
    rgb, inside = photo
    rough = np.roll(inside, aside, axis=1)
    network(monkeypatch, "_network", rough.astype(np.float32))
    made = masks.by_mediapipe()(rgb)
    assert made is not None
    found = made >= 128
    before = (rough & inside).sum() / (rough | inside).sum()
    after = (found & inside).sum() / (found | inside).sum()
    assert after > 0.97
    assert after > before + 0.03 or not aside


def test_a_photo_without_a_person_has_no_mask(monkeypatch, photo):
    rgb, inside = photo
    network(monkeypatch, "_network", inside.astype(np.float32), landmarks=False)
    assert masks.by_mediapipe()(rgb) is None
    network(monkeypatch, "_network", np.zeros((120, 80), np.float32))
    assert masks.by_mediapipe()(rgb) is None


@pytest.mark.parametrize(
    ("columns", "others"), [((62, 78), True), ((74, 78), False), (None, False)]
)
def test_another_person_is_told(monkeypatch, photo, columns, others):
    rgb, inside = photo
    everybody = inside.astype(np.float32)
    if columns:
        everybody[30:110, slice(*columns)] = 1.0
    network(monkeypatch, "_everybody", everybody)
    assert masks.shows_others(rgb, 255 * inside.astype(np.uint8)) is others


def test_a_network_of_the_users_own_makes_the_masks(monkeypatch, photo):
    rgb, inside = photo
    asked = []

    def imported(name):
        asked.append(name)
        return Marking()

    class Marking:
        title = "U2-Net (Apache-2.0)"

        def __call__(self, picture):
            return np.where(inside, 0.9, 0.1)

    monkeypatch.setattr(masks, "imported_network", imported)
    maker = masks.mask_maker("mine")
    assert asked == ["mine"]
    assert maker.title == "made with U2-Net (Apache-2.0) and a guided filter"
    made = maker(rgb)
    assert made is not None
    assert ((made >= 128) ^ inside).mean() < 0.02
    assert masks.mask_maker().title.startswith("made with MediaPipe")

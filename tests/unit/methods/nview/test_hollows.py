"""What closing a solid by a ball fills: slots that the ball does not enter, and no round dents."""

from __future__ import annotations

import numpy as np
import pytest

from harness.core.mesh import Mesh
from harness.geometry.coinciding import open_edges
from methods.closed.lattices import contoured, lattice_around
from methods.photo_pull.dents import hollows_of
from tests.spheres import icosphere

SIDE, DEPTH, STEP = 0.2, 0.06, 0.003
#: Of the blocks' own lattice: a multiple of the other would make rays run along edges.
BLOCK_STEP = 0.0037
RADIUS = 0.03


def block(slot_m: float) -> Mesh:
    """A cube of 20 cm with a slot across its upper side, 6 cm deep."""
    half = SIDE / 2
    lattice = lattice_around(np.array([[-half] * 3, [half] * 3]), BLOCK_STEP)
    x, y, z = (lattice.axis(axis) for axis in range(3))
    cube = half - np.maximum(
        np.maximum(np.abs(x)[:, None, None], np.abs(y)[:, None]), np.abs(z)[None, None]
    )
    beside = np.maximum(np.abs(x)[:, None, None] - slot_m / 2, half - DEPTH - y[:, None])
    return contoured(lattice, np.minimum(cube, beside).astype(np.float32), "block")


def test_a_slot_narrower_than_the_ball_is_one_hollow_that_can_be_filled():
    narrow = block(0.03)
    found = hollows_of(narrow, RADIUS, STEP, 8e-6)
    assert found.count == 1
    # At the open ends and the lid the ball bulges in by 4 mm, and the lattice takes half a step.
    slot = 0.03 * DEPTH * SIDE
    assert 0.75 * slot < found.volumes_m3()[0] < slot
    deepest = found.lattice.points(np.argwhere(found.number == 1))[:, 1].min()
    assert deepest == pytest.approx(SIDE / 2 - DEPTH, abs=STEP)
    filled = found.filled(np.array([True]))
    assert open_edges(filled) == 0
    gain = filled.signed_volume - narrow.signed_volume
    assert gain == pytest.approx(found.volumes_m3()[0], rel=0.1)
    kept = found.filled(np.array([False]))
    assert kept.signed_volume == pytest.approx(narrow.signed_volume, rel=0.01)


def test_a_slot_wider_than_the_ball_keeps_its_floor():
    # The ball does not reach into the two edges of the floor: a quarter of what a circle leaves of
    # the square around it, each.
    found = hollows_of(block(0.09), RADIUS, STEP, 8e-6)
    assert found.count == 2
    corner = (1 - np.pi / 4) * RADIUS**2 * SIDE
    assert found.volumes_m3() == pytest.approx([corner, corner], rel=0.25)


def test_round_dents_and_small_ones_are_no_hollows():
    assert hollows_of(icosphere(0.1), RADIUS, STEP, 8e-6).count == 0
    assert hollows_of(block(0.03), RADIUS, STEP, 4e-4).count == 0

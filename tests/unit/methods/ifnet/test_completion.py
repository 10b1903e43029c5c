"""From sheets and a body to a closed surface, by networks whose answers are known."""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np
import pytest

from harness.core.errors import MissingPart
from harness.core.mesh import Mesh
from harness.core.rigs import RingRig
from harness.geometry.coinciding import open_edges
from methods.ifnet import network as convert
from methods.ifnet.completion import Occupancy, completed_by_network, ifnet_part, smoothed
from methods.ifnet.network import IfNet
from methods.parts.conversion import bare, shapes_of
from methods.parts.converted import IFNET
from methods.parts.kind import ImportOptions

SIDE = 64
CENTRE = np.array([0.1, 0.05, -0.08])
BODY_M, CLOTHES_M = 0.40, 0.45
#: Places of the point itself and of the finest features among what the decoder sees.
_POINT, _BODY_FEATURE = 513, 1


@pytest.fixture
def crafted(parts, save_checkpoint, tmp_path) -> Callable[[Callable], None]:
    """``crafted(change)``: imports a network of zeros but for what ``change`` puts into it."""

    def install(change: Callable[[dict[str, np.ndarray]], None]) -> None:
        shapes = shapes_of(bare(IfNet), convert.PREFIX)
        numbers = {name: np.zeros(shape, np.float32) for name, shape in shapes.items()}
        change(numbers)
        path = save_checkpoint(tmp_path / "ifnet.ckpt", numbers, "state_dict")
        IFNET.add(path, ImportOptions(replace=True))

    return install


def answer_is(numbers: dict[str, np.ndarray], terms: list[tuple[int, float, float]], bias) -> None:
    """Let the decoder answer ``bias`` and the sum of ``gain * relu(sign * input)`` of terms."""
    for unit, (place, sign, gain) in enumerate(terms):
        numbers["netG.fc_0.weight"][unit, place] = sign
        for layer in (1, 2):
            numbers[f"netG.fc_{layer}.weight"][unit, unit] = 1.0
        numbers["netG.fc_out.weight"][0, unit] = gain
    numbers["netG.fc_out.bias"][:] = bias


def octahedron(numbers: dict[str, np.ndarray], middle=(0.0, 0.0, 0.0), size=0.6) -> None:
    """Above one half where ``|x - a| + |y - b| + |z - c| < size``, y downwards."""
    answer_is(numbers, [(_POINT + axis, sign, -1.0) for axis in range(3) for sign in (1, -1)],
              0.5 + size)  # fmt: skip
    for axis in range(3):
        numbers["netG.fc_0.bias"][[2 * axis, 2 * axis + 1]] = -middle[axis], middle[axis]


def body_itself(numbers: dict[str, np.ndarray]) -> None:
    """Above one half in the body's voxels: they pass through each layer as they are."""
    same = (0, 0, 1, 1, 1)
    for name, taken in (("conv_in_smpl", 0), ("SA.conv", 0), ("conv_0_fusion", 16),
                        ("conv_0_1_fusion", 0)):  # fmt: skip
        numbers[f"netG.{name}.weight"][(0, taken, *same[2:])] = 1.0
    # A channel has mean 0 after it is normalised; the body's voxels are far above 1.
    answer_is(numbers, [(_BODY_FEATURE, 1.0, 1.0)], -0.5)


def scene(ball: Mesh) -> tuple[tuple[Mesh, Mesh], Mesh]:
    """Both halves of a round surface as sheets, and a smaller round body in it."""
    clothes = Mesh(ball.vertices * CLOTHES_M + CENTRE, ball.faces, source="sheet")
    middles = ball.vertices[ball.faces].mean(axis=1)[:, 2]
    body = Mesh(ball.vertices * BODY_M + CENTRE, ball.faces, source="body")
    return (clothes.submesh(middles > 0.1), clothes.submesh(middles < -0.1)), body


FRONT = RingRig().cameras(270, 480)[0]


@pytest.mark.nightly
def test_the_networks_own_shape_is_put_where_the_person_is(crafted, ball):
    crafted(functools.partial(octahedron, middle=(0.2, 0.1, -0.1), size=0.5))
    sheets, body = scene(ball)
    mesh = completed_by_network(sheets, body, FRONT, SIDE)
    assert open_edges(mesh) == 0
    # The sheets' box, 0.9 m wide, is 1.8 units; y downwards in the network.
    unit_m = 0.5
    middle = CENTRE + unit_m * np.array([0.2, -0.1, -0.1])
    reach = np.abs(mesh.vertices - middle).sum(axis=1)
    # Edges and corners are rounded off by the smoothing.
    assert np.quantile(np.abs(reach - 0.5 * unit_m), 0.9) < 0.006
    assert reach.max() < 0.5 * unit_m + 0.004, "a quarter of a cell"
    np.testing.assert_allclose(mesh.vertices.mean(axis=0), middle, atol=0.01)
    assert mesh.signed_volume == pytest.approx(4 / 3 * (0.5 * unit_m) ** 3, rel=0.05)


@pytest.mark.nightly
def test_the_body_comes_back_from_its_voxels_also_from_the_side(crafted, ball):
    crafted(body_itself)
    sheets, body = scene(ball)
    mesh = completed_by_network(sheets, body, RingRig().cameras(270, 480)[3], SIDE)
    radius = np.linalg.norm(mesh.vertices - CENTRE, axis=1)
    # The finest features have half as many voxels, 32, and the network takes the middles of the
    # outermost for the cube's walls. One counts where the surface touches it: 3/4 of its width
    # outwards on average, of which the threshold takes 0.2 back.
    step_m = 0.5 * 2 / 31
    assert radius.mean() == pytest.approx(BODY_M * 32 / 31 + (0.75 - 0.2) * step_m, abs=0.005)
    assert np.abs(radius - radius.mean()).max() < 0.6 * step_m, "steps of voxels"
    assert open_edges(mesh) == 0
    assert mesh.signed_volume > 0


def test_the_network_sees_the_sheets_where_they_are(crafted):
    crafted(lambda numbers: answer_is(numbers, [(0, 1.0, 1.0)], 0.0))
    random = np.random.default_rng(0)
    sheets = random.uniform(size=(SIDE,) * 3).astype(np.float32)
    body = np.zeros_like(sheets)
    body[3, 5, 7] = 1.0
    occupancy = Occupancy(sheets * (sheets > 0.9), body)
    z, y, x = np.nonzero(sheets > 0.9)
    points = np.stack([x, SIDE - 1 - y, z], axis=1) / (SIDE - 1) * 2 - 1
    np.testing.assert_allclose(occupancy(points), sheets[z, y, x], atol=2e-3)
    assert occupancy.shown[7, SIDE - 1 - 5, 3]
    assert occupancy.shown.sum() == len(set(zip(x, y, z, strict=True)) | {(7, 5, 3)})


def test_smoothing_takes_bumps_and_leaves_the_size(ball):
    random = np.random.default_rng(0)
    bumps = random.normal(scale=0.01, size=len(ball.vertices))
    rough = Mesh(ball.vertices * (1 + bumps[:, None]), ball.faces)
    radius = np.linalg.norm(smoothed(rough).vertices, axis=1)
    assert radius.std() < 0.5 * bumps.std()
    assert radius.mean() == pytest.approx(1.0, abs=2e-3)
    np.testing.assert_array_equal(smoothed(rough, rounds=0).vertices, rough.vertices)


def test_smoothing_is_that_of_the_package_that_the_authors_use(ball):
    trimesh = pytest.importorskip("trimesh")
    random = np.random.default_rng(1)
    rough = ball.vertices * (1 + random.normal(scale=0.01, size=(len(ball.vertices), 1)))
    theirs = trimesh.Trimesh(rough, ball.faces, process=False)
    trimesh.smoothing.filter_humphrey(theirs, alpha=0.1, beta=0.5, iterations=10)
    own = smoothed(Mesh(rough, ball.faces))
    np.testing.assert_allclose(own.vertices, theirs.vertices, atol=1e-9)


def test_without_an_import_the_way_to_it_is_told(parts):
    with pytest.raises(MissingPart, match=r"no part 'ifnet'.*ifnet.ckpt.*import ifnet"):
        ifnet_part()

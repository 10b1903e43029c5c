"""One suite for every method in the catalogue that can be loaded here."""

from __future__ import annotations

import contextlib
from pathlib import Path

import numpy as np
import pytest

from harness.core.artifacts import Capture, image_name
from harness.core.errors import HarnessError, MissingPart
from harness.core.mesh import Mesh
from harness.core.protocols import Configurable, Context, Method
from harness.core.rigs import RingRig
from harness.geometry.images import save_png
from harness.geometry.raycast import Raycaster
from methods.catalog import METHODS

CENTRE_M = np.array([0.05, 0.1, 0.0])


def box() -> Mesh:
    """A standing box off the origin: a wrong frame or scale cannot hide."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    faces = np.array(
        [
            *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
            *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
        ]
    )
    return Mesh(corners * (0.25, 0.7, 0.15) + CENTRE_M, faces)


@pytest.fixture(scope="module")
def capture(tmp_path_factory) -> Capture:
    folder = tmp_path_factory.mktemp("capture")
    cameras = RingRig().cameras(135, 240)
    caster = Raycaster(box())
    for view, camera in enumerate(cameras):
        alpha = np.round(255 * caster.coverage(camera)).astype(np.uint8)
        save_png(
            folder / image_name(view), np.dstack([np.full((*alpha.shape, 3), 180, np.uint8), alpha])
        )
    return Capture("toy", "box", "tiny", "key", folder, cameras)


def context(folder: Path) -> Context:
    return Context(
        seed=0,
        workdir=folder,
        stage=lambda _: contextlib.nullcontext(),
        privileged={"ground_truth_mesh": box()},
    )


def loaded(name: str) -> Method:
    try:
        return METHODS.resolve(name)
    except MissingPart as error:
        pytest.skip(str(error))


@pytest.mark.parametrize("name", list(METHODS))
def test_info_is_complete(name):
    method = loaded(name)
    assert isinstance(method, Method)
    assert method.info.name == name
    assert method.info.title
    assert all(privilege.sentence for privilege in method.info.privileges)
    assert all(part.licence for part in method.info.parts)


@pytest.mark.parametrize("name", list(METHODS))
def test_a_method_with_settings_takes_them_by_room(name):
    method = loaded(name)
    if not method.info.parameters:
        assert not isinstance(method, Configurable)
        return
    assert isinstance(method, Configurable)
    assert all(dict(own) for own in method.info.parameters.values())
    room = next(iter(method.info.parameters))
    with pytest.raises(HarnessError, match=f"unknown setting '{room}.colour'"):
        method.configured({f"{room}.colour": "red"})
    assert method.configured({}).info == method.info


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hull8", "gt"])
def test_result_is_in_place_closed_outward_and_repeatable(name, capture, tmp_path):
    method = loaded(name)
    first = method.reconstruct(capture, context(tmp_path)).mesh
    np.testing.assert_allclose(first.bounds.mean(axis=0), CENTRE_M, atol=0.02)
    np.testing.assert_allclose(first.extent, (0.5, 1.4, 0.3), atol=0.2)
    assert first.signed_volume > 0
    second = method.reconstruct(capture, context(tmp_path)).mesh
    np.testing.assert_array_equal(first.vertices, second.vertices)
    np.testing.assert_array_equal(first.faces, second.faces)


def test_unknown_names_get_the_nearest():
    with pytest.raises(HarnessError, match="unknown method 'hul8'.*Did you mean 'hull8'"):
        METHODS.resolve("hul8")
